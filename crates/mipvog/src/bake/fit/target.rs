//! The pictures that coarser levels are fitted to.
//!
//! A *window* is a square of a picture's pixels: one pixel of a picture that many times smaller.
//! Its mean colour is the target of one ray through its middle. Windows start at any pixel, so rays
//! pass nodes at every offset.

use std::path::Path;

use glam::DVec3;

use super::morton_pixels::{EMPTY, MortonPixels, code};
use super::options::FitOptions;
use super::summed_area::SummedArea;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::progress::{Progress, Step};
use crate::model::camera::{Camera, Lens, Ray};
use crate::model::grid::Bounds;
use crate::view::compare::photograph;
use crate::view::render::{FrameOptions, LevelChoice, Renderer, render};

/// Cameras of pictures for small windows; also the number of given cameras that are used.
const NEAR_CAMERAS: usize = 48;
/// Cameras of pictures for large windows alone: small pictures have few windows, so only more
/// directions add information.
const FAR_CAMERAS: usize = 128;
/// Pixels of the pictures for small windows along one pixel of those for large windows.
const FAR_REDUCTION: usize = 2;
/// Pixels of a large window, at least, along each side.
const LEAST_SIDE: usize = 4;
/// Pixels of a full picture for each of level 0's nodes along the longest axis.
const PIXELS_A_NODE: f64 = 2.0;
/// Tangent of half the field of view.
const HALF_VIEW: f64 = 0.36;
/// Nearest and farthest camera; at 1 the box fills the view.
const DISTANCES: [f64; 2] = [0.7, 1.4];
/// One picture of this many is for validation.
const VALIDATION: usize = 8;

/// A picture of level 0.
#[derive(Debug)]
struct Picture {
    /// Among the pictures of all series.
    number: usize,
    camera: Camera,
    /// Colour over the background.
    color: SummedArea,
}

/// Pictures of one resolution.
#[derive(Debug)]
struct Series {
    pictures: Vec<Picture>,
    /// Pixels that are not background, for steps and for validation.
    shown: [MortonPixels; 2],
    /// Pixels of the finest series along one of this.
    reduction: usize,
}

/// Target pictures.
#[derive(Debug)]
pub struct Targets {
    /// The finest first.
    series: Vec<Series>,
    /// Scales that windows have: those of scale `s` are `2^(s + 1)` pixels wide.
    pub scales: usize,
    /// Pictures of all series.
    pub pictures: usize,
}

/// The set of windows from which a ray is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Windows {
    /// Windows for validation.
    Validation,
    /// Windows for steps: this one of this many parts of the pixel order.
    Part(usize, usize),
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
    /// The picture, below [`Targets::pictures`].
    pub picture: usize,
}

