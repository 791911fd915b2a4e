//! Cameras for scenes that have none: circles and spirals around the box.

use std::f64::consts::{FRAC_PI_6, TAU};

use glam::{DMat4, DVec3};

use super::{Camera, Lens};
use crate::model::grid::Bounds;

/// Half the field of view along the shorter side of a picture, in radians; the full angle is about
/// 40 degrees.
const HALF_VIEW: f64 = 0.35;
/// Turns of a spiral.
const TURNS: f64 = 3.0;
/// Sines of a spiral's first and last elevations, 3 and 72 degrees.
const SPIRAL: [f64; 2] = [0.05, 0.95];

/// A path around the box. The cameras look at its middle. The world's z is up, as in training.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// Angle of a circle's cameras above the box's middle in radians, between a quarter turn below
    /// and a quarter turn above.
    pub elevation: f64,
    /// Distance from the box's middle in radii of the box's sphere, above 0; without one the sphere
    /// fills the picture.
    pub radius: Option<f64>,
    /// Field of view along the shorter side of a picture in radians, above 0 and below pi.
    pub field_of_view: f64,
    /// Angle of the first camera in radians, from x towards y.
    pub start: f64,
}

impl Default for Orbit {
    fn default() -> Self {
        let field_of_view = 2.0 * HALF_VIEW;
        Self { elevation: FRAC_PI_6, radius: None, field_of_view, start: 0.0 }
    }
}

/// `count` cameras on a circle around the box, 30 degrees above its middle, far enough that the
/// box's sphere fills a picture of `size` pixels.
pub fn turntable(bounds: &Bounds, count: usize, size: [usize; 2]) -> Vec<Camera> {
    Orbit::default().circle(bounds, count, size)
}

impl Orbit {
    /// `count` cameras on a circle, with pictures of `size` pixels.
    pub fn circle(&self, bounds: &Bounds, count: usize, size: [usize; 2]) -> Vec<Camera> {
        let at = |i: usize| (TAU * i as f64 / count as f64, self.elevation);
        self.cameras(bounds, count, size, "turn", at)
    }

    /// `count` cameras on a spiral that rises over the upper half of a sphere, with pictures of
    /// `size` pixels. Equal parts of the spiral rise by equal heights. It sets its own elevation.
    pub fn spiral(&self, bounds: &Bounds, count: usize, size: [usize; 2]) -> Vec<Camera> {
        let at = |i: usize| {
            let share = (i as f64 + 0.5) / count as f64;
            let height = SPIRAL[0] + (SPIRAL[1] - SPIRAL[0]) * share;
            (TAU * TURNS * share, libm::asin(height))
        };
        self.cameras(bounds, count, size, "spiral", at)
    }

    /// Cameras at the angle from the start and the elevation that `at` returns for their index.
    fn cameras(
        &self,
        bounds: &Bounds,
        count: usize,
        size: [usize; 2],
        name: &str,
        at: impl Fn(usize) -> (f64, f64),
    ) -> Vec<Camera> {
        let (middle, box_radius) = sphere(bounds);
        let half_angle = 0.5 * self.field_of_view;
        // Stored values may depend on these cameras, so the bits must be the same on every machine.
        let distance = match self.radius {
            Some(radius) => radius * box_radius,
            None => box_radius / libm::sin(half_angle),
        };
        let lens = Lens::centered(size, half_angle);
        let camera = |i: usize| {
            let (around, up) = at(i);
            let back = direction(self.start + around, up);
            Camera::looking_at(middle, back, distance, format!("{name}_{i:03}"), lens)
        };
        (0..count).map(camera).collect()
    }
}

/// The middle and the radius of the sphere around the box.
pub fn sphere(bounds: &Bounds) -> (DVec3, f64) {
    let corner = |corner: [f32; 3]| DVec3::from_array(corner.map(f64::from));
    let (min, max) = (corner(bounds.min), corner(bounds.max));
    (0.5 * (min + max), 0.5 * (max - min).length())
}

/// The unit vector `around` from x towards y and `up` from there, both in radians.
pub fn direction(around: f64, up: f64) -> DVec3 {
    DVec3::new(libm::cos(around) * libm::cos(up), libm::sin(around) * libm::cos(up), libm::sin(up))
}

impl Lens {
    /// Square pixels and a centre in the middle; `half_angle`, in radians, is half the angle along
    /// the shorter side.
    pub fn centered(size: [usize; 2], half_angle: f64) -> Self {
        let [width, height] = size;
        let focal = 0.5 * width.min(height) as f64 / libm::tan(half_angle);
        let center = [0.5 * width as f64, 0.5 * height as f64];
        Self { width, height, focal: [focal; 2], center }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    const BOX: Bounds = Bounds { min: [-1.0, -0.5, 0.25], max: [1.5, 2.0, 1.0] };

    fn place(camera: &Camera) -> DVec3 {
        camera.to_world.w_axis.truncate()
    }

    #[test]
    fn a_plain_turntable_is_the_same_to_the_last_bit() {
        // Stored values depend on these positions.
        let (middle, radius) = sphere(&BOX);
        for (i, camera) in turntable(&BOX, 7, [40, 30]).iter().enumerate() {
            let around = TAU * i as f64 / 7.0;
            let back = DVec3::new(
                libm::cos(around) * libm::cos(FRAC_PI_6),
                libm::sin(around) * libm::cos(FRAC_PI_6),
                libm::sin(FRAC_PI_6),
            );
            assert_eq!(place(camera), middle + radius / libm::sin(0.35) * back);
            assert_eq!(camera.lens.focal, [15.0 / libm::tan(0.35); 2]);
            assert_eq!(camera.name, format!("turn_00{i}"));
        }
    }

    #[test]
    fn orbits_keep_to_their_angles_and_distances() {
        let (middle, radius) = sphere(&BOX);
        let orbit = Orbit {
            elevation: -0.3,
            radius: Some(2.5),
            field_of_view: 1.0,
            start: std::f64::consts::FRAC_PI_2,
        };
        let circle = orbit.circle(&BOX, 4, [50, 20]);
        let spiral = orbit.spiral(&BOX, 50, [50, 20]);
        for camera in circle.iter().chain(&spiral) {
            assert!((place(camera).distance(middle) / radius - 2.5).abs() < 1e-12);
            let half = libm::atan(10.0 / camera.lens.focal[1]);
            assert!((half - 0.5).abs() < 1e-12, "the shorter side");
        }
        assert!(circle.iter().all(|camera| {
            ((place(camera) - middle).z / (2.5 * radius) - libm::sin(-0.3)).abs() < 1e-12
        }));
        // A quarter turn from x is y.
        let first = place(&circle[0]) - middle;
        assert!(first.x.abs() < 1e-9 && first.y > 0.0);
        // A spiral rises in equal steps, and stays above the middle.
        let heights: Vec<f64> = spiral.iter().map(|camera| (place(camera) - middle).z).collect();
        assert!(heights.is_sorted() && heights[0] > 0.0);
        let steps = heights.windows(2).map(|pair| pair[1] - pair[0]);
        assert!(steps.clone().all(|step| (step - 2.5 * radius * 0.9 / 50.0).abs() < 1e-9));
    }
}
