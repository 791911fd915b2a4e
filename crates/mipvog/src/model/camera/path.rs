//! Camera paths through given cameras.

use glam::{DMat3, DMat4, DQuat, DVec3};

use super::{Camera, Lens};
use crate::base::error::{Error, Result};

/// Cosine of the angle between two rotations above which a straight line is as good as an arc.
const NEARLY_EQUAL: f64 = 1.0 - 1e-9;

/// `count` cameras along the path through `cameras`, from the first to the last. Positions lie on a
/// Catmull-Rom spline, rotations on arcs between the given ones, and lenses are interpolated
/// linearly. Results are the same on every machine.
///
/// # Errors
/// `Usage` for fewer than two cameras, for pictures of several sizes, and for cameras that mirror.
pub fn flight(cameras: &[Camera], count: usize) -> Result<Vec<Camera>> {
    let [first, .., _] = cameras else {
        return Err(Error::usage("a path needs two or more cameras to lead through"));
    };
    let size = |camera: &Camera| [camera.lens.width, camera.lens.height];
    if let Some(other) = cameras.iter().find(|camera| size(camera) != size(first)) {
        return Err(Error::usage(format!(
            "the pictures of {} and {} differ in size: give one size for all",
            first.name, other.name
        )));
    }
    let keys = cameras.iter().map(Key::of).collect::<Result<Vec<_>>>()?;
    let last = keys.len() - 1;
    let camera = |i: usize| {
        let at = last as f64 * i as f64 / (count - 1).max(1) as f64;
        let from = (at as usize).min(last - 1);
        let share = at - from as f64;
        let place = |key: usize| keys[key.min(last)].place;
        // Beyond its ends, the curve is extended straight.
        let before = match from {
            0 => 2.0 * place(0) - place(1),
            _ => place(from - 1),
        };
        let after = match from + 2 {
            key if key > last => 2.0 * place(last) - place(last - 1),
            key => place(key),
        };
        let place = curve([before, place(from), place(from + 1), after], share);
        let rotation = arc(keys[from].rotation, keys[from + 1].rotation, share);
        let axes = DMat3::from_quat(rotation);
        Camera {
            name: format!("path_{i:03}"),
            to_world: DMat4::from_cols(
                axes.x_axis.extend(0.0),
                axes.y_axis.extend(0.0),
                axes.z_axis.extend(0.0),
                place.extend(1.0),
            ),
            lens: keys[from].lens.mixed(&keys[from + 1].lens, share),
            picture: None,
        }
    };
    Ok((0..count).map(camera).collect())
}

/// A camera on the path.
struct Key {
    place: DVec3,
    rotation: DQuat,
    lens: Lens,
}

impl Key {
    fn of(camera: &Camera) -> Result<Self> {
        camera.check()?;
        let axes = DMat3::from_mat4(camera.to_world);
        let lengths = [axes.x_axis, axes.y_axis, axes.z_axis].map(DVec3::length);
        let unit = DMat3::from_cols(
            axes.x_axis / lengths[0],
            axes.y_axis / lengths[1],
            axes.z_axis / lengths[2],
        );
        Ok(Self {
            place: camera.to_world.w_axis.truncate(),
            rotation: DQuat::from_mat3(&unit).normalize(),
            lens: camera.lens,
        })
    }
}

/// The Catmull-Rom spline between the two middle points, at `share` of the way.
fn curve([before, from, to, after]: [DVec3; 4], share: f64) -> DVec3 {
    let (t, t2, t3) = (share, share * share, share * share * share);
    0.5 * (2.0 * from
        + (to - before) * t
        + (2.0 * before - 5.0 * from + 4.0 * to - after) * t2
        + (3.0 * from - before - 3.0 * to + after) * t3)
}

/// The rotation at `share` of the shorter arc from one to another.
fn arc(from: DQuat, to: DQuat, share: f64) -> DQuat {
    let cosine = from.dot(to);
    let (to, cosine) = if cosine < 0.0 { (-to, -cosine) } else { (to, cosine) };
    let [low, high] = if cosine > NEARLY_EQUAL {
        [1.0 - share, share]
    } else {
        let angle = libm::acos(cosine.min(1.0));
        [libm::sin((1.0 - share) * angle), libm::sin(share * angle)]
    };
    (from * low + to * high).normalize()
}

impl Lens {
    /// The lens at `share` of the way to another one, for a picture of this one's size.
    fn mixed(&self, other: &Self, share: f64) -> Self {
        let mix = |from: f64, to: f64| from + share * (to - from);
        Self {
            focal: [0, 1].map(|axis| mix(self.focal[axis], other.focal[axis])),
            center: [0, 1].map(|axis| mix(self.center[axis], other.center[axis])),
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::camera::turntable;
    use crate::model::grid::Bounds;

    fn circle(count: usize) -> Vec<Camera> {
        turntable(&Bounds { min: [-1.0; 3], max: [1.0; 3] }, count, [40, 30])
    }

    #[test]
    fn a_path_passes_its_cameras_and_stays_near_a_circle_between_them() {
        let cameras = circle(8);
        let path = flight(&cameras, 7 * 10 + 1).expect("a path");
        let radius = cameras[0].to_world.w_axis.truncate().length();
        for (i, camera) in path.iter().enumerate() {
            let place = camera.to_world.w_axis.truncate();
            if i % 10 == 0 {
                assert!(camera.to_world.abs_diff_eq(cameras[i / 10].to_world, 1e-9), "{i}");
            }
            // A straight line between neighbours would cut the corner by a 14th of the radius.
            assert!((place.length() / radius - 1.0).abs() < 0.04, "{i}: {place}");
            let axes = DMat3::from_mat4(camera.to_world);
            assert!((axes.determinant() - 1.0).abs() < 1e-9, "{i}");
            // Cameras on the circle look at its middle, and so do those between.
            let looks = axes.z_axis.dot(place.normalize());
            assert!(looks > 0.995, "{i}: {looks}");
        }
        // No jumps: all steps are close to the mean step.
        let places = |i: usize| path[i].to_world.w_axis.truncate();
        let steps: Vec<f64> = (1..path.len()).map(|i| places(i).distance(places(i - 1))).collect();
        let mean = steps.iter().sum::<f64>() / steps.len() as f64;
        assert!(steps.iter().all(|step| (step / mean - 1.0).abs() < 0.5), "{steps:?}");
    }

    #[test]
    fn impossible_paths_are_refused() {
        let cameras = circle(3);
        assert!(flight(&cameras[..1], 5).is_err());
        assert!(flight(&[], 5).is_err());
        let mut sizes = cameras.clone();
        sizes[2].lens.width = 41;
        assert!(flight(&sizes, 5).expect_err("sizes").to_string().contains("differ in size"));
        let mut mirrors = cameras.clone();
        mirrors[1].to_world.x_axis = -mirrors[1].to_world.x_axis;
        assert!(flight(&mirrors, 5).expect_err("mirrors").to_string().contains("mirrors"));
        assert_eq!(flight(&cameras, 1).expect("a path")[0].name, "path_000");
    }
}
