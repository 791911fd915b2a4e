//! The pictures that coarser levels are fitted to.
//!
//! A *window* is a square of a picture's pixels: one pixel of a picture that many times smaller. Its
//! mean colour is what one ray through its middle should have. Windows start at any pixel, so a ray
//! passes nodes at every position.

use glam::DVec3;

use super::summed_area::SummedArea;
use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::progress::{Progress, Step};
use crate::model::camera::{Camera, Lens, Ray};
use crate::model::grid::Bounds;
use crate::view::render::{FrameOptions, LevelChoice, Renderer, render};

/// Cameras, evenly on a sphere; of given ones this many are taken.
const CAMERAS: usize = 64;
/// Pixels of a full picture for each of level 0's nodes along the longest axis.
const PIXELS_A_NODE: f64 = 2.0;
/// Tangent of half the field of view.
const HALF_VIEW: f64 = 0.36;
/// Nearest and farthest camera; at 1 the box fills the view.
const DISTANCES: [f64; 2] = [0.7, 1.4];
/// Windows of steps that lie around one pixel: their rays read the same nodes, which are in a cache
/// then, and whose derivatives have less noise.
const GROUP: usize = 4;
/// One picture of this many is for validation.
const VALIDATION: usize = 8;

/// A large picture.
#[derive(Debug)]
struct Picture {
    camera: Camera,
    /// Colour over the background.
    color: SummedArea,
}

/// Target pictures.
#[derive(Debug)]
pub struct Targets {
    pictures: Vec<Picture>,
    /// Pixels that show anything, `(picture, pixel)`, for steps and for validation.
    shown: [Vec<(u32, u32)>; 2],
    /// Scales that windows have: those of scale `s` are `2^(s + 1)` pixels wide.
    pub scales: usize,
}

/// One ray and the colour that it should have.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Through the window's middle.
    pub ray: Ray,
    /// Half a window to the right and below.
    pub aside: [Ray; 2],
    /// Mean colour of the window.
    pub color: [f32; 3],
}

impl Targets {
    /// Targets for `coarser` levels, from the `given` cameras, or from around the box.
    pub fn new(
        field: &Renderer,
        coarser: usize,
        given: &[Camera],
        limits: &Limits,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let view = field.view();
        let longest = view.nodes.0.into_iter().max().unwrap_or(2) as f64;
        let side = ((longest * PIXELS_A_NODE) as usize).max(8);
        let cameras: Vec<Camera> = match given.len() {
            0 => around(&view.bounds, side).collect(),
            count => {
                let some = given.iter().step_by(count.div_ceil(CAMERAS));
                some.map(|camera| fitting(camera, side)).collect()
            }
        };
        let options = FrameOptions { levels: LevelChoice::Fixed(0), ..FrameOptions::default() };
        let mut budget = Budget::new(limits);
        for camera in &cameras {
            let pixels = (camera.lens.width * camera.lens.height) as u64;
            let bytes = pixels * (size_of::<[f32; 3]>() + size_of::<(u32, u32)>()) as u64;
            budget.spend(bytes, "bytes of pictures", &Place::File)?;
        }
        let count = cameras.len();
        progress.begin(Step::Targets, count as u64);
        // Steps see windows between two scales, too.
        let largest = (3usize << coarser).pow(2);
        let mut pictures = Vec::new();
        let mut shown = [Vec::new(), Vec::new()];
        for (number, camera) in cameras.into_iter().enumerate() {
            progress.part(Step::Targets, &format!("picture {}/{count}", number + 1));
            let frame = render(field, &camera, &options, progress)?;
            // A set for validation needs more pictures than one.
            let validates = number % VALIDATION == VALIDATION - 1;
            let shows = (0..frame.color.len()).filter(|&pixel| frame.transmittance[pixel] < 0.9999);
            shown[usize::from(validates)].extend(shows.map(|pixel| (number as u32, pixel as u32)));
            let color = SummedArea::new(&frame.color, camera.lens.width, largest);
            pictures.push(Picture { color, camera });
            progress.advance(Step::Targets, 1);
        }
        if shown[1].is_empty() {
            shown[1] = shown[0].clone();
        }
        let shortest = |camera: &Camera| camera.lens.width.min(camera.lens.height);
        let least = pictures.iter().map(|picture| shortest(&picture.camera)).min().unwrap_or(0);
        let scales = (0..=coarser).take_while(|scale| 2 << scale <= least).count();
        Ok(Self { pictures, shown, scales })
    }

