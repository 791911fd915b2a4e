//! What holds for models of every family alike: the same bytes from any number of threads, and rays
//! from anywhere that come to an end.

use crate::common::families::{self, models, open};
use crate::common::folder;
use crate::common::models::renderer;
use glam::DVec3;
use mipvog::base::progress::Silent;
use mipvog::model::camera::Ray;

/// Distances from which rays come.
const DISTANCES: [f64; 5] = [0.0, 1e6, 1e12, 1e16, 1e25];

/// `tests/slow/every_family.rs` bakes them many times.
#[test]
fn bytes_do_not_depend_on_threads() {
    families::bytes_do_not_depend_on_threads(&[1, 16], 1);
}

#[test]
fn rays_from_anywhere_come_to_an_end() {
    let here = folder();
    for (family, path) in models(here.path()) {
        let model = renderer(&open(family, &path));
        let bounds = model.view().bounds;
        let middle = DVec3::from(
            [0, 1, 2].map(|axis| 0.5 * (f64::from(bounds.min[axis]) + f64::from(bounds.max[axis]))),
        );
        let ways = [
            DVec3::new(1.0, 1.0, 1.0),
            DVec3::new(1.0, 0.0, 0.0),
            DVec3::new(0.0, -1.0, 1e-9),
            DVec3::new(-0.3, 0.8, 0.5),
        ];
        let rays = DISTANCES.iter().flat_map(|&distance| {
            ways.iter().map(move |way| {
                let direction = way.normalize();
                Ray { origin: middle - distance * direction, direction }
            })
        });
        let rays: Vec<Ray> = rays.collect();
        let light = model.ray_colors(&rays, 0, &Silent).expect("rays");
        for (ray, light) in rays.iter().zip(light) {
            assert!(
                light.color.iter().all(|value| value.is_finite())
                    && (0.0..=1.0).contains(&light.transmittance),
                "{}: {light:?} along {ray:?}",
                path.display()
            );
        }
    }
}
