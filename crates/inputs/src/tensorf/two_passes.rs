//! The samples of nerfstudio: evenly spaced ones, then as many as the second pass has, where the
//! first one found density.
//!
//! A sample is the middle of an interval, and represents all of it.

use crate::model::ray_march::{ZeroGuard, crossing};
use crate::resample::resampled;

/// Opacity of the first pass below which a ray counts as empty.
const OPACITY: f64 = 1e-4;

/// The distances at which a ray enters and leaves a box; the second is larger.
pub(super) fn span(origin: [f64; 3], direction: [f64; 3], corners: [[f64; 3]; 2]) -> [f64; 2] {
    // nerfstudio's guard of divisions by 0.
    let [near, far] = crossing(origin, direction, corners, ZeroGuard::Add(1e-6));
    let near = near.max(0.0);
    [near, far.max(near + 1e-6)]
}

/// The ends of the intervals of the second pass; none for an empty ray. Each pass has its own
/// number of intervals; `density` is the optical depth per unit at a distance.
pub(super) fn intervals(
    [even, found]: [usize; 2],
    [near, far]: [f64; 2],
    mut density: impl FnMut(f64) -> f64,
) -> Vec<f64> {
    let edge = |number: usize| number as f64 / even as f64;
    let at = |share: f64| share * far + (1.0 - share) * near;
    let width = (far - near) / even as f64;
    let (mut depth, mut opacity) = (0.0, 0.0);
    let mut weights = Vec::with_capacity(even);
    for number in 0..even {
        let own = width * density(at(0.5 * (edge(number) + edge(number + 1))));
        let weight = -libm::expm1(-own) * libm::exp(-depth);
        depth += own;
        opacity += weight;
        weights.push(weight);
    }
    if opacity < OPACITY {
        return Vec::new();
    }
    let edges: Vec<f64> = (0..=even).map(edge).collect();
    resampled(&edges, &weights, found).into_iter().map(at).collect()
}
