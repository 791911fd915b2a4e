//! Renders pictures of a field.

use glam::DVec3;

use super::march::{Gathered, march};
use super::renderer::{Content, Renderer, with_values};
use super::shade::view_colors;
use super::trained::ray_rules;
use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Silent, Step};
use crate::model::camera::{Camera, Lens};
use crate::model::trained_model::{RayColor, TrainedModel};
use crate::picture::box_means;
use crate::view::sample::SampleLevels;
use crate::view::sample::View;

/// Pixels along each edge of a tile. Neighbouring rays read the same blocks.
const TILE: usize = 16;

/// The level that samples read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LevelChoice {
    /// The level that the field's rule picks.
    #[default]
    Auto,
    /// Always this level.
    Fixed(usize),
}

/// Options of rendering.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameOptions {
    /// The level that samples read.
    pub levels: LevelChoice,
    /// Rays along each side of a pixel, which are averaged.
    pub supersample: usize,
}

impl Default for FrameOptions {
    fn default() -> Self {
        Self { levels: LevelChoice::Auto, supersample: 1 }
    }
}

/// A rendered picture with its other channels, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Colour over the background, not clamped.
    pub color: Vec<[f32; 3]>,
    /// Transmittance of the whole ray, 0 to 1.
    pub transmittance: Vec<f32>,
    /// Expected distance in world units. Light that passes through the field has the distance
    /// `far`, if set.
    pub distance: Vec<f32>,
    /// Weighted mean level of the samples; 0 for pixels without samples.
    pub level: Vec<f32>,
    /// Diffuse colour and features, `channels` values per pixel.
    pub accumulated: Vec<f32>,
    /// Number of values per pixel in `accumulated`.
    pub channels: usize,
    /// Numbers of rays and samples.
    pub statistics: Statistics,
}

/// Cost of rendering.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Statistics {
    /// Number of rays.
    pub rays: u64,
    /// Number of interpolated samples; 0 for models with their own rules.
    pub samples: u64,
    /// Number of samples between the entry and exit of rays, interpolated or skipped; 0 for models
    /// with their own rules.
    pub steps: u64,
}

impl std::ops::AddAssign for Statistics {
    fn add_assign(&mut self, other: Self) {
        self.rays += other.rays;
        self.samples += other.samples;
        self.steps += other.steps;
    }
}

impl Renderer {
    /// Renders the picture of a camera, one ray per pixel, over the field's background.
    ///
    /// # Errors
    /// A camera whose lens or position is out of range.
    pub fn picture(&self, camera: &Camera) -> Result<Frame> {
        render(self, camera, &FrameOptions::default(), &Silent)
    }
}

/// Number of tiles of a picture, the units of [`Step::Render`].
pub fn tiles(lens: &Lens, supersample: usize) -> u64 {
    let along = |pixels: usize| (pixels * supersample).div_ceil(TILE) as u64;
    along(lens.width) * along(lens.height)
}

/// Renders one frame. [`Step::Render`] advances by its [`tiles`].
pub fn render(
    field: &Renderer,
    camera: &Camera,
    options: &FrameOptions,
    progress: &dyn Progress,
) -> Result<Frame> {
    render_by(field, field.view(), camera, options, progress)
}

/// Renders one frame without colours, which take most of the time.
///
/// # Errors
/// As [`render`].
pub fn render_depths(field: &Renderer, camera: &Camera, progress: &dyn Progress) -> Result<Frame> {
    let mut view = field.view().clone();
    // No weight exceeds it.
    view.march.color_threshold = 1.0;
    render_by(field, &view, camera, &FrameOptions::default(), progress)
}

fn render_by(
    field: &Renderer,
    view: &View,
    camera: &Camera,
    options: &FrameOptions,
    progress: &dyn Progress,
) -> Result<Frame> {
    camera.check()?;
    if progress.cancelled() {
        return Err(Error::cancelled());
    }
    let fine = Camera { lens: camera.lens.supersampled(options.supersample), ..camera.clone() };
    view.check()?;
    let frame = match field.content() {
        Content::Values(lanes) => {
            with_values!(lanes, values => render_tiles(view, values, &fine, options, progress))?
        }
        Content::Model(model) => render_model(&**model, view, &fine, progress)?,
    };
    Ok(frame.box_downsampled(options.supersample))
}

/// One tile's pixels in rows.
struct Tile<const C: usize> {
    origin: [usize; 2],
    size: [usize; 2],
    gathered: Vec<Gathered<C>>,
    specular: Vec<[f32; 3]>,
}

fn render_tiles<const C: usize>(
    view: &View,
    field: &impl SampleLevels<C>,
    camera: &Camera,
    options: &FrameOptions,
    progress: &dyn Progress,
) -> Result<Frame> {
    let Lens { width, height, .. } = camera.lens;
    let places = tile_places(&camera.lens);
    let tiles = parallel::map(places.len(), |i| {
        let tile = render_tile(view, field, camera, options, places[i], progress);
        progress.advance(Step::Render, 1);
        tile
    })?;
    let channels = 3 + view.features;
    let mut frame = Frame::black(width, height, channels);
    for tile in &tiles {
        tile.place(view, &mut frame);
    }
    Ok(frame)
}

/// Origin and size of each tile of a picture.
fn tile_places(lens: &Lens) -> Vec<[[usize; 2]; 2]> {
    let across = lens.width.div_ceil(TILE);
    let place = |i: usize| {
        let origin = [i % across * TILE, i / across * TILE];
        [origin, [TILE.min(lens.width - origin[0]), TILE.min(lens.height - origin[1])]]
    };
    (0..across * lens.height.div_ceil(TILE)).map(place).collect()
}

