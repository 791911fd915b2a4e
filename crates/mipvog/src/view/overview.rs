//! A camera for a scene without cameras. The visible scene fills its picture.
//!
//! Small pictures from around the box give points on the scene's surface. The camera looks from the
//! front right and above. It centres these points in its picture, and is just far enough away to
//! show all of them.
//!
//! For a world, the camera is inside: in the middle half of the innermost box, at the position
//! farthest from all surfaces, and looks at the centre of that box.

use glam::DVec3;

use super::render::{Frame, Renderer, render_depths};
#[cfg(feature = "pictures")]
use super::render::{FrameOptions, LevelChoice, render};
use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::model::camera::{Camera, Lens, Orbit, Ray, direction, sphere};
use crate::model::trained_model::RayColor;

/// Number of small pictures, on a circle around the box.
const LOOKS: usize = 6;
/// Pixels along a side of a small picture.
const SIDE: usize = 72;
/// A pixel of at least this opacity shows the surface.
const SHOWS: f32 = 0.5;
/// Share of the points that may lie outside the picture on each side, so single floaters do not
/// move the camera.
const OUTSIDE: f64 = 0.0005;
/// Share of the picture that stays empty around the scene.
const MARGIN: f64 = 0.08;
/// Angle of the view from x towards y, in radians: in training scenes the front looks along -y.
const AROUND: f64 = -0.96;
/// Angle of the view above the horizon, in radians.
const UP: f64 = 0.42;
/// Number of candidate positions along each axis for a camera inside a world.
const PLACES: usize = 4;
/// Minimum distance of further positions inside a world from all surfaces, relative to that of the
/// best position.
const NEARLY_AS_FREE: f64 = 0.3;
/// Angle of the view inside a world, in radians.
pub const INSIDE_ANGLE: f64 = 1.2;

/// A camera for a picture of `size` pixels that shows the whole scene.
///
/// # Errors
/// Rules that cannot be rendered, and `Cancelled`.
pub fn overview(field: &Renderer, size: [usize; 2], progress: &dyn Progress) -> Result<Camera> {
    if !field.view().boxes.is_empty() {
        return inside(field, size, progress);
    }
    let orbit = Orbit::default();
    let bounds = &field.view().bounds;
    let mut points = Vec::new();
    for camera in orbit.circle(bounds, LOOKS, [SIDE; 2]) {
        let frame = render_depths(field, &camera, progress)?;
        surface(&camera, &frame, field.view().march.far, &mut points);
    }
    let back = direction(AROUND, UP);
    let half_angle = 0.5 * orbit.field_of_view;
    let lens = Lens::centered(size, half_angle);
    let (middle, radius) = sphere(bounds);
    let whole = Camera::looking_at(middle, back, radius / libm::sin(half_angle), name(), lens);
    // Nothing is opaque, so the camera shows the box.
    Ok(if points.is_empty() { whole } else { closest(&whole, &points) })
}

/// A PNG from the camera of [`overview`]: `size` pixels, four rays per pixel, over the background.
///
/// # Errors
/// As [`overview`].
#[cfg(feature = "pictures")]
pub fn overview_png(
    field: &Renderer,
    size: [usize; 2],
    progress: &dyn Progress,
) -> Result<Vec<u8>> {
    let camera = overview(field, size, progress)?;
    let options = FrameOptions { levels: LevelChoice::Auto, supersample: 2 };
    let frame = render(field, &camera, &options, progress)?;
    let byte = |value: &f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
    let pixels: Vec<u8> = frame.color.as_flattened().iter().map(byte).collect();
    crate::picture::png(size[0], size[1], &pixels)
}

/// The camera of a world.
fn inside(field: &Renderer, size: [usize; 2], progress: &dyn Progress) -> Result<Camera> {
    let eye = standpoints(field, 1, progress)?[0];
    let (middle, _) = sphere(&field.view().finest_bounds);
    // In the middle itself, the front is where that of objects is.
    let away = (eye - middle).try_normalize().unwrap_or(direction(AROUND, 0.0));
    let lens = Lens::centered(size, 0.5 * INSIDE_ANGLE);
    Ok(Camera::looking_at(eye - away, away, 1.0, name(), lens))
}

/// `count` cameras inside a world, at the position of [`overview`], that look around the horizon.
///
/// # Errors
/// As [`overview`].
pub fn panorama(
    field: &Renderer,
    count: usize,
    size: [usize; 2],
    progress: &dyn Progress,
) -> Result<Vec<Camera>> {
    let eye = standpoints(field, 1, progress)?[0];
    let lens = Lens::centered(size, 0.5 * INSIDE_ANGLE);
    let camera = |number: usize| {
        let away = direction(AROUND + std::f64::consts::TAU * number as f64 / count as f64, 0.0);
        Camera::looking_at(eye - away, away, 1.0, format!("{}{number}", name()), lens)
    };
    Ok((0..count).map(camera).collect())
}