impl Targets {
    /// Targets for `coarser` levels: from the given cameras, or from around the box; photographs,
    /// or pictures of level 0.
    ///
    /// # Errors
    /// Cameras that cannot be rendered, photographs that cannot be read, `OverLimit` if pictures
    /// do not fit in the memory of `limits`, `Cancelled`.
    pub fn new(
        field: &Renderer,
        coarser: usize,
        options: &FitOptions,
        limits: &Limits,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let FitOptions { cameras: given, photographs, .. } = *options;
        let view = field.view();
        let longest = view.nodes.0.into_iter().max().unwrap_or(2) as f64;
        let side = ((longest * PIXELS_A_NODE) as usize).max(8);
        let cameras = |count: usize, reduction: usize| -> Vec<Camera> {
            match given.len() {
                0 => around(&view.bounds, side / reduction, count).collect(),
                _ if photographs.is_some() => given.to_vec(),
                all => {
                    let some = given.iter().step_by(all.div_ceil(count));
                    some.map(|camera| fitting(camera, side / reduction)).collect()
                }
            }
        };
        let mut series = vec![(cameras(NEAR_CAMERAS, 1), 1)];
        // The same cameras again would add nothing.
        if given.is_empty() || (given.len() > NEAR_CAMERAS && photographs.is_none()) {
            series.push((cameras(FAR_CAMERAS, FAR_REDUCTION), FAR_REDUCTION));
        }
        let mut budget = Budget::new(limits);
        let mut spend = |lens: &Lens| {
            let bytes = size_of::<[f32; 3]>() + MortonPixels::BYTES;
            let bytes = (lens.width * lens.height * bytes) as u64;
            budget.spend(bytes, "bytes of pictures", &Place::File)
        };
        if photographs.is_none() {
            series.iter().flat_map(|(cameras, _)| cameras).try_for_each(|c| spend(&c.lens))?;
        }
        let count: usize = series.iter().map(|(cameras, _)| cameras.len()).sum();
        progress.begin(Step::Targets, count as u64);
        // Steps also use windows between two scales.
        let largest = (3usize << coarser).pow(2);
        let mut rendered = 0;
        let mut render_series = |(cameras, reduction): (Vec<Camera>, usize)| {
            let (mut pictures, mut shown) = (Vec::new(), [Vec::new(), Vec::new()]);
            for (number, camera) in cameras.into_iter().enumerate() {
                if progress.cancelled() {
                    return Err(Error::cancelled());
                }
                let place = rendered;
                rendered += 1;
                progress.part(Step::Targets, &format!("picture {rendered}/{count}"));
                let shot = match photographs {
                    Some(folder) => Shot::photographed(field, folder, &camera, side, limits)?,
                    None => Shot::rendered(field, camera, progress)?,
                };
                if photographs.is_some() {
                    spend(&shot.camera.lens)?;
                }
                let Shot { camera, color, places } = shot;
                let pixels = (0u32..).zip(places).filter(|(_, place)| *place != EMPTY);
                let pixels = pixels.map(|(pixel, place)| [place, number as u32, pixel]);
                shown[usize::from(is_held_out(number))].extend(pixels);
                let color = SummedArea::new(&color, camera.lens.width, largest);
                pictures.push(Picture { number: place, color, camera });
                progress.advance(Step::Targets, 1);
            }
            Ok(Series { pictures, shown: shown.map(MortonPixels::new), reduction })
        };
        let series: Vec<Series> =
            series.into_iter().map(&mut render_series).collect::<Result<_>>()?;
        let shortest =
            |picture: &Picture| picture.camera.lens.width.min(picture.camera.lens.height);
        let least = series[0].pictures.iter().map(shortest).min().unwrap_or(0);
        let scales = (0..=coarser).take_while(|scale| 2 << scale <= least).count();
        Ok(Self { series, scales, pictures: count })
    }

    /// The target of window `number`; none if no picture shows anything.
    pub fn draw(&self, scale: usize, number: usize, windows: Windows) -> Option<Target> {
        let (validates, part) = match windows {
            Windows::Validation => (true, [0, 1]),
            Windows::Part(part, parts) => (false, [part, parts]),
        };
        let random = scramble(number as u64 ^ (scale as u64) << 48);
        let series = self.series_of(scale, random);
        let random = scramble(random);
        let [picture, pixel] = series.shown(validates)?.draw(random, part);
        let picture = &series.pictures[picture as usize];
        let Lens { width, height, .. } = picture.camera.lens;
        let shorter = width.min(height);
        let random = scramble(random);
        let side = match random & 1 {
            // Steps also use window sizes between the scales.
            1 if !validates && (3 << scale) / series.reduction <= shorter => 3 << scale,
            _ => 2 << scale,
        };
        let side = (side / series.reduction).min(shorter);
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
        let aside = [ray(x + half, y), ray(x, y + half)];
        Some(Target { ray: ray(x, y), aside, color, picture: picture.number })
    }

    /// A series whose windows at this scale have enough pixels, drawn in proportion to its
    /// pictures.
    fn series_of(&self, scale: usize, random: u64) -> &Series {
        let usable = |series: &&Series| {
            series.reduction == 1 || (2 << scale) / series.reduction >= LEAST_SIDE
        };
        let pictures = self.series.iter().filter(usable).map(|series| series.pictures.len());
        let mut drawn = (random % pictures.sum::<usize>().max(1) as u64) as usize;
        for series in self.series.iter().filter(usable) {
            match drawn.checked_sub(series.pictures.len()) {
                Some(left) => drawn = left,
                None => return series,
            }
        }
        &self.series[0]
    }
}

