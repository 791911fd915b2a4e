//! What physically based filters average: matter, and the colour of matter.
//!
//! Raw values are logarithms of sorts: the mean of -60 and +10 is nearly empty, although half the
//! space is opaque, and an empty node's colour counts as much as a wall's. So nodes are *lifted* on
//! their way up from level 0: density becomes an amount of matter, every colour and feature is
//! activated and weighted by how much of that is seen ([`super::visibility`]). All are then plain
//! linear means on all levels. At each level they *settle* into what is stored: an amount into the
//! level's density domain, weighted colours divided by their weight into logits. Nodes that are nearly empty hold no
//! matter at all, and nothing is read of their colours.
//!
//! Amounts are opacities over a few intervals, `1 - exp(-reach * tau)` with the optical depth `tau`
//! of one interval: matter counts by how much of the light behind it covers. Means of optical depth
//! itself would let one node inside a wall, whose 40 nobody can tell from 4, swell the wall by a node
//! of every coarser level. The settled optical depth is `-ln(1 - amount) / reach`.

use crate::model::activate::{self, lanes};
use crate::model::field::Activation;

use multiversion::multiversion;

/// Smaller amounts are none: most of a scene is empty, and costs nothing where that is known. A node of so much lets all
/// but one part in ten million of the light through, 140 dB below what can be seen.
const LEAST_AMOUNT: f64 = 1e-7;
/// Where the exponential ends ([`lanes::exp`]): lower shifted raw densities are none whatever the interval.
const EMPTY_BELOW: f32 = -80.0;
/// Values that are looked at together for being empty.
const EMPTY_RUN: usize = 32;
/// Amounts settle no closer to 1 than this: an optical depth that lets through one part in 10^7.
const MOST_AMOUNT: f64 = 1.0 - 1e-7;

/// What amounts of matter settle into.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Settled {
    /// The square root of the optical depth over one interval.
    SqrtOpticalDepth,
    /// Opacity over one interval.
    Opacity,
}

/// Lifts and settles values of one scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Matter {
    /// Raw density to optical depth.
    pub activation: Activation,
    /// Intervals over which opacity is the amount.
    pub reach: f32,
    /// What is stored.
    pub settled: Settled,
    empty_up_to: f32,
}

impl Matter {
    /// Matter as opacity over `reach` intervals, and what it settles into.
    pub fn new(activation: Activation, reach: f32, settled: Settled) -> Self {
        let Activation { shift, interval, .. } = activation;
        let [at, over] = [shift, interval * reach].map(f64::from);
        let least = activate::raw_at_opacity(LEAST_AMOUNT, at, over) as f32;
        Self { activation, reach, settled, empty_up_to: least.max(EMPTY_BELOW - shift) }
    }

    /// The highest raw density that is no matter.
    pub fn empty_up_to(&self) -> f32 {
        self.empty_up_to
    }

    /// Amounts of raw densities.
    pub fn lift_density(&self, raw: &[f32], amounts: &mut [f32]) {
        let Activation { shift, interval, .. } = self.activation;
        lift_density(raw, amounts, shift, interval * self.reach, self.empty_up_to);
    }

    /// Colours of raw colours, multiplied by weights.
    pub fn lift_color(&self, raw: &[f32], weights: &[f32], weighted: &mut [f32]) {
        lift_color(raw, weights, weighted);
    }

    /// The amount from which opacity over `intervals` exceeds `opacity`, lowered by a hair so that no
    /// rounding drops what is above.
    pub fn amount_at_opacity(&self, opacity: f32, intervals: f64) -> f32 {
        let depth = -libm::log1p(-f64::from(opacity)) / intervals;
        (-libm::expm1(-depth * f64::from(self.reach)) * (1.0 - 1e-6)) as f32
    }

    /// The optical depths over one interval of amounts.
    pub(super) fn depths(&self, amounts: &[f32], depths: &mut [f32]) {
        optical_depths(amounts, f64::from(self.reach), depths);
    }

    /// What is stored of amounts.
    pub(super) fn settle_amounts(&self, amounts: &[f32], settled: &mut [f32]) {
        let reach = f64::from(self.reach);
        match self.settled {
            Settled::SqrtOpticalDepth => sqrt_optical_depths(amounts, reach, settled),
            Settled::Opacity => {
                for (settled, &amount) in settled.iter_mut().zip(amounts) {
                    *settled = -libm::expm1(-optical_depth(amount, reach)) as f32;
                }
            }
        }
    }
}

/// The optical depth over one interval of an amount.
#[inline(always)]
fn optical_depth(amount: f32, reach: f64) -> f64 {
    -lanes::ln(1.0 - f64::from(amount).clamp(0.0, MOST_AMOUNT)) / reach
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn optical_depths(amounts: &[f32], reach: f64, depths: &mut [f32]) {
    for (depth, &amount) in depths.iter_mut().zip(amounts) {
        *depth = optical_depth(amount, reach) as f32;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn sqrt_optical_depths(amounts: &[f32], reach: f64, settled: &mut [f32]) {
    for (settled, &amount) in settled.iter_mut().zip(amounts) {
        *settled = optical_depth(amount, reach).sqrt() as f32;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn lift_density(raw: &[f32], amounts: &mut [f32], shift: f32, interval: f32, empty_up_to: f32) {
    // Most of a scene is empty, and found so faster than lifted.
    for (raw, amounts) in raw.chunks(EMPTY_RUN).zip(amounts.chunks_mut(EMPTY_RUN)) {
        if raw.iter().fold(0, |any, &raw| any | u32::from(raw > empty_up_to)) == 0 {
            amounts.fill(0.0);
            continue;
        }
        for (amount, &raw) in amounts.iter_mut().zip(raw) {
            let lifted = lanes::opacity(lanes::softplus(raw + shift) * interval);
            *amount = if raw > empty_up_to { lifted } else { 0.0 };
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn lift_color(raw: &[f32], weights: &[f32], weighted: &mut [f32]) {
    for ((weighted, raw), weight) in weighted.iter_mut().zip(raw).zip(weights) {
        *weighted = lanes::sigmoid(*raw) * weight;
    }
}