    /// The target of window `number`; none if no picture shows anything.
    pub fn draw(&self, scale: usize, number: usize, validates: bool) -> Option<Target> {
        let random = |number: usize| scramble(number as u64 ^ (scale as u64) << 48);
        let shown = Some(&self.shown[usize::from(validates)]).filter(|shown| !shown.is_empty())?;
        let group = if validates { 1 } else { GROUP };
        let drawn = random(number / group * group);
        let (picture, pixel) = shown[(drawn % shown.len() as u64) as usize];
        let picture = &self.pictures[picture as usize];
        let Lens { width, height, .. } = picture.camera.lens;
        let random = scramble(random(number));
        let side = match random & 1 {
            // Steps see sizes between those of scales, too.
            1 if !validates && 3 << scale <= width.min(height) => 3 << scale,
            _ => 2 << scale,
        };
        // The pixel is in the window or at most half a window beside it.
        let start = |at: usize, random: u64, end: usize| {
            let back = (random % (2 * side) as u64) as usize;
            (at + side / 2).saturating_sub(back).min(end - side)
        };
        let pixel = pixel as usize;
        let x = start(pixel % width, random >> 8, width);
        let y = start(pixel / width, random >> 32, height);
        let color = picture.color.mean(x, y, side);
        let half = 0.5 * side as f64;
        let (x, y) = (x as f64 + half, y as f64 + half);
        let ray = |x: f64, y: f64| picture.camera.ray(x, y);
        Some(Target { ray: ray(x, y), aside: [ray(x + half, y), ray(x, y + half)], color })
    }
}

/// A given camera with a picture of the size that levels are made for.
fn fitting(camera: &Camera, side: usize) -> Camera {
    let Lens { width, height, .. } = camera.lens;
    let scale = side as f64 / width.max(height) as f64;
    let [width, height] =
        [width, height].map(|pixels| ((pixels as f64 * scale).round() as usize).max(1));
    Camera { lens: camera.lens.resized(width, height), ..camera.clone() }
}

/// Cameras on spheres around the box, looking at its middle.
fn around(bounds: &Bounds, side: usize) -> impl Iterator<Item = Camera> {
    let corner = |corner: [f32; 3]| DVec3::from_array(corner.map(f64::from));
    let (min, max) = (corner(bounds.min), corner(bounds.max));
    let (middle, radius) = (0.5 * (min + max), 0.5 * (max - min).length());
    let side_f64 = side as f64;
    let focal = [0.5 * side_f64 / HALF_VIEW; 2];
    let lens = Lens { width: side, height: side, focal, center: [0.5 * side_f64; 2] };
    (0..CAMERAS).map(move |i| {
        // A Fibonacci spiral: even in height, the golden angle apart.
        let up = 1.0 - (2 * i + 1) as f64 / CAMERAS as f64;
        let around = 2.399_963_229_728_653 * i as f64;
        let flat = (1.0 - up * up).sqrt();
        let back = DVec3::new(libm::cos(around) * flat, libm::sin(around) * flat, up);
        // Distances over an octave, so that footprints are of every size.
        let [near, far] = DISTANCES;
        let share = ((i * 5) % CAMERAS) as f64 / CAMERAS as f64;
        let distance = radius / HALF_VIEW * (near + (far - near) * share);
        Camera::looking_at(middle, back, distance, format!("fit_{i:02}"), lens)
    })
}

/// A well mixed number (the finalizer of SplitMix64, Steele et al. 2014).
fn scramble(number: u64) -> u64 {
    let mut z = number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}
