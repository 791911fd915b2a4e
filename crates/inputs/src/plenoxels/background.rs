//! The light of the background spheres along a ray, by the rules of svox2's renderer `cuvol`.
//!
//! ```text
//! r_i    = n / (n - i - 1/2),  n = floor(L / step_size) + 2    for r_i above the ray's least radius
//! t_i    = where the ray leaves the sphere of radius r_i
//! depth  = (1/r_(i-1) - 1/r_i) w sigma    w: world length of a unit along the ray
//! colour = max(0, c / (2 sqrt(pi)) + 1/2)
//! ```
//!
//! Distances of samples are measured in inverse radii, so a layer absorbs the same light at any
//! radius. svox2 trains and renders this way. Its CPU version, which checks gradients, measures
//! lengths along the ray and renders the same file differently.
//!
//! Spheres are met from within. A camera outside the first one sees only their far halves, as in
//! svox2.

use super::spheres::{SphereSpace, Spheres, dot, sphere_count};
use crate::base::progress::Progress;
use crate::model::camera::Ray;
use crate::model::ray_march::{DepthComposite, SampleBudget, point_at, unit_direction};

/// A ray crosses no sphere at its least radius, so it starts this much farther out.
const BESIDE: f64 = 1e-3;

/// Adds the light of the spheres behind the samples so far, until the transmittance falls to
/// `opaque`.
pub(super) fn add_spheres(
    light: &mut DepthComposite,
    ray: &Ray,
    (spheres, space): (&Spheres, &SphereSpace),
    [step_size, opaque]: [f64; 2],
    progress: &dyn Progress,
) {
    let origin = space.place(ray.origin.to_array());
    let direction = space.direction(unit_direction(ray));
    let unit = 1.0 / dot(direction, direction).sqrt();
    let direction = direction.map(|by| by * unit);
    let [along, square] = [dot(origin, direction), dot(origin, origin)];
    let beside = (square - along * along).max(0.0);
    let least = (beside.sqrt() + BESIDE).max(1.0);
    let count = sphere_count(spheres.layers(), step_size);
    let mut last = 1.0 / least;
    let mut left = SampleBudget::new(0.0, 1.0, progress);
    let mut number = (count - 0.5 - count / least).ceil().max(0.0);
    while number < count && left.take() {
        let inverse = (count - number - 0.5) / count;
        number += 1.0;
        let radius = 1.0 / inverse;
        if radius < least {
            continue;
        }
        let t = (radius * radius - beside).sqrt() - along;
        let found = spheres.at(point_at(origin, direction, t).map(|at| at * inverse), inverse);
        if found.density > 0.0 {
            light.add((last - inverse) * unit * found.density, t * unit, found.color());
            if light.transmittance() < opaque {
                return;
            }
        }
        last = inverse;
    }
}
