//! The pictures that coarser levels are fitted to.

use glam::DVec3;

use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::picture::box_means;
use crate::base::progress::{Progress, Step};
use crate::model::camera::{Camera, Lens};
use crate::model::grid::Bounds;
use crate::view::render::{FrameOptions, LevelChoice, Renderer, render};

/// Cameras, evenly on a sphere; of given ones this many are taken.
const CAMERAS: usize = 192;
/// Pixels of a full picture for each of level 0's nodes along the longest axis.
const PIXELS_A_NODE: f64 = 1.25;
/// Tangent of half the field of view.
const HALF_VIEW: f64 = 0.36;

/// A small picture: the colours that one ray a pixel should have.
#[derive(Debug)]
pub struct Target {
    /// The camera at this size.
    pub camera: Camera,
    /// Colour over the background, rows from the top.
    pub color: Vec<[f32; 3]>,
}

/// Target pictures of all sizes.
#[derive(Debug)]
pub struct Targets {
    pictures: Vec<Target>,
    /// For each halving of the size, the pictures' pixels that show anything: `(picture, pixel)`.
    pixels: Vec<Vec<(u32, u32)>>,
}

impl Targets {
    /// Targets for levels up to `halvings`, from the `given` cameras, or from around the box.
    pub fn new(
        field: &Renderer,
        halvings: usize,
        given: &[Camera],
        limits: &Limits,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let view = field.view();
        let longest = view.nodes.0.into_iter().max().unwrap_or(2) as f64;
        // A multiple of the coarsest picture's pixels, so that nothing is cut off.
        let unit = 1usize << halvings;
        let side = ((longest * PIXELS_A_NODE) as usize).next_multiple_of(unit);
        let cameras: Vec<Camera> = match given.len() {
            0 => around(&view.bounds, side).collect(),
            count => {
                let some = given.iter().step_by(count.div_ceil(CAMERAS));
                some.map(|camera| fitting(camera, side, unit)).collect()
            }
        };
        let options = FrameOptions { levels: LevelChoice::Fixed(0), ..FrameOptions::default() };
        let mut budget = Budget::new(limits);
        for camera in &cameras {
            let pixels = (camera.lens.width * camera.lens.height) as u64;
            // Of a colour and a number each, on pictures of a quarter of the pixels, a sixteenth
            // ...
            let bytes = pixels / 3 * (size_of::<[f32; 3]>() + size_of::<(u32, u32)>()) as u64;
            budget.spend(bytes, "bytes of pictures", &Place::File)?;
        }
        let count = cameras.len();
        progress.begin(Step::Targets, count as u64);
        let mut pictures = Vec::new();
        let mut pixels = vec![Vec::new(); halvings + 1];
        for (number, camera) in cameras.into_iter().enumerate() {
            progress.part(Step::Targets, &format!("picture {}/{count}", number + 1));
            let frame = render(field, &camera, &options, progress)?;
            let clamped =
                |pixel: usize, channel: usize| frame.color[pixel][channel].clamp(0.0, 1.0);
            for (halving, pixels) in pixels.iter_mut().enumerate().skip(1) {
                let scale = 1 << halving;
                let size = [camera.lens.width, camera.lens.height];
                let means = |of: &dyn Fn(usize) -> f32| -> Vec<f32> {
                    box_means(size, scale, of).collect()
                };
                let [red, green, blue] =
                    [0, 1, 2].map(|channel| means(&|pixel| clamped(pixel, channel)));
                let left = means(&|pixel| frame.transmittance[pixel]);
                let color = (0..red.len()).map(|i| [red[i], green[i], blue[i]]).collect();
                let [wide, high] = size.map(|side| side / scale);
                let shows = |pixel: usize| {
                    let [x, y] = [pixel % wide, pixel / wide];
                    let near = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
                    near(y, high).any(|y| near(x, wide).any(|x| left[y * wide + x] < 0.9999))
                };
                let picture = pictures.len() as u32;
                let shown = (0..left.len()).filter(|&pixel| shows(pixel));
                pixels.extend(shown.map(|pixel| (picture, pixel as u32)));
                let lens = camera.lens.shrunk(scale);
                pictures.push(Target { camera: Camera { lens, ..camera.clone() }, color });
            }
            progress.advance(Step::Targets, 1);
        }
        Ok(Self { pictures, pixels })
    }

    /// A pixel for fitting `level`, drawn by `number`; none if no picture shows anything.
    pub fn draw(&self, level: usize, number: usize) -> Option<(&Target, usize)> {
        let random = scramble(number as u64 ^ (level as u64) << 48);
        // Half the pixels where the level is alone, half where it takes over from the finer one.
        let halving = (level - (random & 1) as usize).max(1);
        let pixels = self.pixels.get(halving).filter(|pixels| !pixels.is_empty())?;
        let (picture, pixel) = pixels[((random >> 1) % pixels.len() as u64) as usize];
        Some((&self.pictures[picture as usize], pixel as usize))
    }
}

/// A given camera with a picture of the size that levels are made for, a multiple of `unit` pixels.
fn fitting(camera: &Camera, side: usize, unit: usize) -> Camera {
    let Lens { width, height, .. } = camera.lens;
    let scale = side as f64 / width.max(height) as f64;
    let [width, height] = [width, height]
        .map(|pixels| ((pixels as f64 * scale) as usize).next_multiple_of(unit).max(unit));
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
        // Distances from where the box fills the view to 1.4 times that, so that footprints vary.
        let distance =
            radius / HALF_VIEW * (0.85 + 0.4 * ((i * 5) % CAMERAS) as f64 / CAMERAS as f64);
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
