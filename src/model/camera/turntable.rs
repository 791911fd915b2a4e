//! Cameras for scenes that have none: a circle around the box.

use glam::{DMat4, DVec3};

use super::{Camera, Lens};
use crate::model::grid::Bounds;

/// `count` cameras on a circle around the box, 30 degrees above its middle, far enough that the
/// box's sphere fills a picture of `size` pixels. The world's z is up, as in training.
pub fn turntable(bounds: &Bounds, count: usize, size: [usize; 2]) -> Vec<Camera> {
    let corner = |corner: [f32; 3]| DVec3::from_array(corner.map(f64::from));
    let (min, max) = (corner(bounds.min), corner(bounds.max));
    let (middle, radius) = (0.5 * (min + max), 0.5 * (max - min).length());
    // A field of view of about 40 degrees along the shorter side.
    let half_angle: f64 = 0.35;
    // Pictures of cameras may decide the stored values: the same bits on every machine.
    let distance = radius / libm::sin(half_angle);
    let focal = 0.5 * size[0].min(size[1]) as f64 / libm::tan(half_angle);
    let lens = Lens {
        width: size[0],
        height: size[1],
        focal: [focal; 2],
        center: [0.5 * size[0] as f64, 0.5 * size[1] as f64],
    };
    let camera = |i: usize| {
        let around = std::f64::consts::TAU * i as f64 / count as f64;
        let up = std::f64::consts::FRAC_PI_6;
        let back = DVec3::new(
            libm::cos(around) * libm::cos(up),
            libm::sin(around) * libm::cos(up),
            libm::sin(up),
        );
        Camera::looking_at(middle, back, distance, format!("turn_{i:03}"), lens)
    };
    (0..count).map(camera).collect()
}

impl Camera {
    /// A camera that looks at `middle` from `distance` away in the direction `back`, of unit length
    /// and not along z, which is up.
    pub fn looking_at(middle: DVec3, back: DVec3, distance: f64, name: String, lens: Lens) -> Self {
        let right = DVec3::Z.cross(back).normalize();
        let to_world = DMat4::from_cols(
            right.extend(0.0),
            back.cross(right).extend(0.0),
            back.extend(0.0),
            (middle + distance * back).extend(1.0),
        );
        Self { name, to_world, lens, picture: None }
    }
}