/// Renders a model by its own rules. All of its colour counts as diffuse.
fn render_model(
    model: &dyn TrainedModel,
    view: &View,
    camera: &Camera,
    progress: &dyn Progress,
) -> Result<Frame> {
    let (rules, places) = (ray_rules(view), tile_places(&camera.lens));
    let pixel = |place: [[usize; 2]; 2], i: usize| {
        let [[x, y], [width, _]] = place;
        [x + i % width, y + i / width]
    };
    let tiles = parallel::map(places.len(), |number| {
        let [_, [width, height]] = places[number];
        let follow = |i| {
            let [x, y] = pixel(places[number], i).map(|at| at as f64 + 0.5);
            model.follow(&camera.ray(x, y), &rules, progress)
        };
        let tile: Result<Vec<RayColor>> = (0..width * height).map(follow).collect();
        progress.advance(Step::Render, 1);
        tile
    })?;
    let mut frame = Frame::black(camera.lens.width, camera.lens.height, 3);
    for (&place, tile) in places.iter().zip(&tiles) {
        for (i, light) in tile.iter().enumerate() {
            let [x, y] = pixel(place, i);
            let at = y * frame.width + x;
            frame.color[at] = light.color;
            frame.transmittance[at] = light.transmittance;
            frame.distance[at] = light.distance;
            for channel in 0..3 {
                let behind = light.transmittance * rules.background[channel];
                frame.accumulated[3 * at + channel] = light.color[channel] - behind;
            }
        }
        frame.statistics.rays += tile.len() as u64;
    }
    Ok(frame)
}

fn render_tile<const C: usize>(
    view: &View,
    field: &impl SampleLevels<C>,
    camera: &Camera,
    options: &FrameOptions,
    [origin, size]: [[usize; 2]; 2],
    progress: &dyn Progress,
) -> Result<Tile<C>> {
    let mut gathered = Vec::with_capacity(size[0] * size[1]);
    let mut directions = Vec::with_capacity(size[0] * size[1]);
    let fixed = match options.levels {
        LevelChoice::Auto => None,
        LevelChoice::Fixed(level) => Some(level),
    };
    let needs_footprint = fixed.is_none() && view.level_of_detail.is_some() && field.levels() > 1;
    for y in origin[1]..origin[1] + size[1] {
        for x in origin[0]..origin[0] + size[0] {
            // A ray may have a million samples, so a row of rays could take seconds.
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
            let (x, y) = (x as f64 + 0.5, y as f64 + 0.5);
            let ray = camera.ray(x, y);
            let neighbours =
                needs_footprint.then(|| [camera.ray(x + 0.5, y), camera.ray(x, y + 0.5)]);
            gathered.push(march(view, field, &ray, neighbours, fixed));
            directions.push(unit(ray.direction));
        }
    }
    let specular = view_colors(view, &gathered, &directions);
    Ok(Tile { origin, size, gathered, specular })
}

fn unit(direction: DVec3) -> [f64; 3] {
    (direction / direction.length()).to_array()
}

impl<const C: usize> Tile<C> {
    fn place(&self, view: &View, frame: &mut Frame) {
        for (i, (ray, specular)) in self.gathered.iter().zip(&self.specular).enumerate() {
            let [x, y] = [self.origin[0] + i % self.size[0], self.origin[1] + i / self.size[0]];
            let pixel = y * frame.width + x;
            frame.color[pixel] = ray.over_background(view, *specular);
            frame.transmittance[pixel] = ray.transmittance;
            frame.distance[pixel] = ray.expected_distance(view);
            frame.level[pixel] = ray.level;
            let channels = frame.channels;
            frame.accumulated[pixel * channels..][..channels]
                .copy_from_slice(&ray.color[..channels]);
            let (samples, steps) = (ray.samples.into(), ray.steps.into());
            frame.statistics += Statistics { rays: 1, samples, steps };
        }
    }
}

impl Frame {
    fn black(width: usize, height: usize, channels: usize) -> Self {
        let pixels = width * height;
        Self {
            width,
            height,
            color: vec![[0.0; 3]; pixels],
            transmittance: vec![0.0; pixels],
            distance: vec![0.0; pixels],
            level: vec![0.0; pixels],
            accumulated: vec![0.0; pixels * channels],
            channels,
            statistics: Statistics::default(),
        }
    }

    /// Averages squares of `factor` by `factor` pixels. The remainder at the right and bottom is
    /// dropped.
    #[must_use]
    pub fn box_downsampled(self, factor: usize) -> Self {
        if factor == 1 {
            return self;
        }
        let size = [self.width, self.height];
        let means =
            |of: &dyn Fn(usize) -> f32| -> Vec<f32> { box_means(size, factor, of).collect() };
        let mut small = Self::black(self.width / factor, self.height / factor, self.channels);
        small.statistics = self.statistics;
        small.transmittance = means(&|pixel| self.transmittance[pixel]);
        small.distance = means(&|pixel| self.distance[pixel]);
        small.level = means(&|pixel| self.level[pixel]);
        for channel in 0..3 {
            let values = means(&|pixel| self.color[pixel][channel]);
            small.color.iter_mut().zip(values).for_each(|(pixel, value)| pixel[channel] = value);
        }
        for channel in 0..self.channels {
            let values = means(&|pixel| self.accumulated[pixel * self.channels + channel]);
            for (pixel, value) in small.accumulated.chunks_exact_mut(self.channels).zip(values) {
                pixel[channel] = value;
            }
        }
        small
    }
}
