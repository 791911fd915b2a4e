//! Converts interpolated density to optical depth.

use multiversion::multiversion;

use super::view::View;
use crate::model::activate::lanes;
use crate::model::baked::DensityDomain;
use crate::model::scene::{Activation, ActivationOrder, DensityFunction};

/// The optical depth over one interval of an interpolated density. Finite even for the largest
/// numbers, so that mixing two of them cannot give NaN.
#[inline(always)]
pub fn optical_depth(density: f32, domain: DensityDomain, view: &View) -> f32 {
    let Activation { shift, interval, order, function } = view.activation;
    match (domain, order) {
        (DensityDomain::Raw, ActivationOrder::Raw) => raw_depth(density, shift, interval, function),
        (DensityDomain::Raw, ActivationOrder::Density) => {
            (density.max(0.0) * interval).min(f32::MAX)
        }
        (DensityDomain::SqrtOpticalDepth, _) => {
            (density * density * view.depth_scale).min(f32::MAX)
        }
        // Opacities of nodes are over the file's interval, which a picture may override.
        (DensityDomain::Raw, ActivationOrder::Opacity) | (DensityDomain::Opacity, _) => {
            opaque_depth(density) * view.depth_scale
        }
    }
}

/// Replaces interpolated densities by their [`optical_depth`].
pub fn optical_depths(densities: &mut [f32], domain: DensityDomain, view: &View) {
    let Activation { shift, interval, order, function } = view.activation;
    if (domain, order) == (DensityDomain::Raw, ActivationOrder::Raw) {
        return raw_depths(densities, shift, interval, function);
    }
    densities.iter_mut().for_each(|density| *density = optical_depth(*density, domain, view));
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn raw_depths(raw: &mut [f32], shift: f32, interval: f32, function: DensityFunction) {
    raw.iter_mut().for_each(|raw| *raw = raw_depth(*raw, shift, interval, function));
}

/// The same for raw density that was interpolated before activation.
#[inline(always)]
pub fn raw_depth(raw: f32, shift: f32, interval: f32, function: DensityFunction) -> f32 {
    (lanes::density(raw + shift, function) * interval).min(f32::MAX)
}

fn opaque_depth(alpha: f32) -> f32 {
    -libm::log1pf(-alpha.clamp(0.0, 1.0 - f32::EPSILON))
}
