//! The values that physically based filters average: alpha and premultiplied colours.
//!
//! Logits are not linear: the mean of -60 and +10 is nearly empty, although half the space is
//! opaque, and an empty node's colour counts as much as a wall's. So level 0 is premultiplied on
//! its way up: density becomes alpha, and every colour and feature is activated and multiplied by
//! the visible alpha ([`super::visibility`]). All levels are then plain linear means. Each level is
//! stored in its own density domain, and colours are divided by their weight and stored as logits.
//! Nodes that are nearly empty have alpha 0, and their colours are not read.
//!
//! ```text
//! alpha = 1 - exp(-span * tau)        tau = softplus(raw + shift) * interval
//! ```
//!
//! `tau` is the optical depth of one interval, `span` a few intervals: a node counts by the share
//! of the light that it covers. Means of optical depth itself would not work: one node inside a
//! wall, whose value of 40 looks the same as 4, would thicken the wall by a node on every coarser
//! level. The stored optical depth is `-ln(1 - alpha) / span`.

use multiversion::multiversion;

use crate::model::activate::lanes;
use crate::model::baked::DensityDomain;
use crate::model::field::{Activation, DensityFunction};

/// Smaller alphas are 0: most of a scene is empty, and known empty nodes cost nothing. A node of
/// this alpha lets all but one part in ten million of the light through, 140 dB below the visible
/// range.
const LEAST_ALPHA: f64 = 1e-7;
/// Lower shifted raw densities have alpha 0 for any interval: the exponential underflows here
/// ([`lanes::exp`]).
const EMPTY_BELOW: f32 = -80.0;
/// Number of values that are tested for emptiness together.
const EMPTY_RUN: usize = 32;
/// Larger alphas are clamped to this one, which transmits one part in 10^7.
const GREATEST_ALPHA: f64 = 1.0 - 1e-7;

/// Alpha of one scene: raw density to alpha, and alpha to the values that levels store.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AlphaDomain {
    /// Raw density to optical depth.
    pub activation: Activation,
    /// Intervals over which opacity is alpha, above 0.
    pub span: f32,
    /// The values that coarser levels store.
    pub stored: DensityDomain,
    empty_up_to: f32,
}

impl AlphaDomain {
    /// Alpha as opacity over `span` intervals, stored as `stored`.
    pub fn new(activation: Activation, span: f32, stored: DensityDomain) -> Self {
        let wide = Activation { interval: activation.interval * span, ..activation };
        let least = wide.raw_at_opacity(LEAST_ALPHA) as f32;
        let empty_up_to = match activation.function {
            DensityFunction::Softplus => least.max(EMPTY_BELOW - activation.shift),
            DensityFunction::Relu => least,
        };
        Self { activation, span, stored, empty_up_to }
    }

    /// The highest raw density whose alpha is 0.
    pub fn empty_up_to(&self) -> f32 {
        self.empty_up_to
    }

    /// Alphas of raw densities.
    pub fn density_to_alpha(&self, raw: &[f32], alphas: &mut [f32]) {
        let Activation { shift, interval, function, .. } = self.activation;
        let (interval, empty_up_to) = (interval * self.span, self.empty_up_to);
        match function {
            DensityFunction::Softplus => logit_to_alpha(raw, alphas, shift, interval, empty_up_to),
            DensityFunction::Relu => density_to_alpha(raw, alphas, interval, empty_up_to),
        }
    }

    /// The alpha above which opacity over `intervals` exceeds `opacity`, lowered slightly so that
    /// rounding drops no node above it.
    pub fn alpha_at_opacity(&self, opacity: f32, intervals: f64) -> f32 {
        let depth = -libm::log1p(-f64::from(opacity)) / intervals;
        (-libm::expm1(-depth * f64::from(self.span)) * (1.0 - 1e-6)) as f32
    }

