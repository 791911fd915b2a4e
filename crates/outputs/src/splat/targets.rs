//! Pictures of the field that splats are fitted to.

use glam::DVec3;

use super::optimize::Target;
use crate::base::error::{Error, Result};
use crate::base::progress::{Progress, Silent, Step};
use crate::format::{ExportOptions, ExportSource};
use crate::model::camera::{Camera, Lens, Orbit, direction, sphere};
use crate::view::render::{FrameOptions, LevelChoice, render};
use crate::view::{INSIDE_ANGLE, overview, standpoints};

/// Number of targets, and pixels along a side of each. Splats that were fitted to smaller pictures
/// show gaps in larger ones, because renderers widen them by a part of a pixel.
const TARGETS: usize = 40;
const SIDE: usize = 320;
/// Larger pictures of given cameras are downsampled.
const LARGEST_SIDE: usize = 400;
/// Given cameras that become targets, at most.
const MOST_CAMERAS: usize = 60;
/// Number of viewpoints in a world.
const STANDPOINTS: usize = 4;

/// The pictures: those of given cameras, or of cameras all around; in a world, of cameras inside.
///
/// # Errors
/// Errors of rendering, and a request to stop.
pub(super) fn targets(
    source: &ExportSource,
    options: &ExportOptions,
    progress: &dyn Progress,
) -> Result<Vec<Target>> {
    let cameras = match (options.cameras.is_empty(), &source.world) {
        (false, _) => given(&options.cameras),
        (true, None) => around(source, progress)?,
        (true, Some(_)) => inside(source, progress)?,
    };
    progress.begin(Step::Targets, cameras.len() as u64);
    let levels = LevelChoice::Fixed(options.level);
    let rules = FrameOptions { levels, supersample: 1 };
    let pictures = cameras.into_iter().map(|camera| {
        let frame = render(&source.field, &camera, &rules, &Silent)?;
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
        progress.advance(Step::Targets, 1);
        let color = frame.color.iter().map(|color| color.map(|v| v.clamp(0.0, 1.0))).collect();
        Ok(Target { camera, color })
    });
    pictures.collect()
}

/// Evenly spaced given cameras, with smaller pictures.
fn given(cameras: &[Camera]) -> Vec<Camera> {
    let every = cameras.len().div_ceil(MOST_CAMERAS);
    let smaller = |camera: &Camera| {
        let side = camera.lens.width.max(camera.lens.height);
        let factor = side.div_ceil(LARGEST_SIDE).max(1);
        let [width, height] =
            [camera.lens.width, camera.lens.height].map(|side| (side / factor).max(1));
        Camera { lens: camera.lens.resized(width, height), ..camera.clone() }
    };
    cameras.iter().step_by(every).map(smaller).collect()
}

/// Cameras evenly spread around the visible scene, at the overview's distance.
fn around(source: &ExportSource, progress: &dyn Progress) -> Result<Vec<Camera>> {
    let bounds = &source.field.view().bounds;
    let orbit = Orbit::default();
    let near = overview(&source.field, [SIDE; 2], progress)?;
    let eye = near.to_world.w_axis.truncate();
    let (middle, radius) = sphere(bounds);
    let forwards = -near.to_world.z_axis.truncate();
    // The target of the overview: the point of its axis nearest to the box's middle.
    let distance = (middle - eye).dot(forwards).max(0.1 * radius);
    let middle = eye + distance * forwards;
    let lens = Lens::centered([SIDE; 2], 0.5 * orbit.field_of_view);
    let turn = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let cameras = (0..TARGETS).map(|number| {
        let up = 1.0 - (2 * number + 1) as f64 / TARGETS as f64;
        let back = direction(turn * number as f64, libm::asin(up));
        // Every other camera is closer, for detail.
        let distance = if number % 2 == 0 { distance } else { 0.75 * distance };
        Camera::looking_at(middle, back, distance, format!("around_{number:02}"), lens)
    });
    Ok(cameras.collect())
}

/// Cameras at the freest places of the innermost box, that look in all directions.
fn inside(source: &ExportSource, progress: &dyn Progress) -> Result<Vec<Camera>> {
    let places = standpoints(&source.field, STANDPOINTS, progress)?;
    let lens = Lens::centered([SIDE; 2], 0.5 * INSIDE_ANGLE);
    let turn = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let cameras = (0..TARGETS).map(|number| {
        let up = 1.0 - (2 * number + 1) as f64 / TARGETS as f64;
        let back = direction(turn * number as f64, libm::asin(up));
        let eye: DVec3 = places[number % places.len()];
        Camera::looking_at(eye - back, back, 1.0, format!("inside_{number:02}"), lens)
    });
    Ok(cameras.collect())
}
