//! Directional brightness of coarser levels, from the sides on which bright and dark nodes lie.
//!
//! A view from one side shows what lies on that side. So the brightness of a coarse node, seen
//! along the unit direction `d`, is the mean over the fine nodes under it, weighted by alpha and by
//! the light that leaves them against `d`. The vector `b` for which `d . b` is nearest to the
//! difference of that brightness and the mean one, by least squares over all directions, is
//!
//! ```text
//! b = -3 (sum of alpha y n - m * sum of alpha n) / (1.05 * sum of alpha v) / (m (1 - m))
//! ```
//!
//! with the brightness `y` of a fine node, the mean of its three colours; its bent normal `n`
//! ([`super::transmittance`]); the mean `v` of its transmittance to outside; and the brightness `m`
//! of the coarse node. Squared components of directions have a mean of a third, which gives the 3;
//! 0.05 keeps faint nodes faint. The last factor turns colours into logits. The sums are filtered
//! like alpha. The last of them is bounded by two sums that the levels already have: `(sum of alpha
//! v)^2 <= sum of alpha * sum of alpha v^2`.
//!
//! The fine nodes are those of the level [`super::Direction::moments`]: the level before the one on
//! which light is traced, or level 0. If it is not level 0, the brightness `y` of its nodes is a
//! mean over finer nodes.

use multiversion::multiversion;

use super::transmittance::BENT_ONE;
use crate::model::directional::DIRECTIONAL;

/// Sums on their way up: of `alpha n` and of `alpha y n`, along each axis.
pub const MOMENTS: usize = 2 * DIRECTIONAL;
/// Largest magnitude of a stored value, in logits.
pub const LARGEST_BRIGHTNESS: f32 = 6.0;
/// Regularization of the least squares, relative to the weight.
const DAMPING: f32 = 0.05;
/// Weight far below that of any visible node.
const LEAST_WEIGHT: f32 = 1e-6;
/// The brightness at which the logits' slope is taken stays this far from 0 and 1.
const MARGIN: f32 = 0.05;

/// Sums at the nodes of a span of a row.
pub(super) struct Sums<'a> {
    /// Of alpha.
    pub alpha: &'a [f32],
    /// Of alpha times visibility, which is the square of transmittance.
    pub visible: &'a [f32],
    /// Of alpha times the bent normal's part along an axis, in 32767ths.
    pub bent: &'a [f32],
    /// The same times brightness.
    pub bright: &'a [f32],
}

/// Directional brightness along one axis, of nodes whose colours have these `means`.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub(super) fn along_axis(sums: &Sums, means: &[f32], brightness: &mut [f32]) {
    let weights = sums.alpha.iter().zip(sums.visible);
    let moments = sums.bent.iter().zip(sums.bright);
    let nodes = brightness.iter_mut().zip(means).zip(weights).zip(moments);
    for (((brightness, &mean), (alpha, visible)), (bent, bright)) in nodes {
        let weight = (1.0 + DAMPING) * (alpha * visible).sqrt() + LEAST_WEIGHT;
        let middle = mean.clamp(MARGIN, 1.0 - MARGIN);
        let slope = middle * (1.0 - middle);
        let value = (mean * bent - bright) * (3.0 / BENT_ONE) / (weight * slope);
        *brightness = value.clamp(-LARGEST_BRIGHTNESS, LARGEST_BRIGHTNESS);
    }
}