    /// The largest density that coarser levels store, where that is the square root of optical
    /// depth.
    pub fn largest_sqrt_depth(&self) -> f32 {
        optical_depth(1.0, f64::from(self.span)).sqrt() as f32
    }

    /// Optical depths over one interval of alphas.
    pub(super) fn optical_depths(&self, alphas: &[f32], depths: &mut [f32]) {
        optical_depths(alphas, f64::from(self.span), depths);
    }

    /// The stored values of alphas.
    pub(super) fn stored(&self, alphas: &[f32], stored: &mut [f32]) {
        let span = f64::from(self.span);
        if self.stored == DensityDomain::SqrtOpticalDepth {
            return sqrt_optical_depths(alphas, span, stored);
        }
        for (stored, &alpha) in stored.iter_mut().zip(alphas) {
            *stored = -libm::expm1(-optical_depth(alpha, span)) as f32;
        }
    }
}

/// The optical depth over one interval of an alpha.
#[inline(always)]
fn optical_depth(alpha: f32, span: f64) -> f64 {
    -lanes::ln(1.0 - f64::from(alpha).clamp(0.0, GREATEST_ALPHA)) / span
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn optical_depths(alphas: &[f32], span: f64, depths: &mut [f32]) {
    for (depth, &alpha) in depths.iter_mut().zip(alphas) {
        *depth = optical_depth(alpha, span) as f32;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn sqrt_optical_depths(alphas: &[f32], span: f64, stored: &mut [f32]) {
    for (stored, &alpha) in stored.iter_mut().zip(alphas) {
        *stored = optical_depth(alpha, span).sqrt() as f32;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn density_to_alpha(densities: &[f32], alphas: &mut [f32], interval: f32, empty_up_to: f32) {
    for (alpha, &density) in alphas.iter_mut().zip(densities) {
        let opacity = lanes::opacity(density.max(0.0) * interval);
        *alpha = if density > empty_up_to { opacity } else { 0.0 };
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn logit_to_alpha(raw: &[f32], alphas: &mut [f32], shift: f32, interval: f32, empty_up_to: f32) {
    // Most of a scene is empty, and a test is faster than exponentials.
    for (raw, alphas) in raw.chunks(EMPTY_RUN).zip(alphas.chunks_mut(EMPTY_RUN)) {
        if raw.iter().fold(0, |any, &raw| any | u32::from(raw > empty_up_to)) == 0 {
            alphas.fill(0.0);
            continue;
        }
        // Two loops, because shorter dependency chains let processors overlap more vectors.
        for (alpha, &raw) in alphas.iter_mut().zip(raw) {
            *alpha = lanes::softplus(raw + shift) * interval;
        }
        for (alpha, &raw) in alphas.iter_mut().zip(raw) {
            let opacity = lanes::opacity(*alpha);
            *alpha = if raw > empty_up_to { opacity } else { 0.0 };
        }
    }
}

/// Linear colours, multiplied by weights.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub fn premultiply_colors(colors: &[f32], weights: &[f32], premultiplied: &mut [f32]) {
    for ((premultiplied, color), weight) in premultiplied.iter_mut().zip(colors).zip(weights) {
        *premultiplied = color * weight;
    }
}

/// Raw colours, activated and multiplied by weights.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub fn premultiply_logits(raw: &[f32], weights: &[f32], premultiplied: &mut [f32]) {
    for ((premultiplied, raw), weight) in premultiplied.iter_mut().zip(raw).zip(weights) {
        *premultiplied = lanes::sigmoid(*raw) * weight;
    }
}

/// Means of three channels that were multiplied by weights; 0 where the weight is 0.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub fn mean_colors([red, green, blue]: [&[f32]; 3], weights: &[f32], means: &mut [f32]) {
    let channels = red.iter().zip(green).zip(blue);
    for ((mean, ((red, green), blue)), weight) in means.iter_mut().zip(channels).zip(weights) {
        *mean = (red + green + blue) / (3.0 * weight.max(f32::MIN_POSITIVE));
    }
}