/// The positions in the middle half of the innermost box that are farthest from all surfaces: at
/// least one and at most `most`, the farthest first, then others that are not much closer. The
/// outer half is excluded because most scenes have no cameras there.
///
/// # Errors
/// Errors of rendering, and `Cancelled`.
pub fn standpoints(field: &Renderer, most: usize, progress: &dyn Progress) -> Result<Vec<DVec3>> {
    let bounds = &field.view().finest_bounds;
    let (middle, radius) = sphere(bounds);
    let extent = DVec3::from(bounds.extent());
    let [min, far] = [middle - 0.25 * extent, DVec3::splat(4.0 * radius)];
    let places = (0..PLACES.pow(3)).map(|i| {
        let at = [i / PLACES / PLACES, i / PLACES % PLACES, i % PLACES];
        min + 0.5 * extent * DVec3::from(at.map(|at| (at as f64 + 0.5) / PLACES as f64))
    });
    let places: Vec<DVec3> = places.collect();
    let around: Vec<DVec3> = (0..27)
        .filter(|&i| i != 13)
        .map(|i| DVec3::from([i / 9, i / 3 % 3, i % 3].map(|at| f64::from(at) - 1.0)).normalize())
        .collect();
    let ray = |&origin: &DVec3| around.iter().map(move |&direction| Ray { origin, direction });
    let rays: Vec<Ray> = places.iter().flat_map(ray).collect();
    let light = field.ray_colors(&rays, field.view().finest, progress)?;
    let free = |light: &[RayColor]| {
        let reached = |ray: &RayColor| match ray.transmittance < SHOWS {
            true => f64::from(ray.distance),
            false => far.x,
        };
        light.iter().map(reached).fold(far.x, f64::min)
    };
    let distances = light.chunks(around.len()).map(free);
    let mut free: Vec<(f64, DVec3)> = distances.zip(places).filter(|(at, _)| *at > 0.0).collect();
    // Stable sort: of equally free places, the first one wins.
    free.sort_by(|a, b| b.0.total_cmp(&a.0));
    let least = free.first().map_or(0.0, |(distance, _)| NEARLY_AS_FREE * distance);
    free.retain(|(distance, _)| *distance >= least);
    free.truncate(most.max(1));
    Ok(match free.is_empty() {
        true => vec![middle],
        false => free.into_iter().map(|(_, place)| place).collect(),
    })
}

fn name() -> String {
    "view".to_owned()
}

/// The surface points that the opaque pixels of a picture show.
fn surface(camera: &Camera, frame: &Frame, far: Option<f32>, points: &mut Vec<DVec3>) {
    for pixel in 0..frame.width * frame.height {
        let left = frame.transmittance[pixel];
        if left > 1.0 - SHOWS {
            continue;
        }
        // Light that passes through the field has the depth `far`.
        let reached = frame.distance[pixel] - left * far.unwrap_or(0.0);
        let [x, y] = [pixel % frame.width, pixel / frame.width];
        let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
        let distance = f64::from(reached / (1.0 - left));
        points.push(ray.origin + distance * ray.direction.normalize());
    }
}

/// The closest camera with the same rotation and lens that shows all points.
fn closest(camera: &Camera, points: &[DVec3]) -> Camera {
    let [right, up, back] = [0, 1, 2].map(|axis| camera.to_world.col(axis).truncate());
    let lens = &camera.lens;
    let slopes = [lens.width as f64 / lens.focal[0], lens.height as f64 / lens.focal[1]]
        .map(|slope| 0.5 * slope * (1.0 - MARGIN));
    // From a place at height `z` towards the viewer, a point is inside the picture's left edge if
    // `x + slope * (eye.z - z) >= eye.x`, and so on: the two sides of each axis give its middle and
    // the least distance.
    let mut eye = [0.0; 2];
    let mut height = f64::NEG_INFINITY;
    let sides = [(right, slopes[0]), (up, slopes[1])].map(|(axis, slope)| {
        let high = quantile(points.iter().map(|p| p.dot(axis) / slope + p.dot(back)).collect());
        let low = quantile(points.iter().map(|p| -p.dot(axis) / slope + p.dot(back)).collect());
        (slope, high, low)
    });
    for (axis, (slope, high, low)) in sides.into_iter().enumerate() {
        eye[axis] = 0.5 * slope * (high - low);
        height = height.max(0.5 * (high + low));
    }
    let place = eye[0] * right + eye[1] * up + height * back;
    let mut closest = camera.clone();
    closest.to_world.w_axis = place.extend(1.0);
    closest
}

/// The quantile that only the share [`OUTSIDE`] of the numbers exceeds.
fn quantile(mut numbers: Vec<f64>) -> f64 {
    let index = ((1.0 - OUTSIDE) * (numbers.len() - 1) as f64).round() as usize;
    numbers.sort_by(f64::total_cmp);
    numbers[index]
}