impl Series {
    /// Pixels to draw from: those for validation, or those for steps if there are none.
    fn shown(&self, validates: bool) -> Option<&MortonPixels> {
        let [steps, validation] = &self.shown;
        let shown = if validates && !validation.is_empty() { validation } else { steps };
        Some(shown).filter(|shown| !shown.is_empty())
    }
}

/// True for held-out pictures, which no step uses. A single picture is never held out.
pub fn is_held_out(picture: usize) -> bool {
    picture % VALIDATION == VALIDATION - 1
}

/// The picture of a camera.
struct Shot {
    camera: Camera,
    /// Colour over the background.
    color: Vec<[f32; 3]>,
    /// Codes of the places that pixels show; [`EMPTY`] for the background.
    places: Vec<u32>,
}

impl Shot {
    /// Level 0.
    fn rendered(field: &Renderer, camera: Camera, progress: &dyn Progress) -> Result<Self> {
        let options = FrameOptions { levels: LevelChoice::Fixed(0), ..FrameOptions::default() };
        let frame = render(field, &camera, &options, progress)?;
        let view = field.view();
        let place = |pixel: usize| {
            let left = frame.transmittance[pixel];
            if left >= 0.9999 {
                return EMPTY;
            }
            // Light that passes through the field has the depth of its far end.
            let passed = left * view.march.far.unwrap_or(0.0);
            let distance = f64::from((frame.distance[pixel] - passed) / (1.0 - left));
            let (x, y) = (pixel % frame.width, pixel / frame.width);
            let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
            let place = ray.origin + ray.direction / ray.direction.length() * distance;
            code(&view.bounds, place)
        };
        let places = (0..frame.color.len()).map(place).collect();
        Ok(Self { camera, color: frame.color, places })
    }

    /// A photograph, of `side` pixels or more along its longer side.
    fn photographed(
        field: &Renderer,
        folder: &Path,
        camera: &Camera,
        side: usize,
        limits: &Limits,
    ) -> Result<Self> {
        let background = field.view().background;
        let (camera, picture) = photograph(folder, camera, side, background, limits)?;
        let place = |opacity: &f32| if *opacity > 0.0 { 0 } else { EMPTY };
        let places = match picture.opacity {
            Some(opacity) => opacity.iter().map(place).collect(),
            None => vec![0; picture.color.len()],
        };
        Ok(Self { camera, color: picture.color, places })
    }
}

/// A given camera, resized to the pictures that levels are made for.
fn fitting(camera: &Camera, side: usize) -> Camera {
    let Lens { width, height, .. } = camera.lens;
    let scale = side as f64 / width.max(height) as f64;
    let [width, height] =
        [width, height].map(|pixels| ((pixels as f64 * scale).round() as usize).max(1));
    Camera { lens: camera.lens.resized(width, height), ..camera.clone() }
}

/// `count` cameras on spheres around the box, looking at its middle.
fn around(bounds: &Bounds, side: usize, count: usize) -> impl Iterator<Item = Camera> {
    let corner = |corner: [f32; 3]| DVec3::from_array(corner.map(f64::from));
    let (min, max) = (corner(bounds.min), corner(bounds.max));
    let (middle, radius) = (0.5 * (min + max), 0.5 * (max - min).length());
    let side_f64 = side as f64;
    let focal = [0.5 * side_f64 / HALF_VIEW; 2];
    let lens = Lens { width: side, height: side, focal, center: [0.5 * side_f64; 2] };
    (0..count).map(move |i| {
        // A Fibonacci spiral: even in height, the golden angle apart.
        let up = 1.0 - (2 * i + 1) as f64 / count as f64;
        let around = 2.399_963_229_728_653 * i as f64;
        let flat = (1.0 - up * up).sqrt();
        let back = DVec3::new(libm::cos(around) * flat, libm::sin(around) * flat, up);
        // Distances span an octave, so that footprints have every size.
        let [near, far] = DISTANCES;
        let share = ((i * 5) % count) as f64 / count as f64;
        let distance = radius / HALF_VIEW * (near + (far - near) * share);
        Camera::looking_at(middle, back, distance, format!("fit_{i:03}"), lens)
    })
}

/// A hash (the finalizer of SplitMix64, Steele et al. 2014).
fn scramble(number: u64) -> u64 {
    let mut z = number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}
