//! A field's values at points of the world.

use super::depth::{optical_depth, optical_depths};
use super::field::SampleLevels;
use super::view::View;
use crate::model::activate::lanes;
use crate::model::anisotropy::ANISOTROPY;
use crate::model::directional::{DIRECTIONAL, color_from};
use crate::model::grid::Bounds;
use crate::model::harmonics::{BAND_0, FUNCTIONS, Harmonics};
use crate::model::scene::ColorDomain;
use crate::model::view_dependence::ViewDependence;

/// A field's activated values at a point of one level.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Sample {
    /// Opacity over one interval, 0 to 1.
    pub opacity: f32,
    /// Optical depth per world unit, from 0.
    pub density: f32,
    /// Diffuse colour in the colour space of training: 0 to 1 for logits. For harmonics, the colour
    /// of band 0; for a model with rules of its own, the colour seen from above, along -z.
    pub color: [f32; 3],
    /// Specular features, 0 to 1, as input of the view network; empty without one.
    pub features: Vec<f32>,
    /// Directional brightness: its dot product with a unit direction is added to the logits of
    /// `color`. Zero where the level has none.
    pub directional: [f32; 3],
    /// All coefficients of harmonics, ordered by function, then red, green, blue; empty without
    /// harmonics.
    pub coefficients: Vec<f32>,
}

impl Sample {
    /// A sample without features and with a direction-independent colour.
    pub fn plain(opacity: f32, density: f32, color: [f32; 3]) -> Self {
        let (features, coefficients) = (Vec::new(), Vec::new());
        let directional = [0.0; DIRECTIONAL];
        Self { opacity, density, color, features, directional, coefficients }
    }

    /// The diffuse colour along a unit `direction`.
    pub fn diffuse_from(&self, direction: [f64; 3]) -> [f32; 3] {
        color_from(self.color, self.directional, direction)
    }

    /// Diffuse colour along a unit `direction`, and features: the input of the view network.
    pub fn values_from(&self, direction: [f64; 3]) -> Vec<f32> {
        [&self.diffuse_from(direction)[..], &self.features].concat()
    }
}

/// The world position of a place in shares of the box.
pub fn world_of(view: &View, share: [f64; 3]) -> [f64; 3] {
    let extent = view.bounds.extent();
    [0, 1, 2].map(|axis| f64::from(view.bounds.min[axis]) + share[axis] * extent[axis])
}

/// True for a place where samples count: inside the mask and the sampled part of the box.
pub fn is_sampled(view: &View, world: [f64; 3], share: [f64; 3]) -> bool {
    let sampled = share.iter().zip(view.march.sampled_shares(&view.bounds));
    let inside = sampled.into_iter().all(|(at, [low, high])| (low..=high).contains(at));
    inside && view.keeps_at(world, share)
}

/// Optical depth over one interval at a place in shares of the box.
pub fn depth<const C: usize>(
    view: &View,
    values: &impl SampleLevels<C>,
    share: [f64; 3],
    level: usize,
) -> f32 {
    let number = view.box_at(share);
    let part = values.part(level.max(number), number);
    // A level without density has level 0's.
    let owner = if values.density_level(part) { part } else { 0 };
    values.locate(owner, share).map_or(0.0, |cell| {
        let density = values.density(owner, &cell, &[0.0; ANISOTROPY]);
        values.depth_scale(owner) * optical_depth(density, values.density_domain(owner), view)
    })
}

/// As [`depth`], at many places: activations are computed several at once.
pub fn depths<const C: usize>(
    view: &View,
    values: &impl SampleLevels<C>,
    shares: &[[f64; 3]],
    level: usize,
) -> Vec<f32> {
    if !view.boxes.is_empty() {
        // Each box has its own level, and its own meaning of densities.
        return shares.iter().map(|&share| depth(view, values, share, level)).collect();
    }
    let part = values.part(level, 0);
    let owner = if values.density_level(part) { part } else { 0 };
    let mut stored = Vec::with_capacity(shares.len());
    let densities = shares.iter().map(|&share| {
        let cell = values.locate(owner, share);
        stored.push(cell.is_some());
        cell.map_or(0.0, |cell| values.density(owner, &cell, &[0.0; ANISOTROPY]))
    });
    let mut depths: Vec<f32> = densities.collect();
    optical_depths(&mut depths, values.density_domain(owner), view);
    let scale = values.depth_scale(owner);
    for (depth, stored) in depths.iter_mut().zip(stored) {
        *depth = if stored { scale * *depth } else { 0.0 };
    }
    depths
}

/// The values at a position and its place in shares of the box, interpolated in one level.
pub fn sample_at<const C: usize>(
    view: &View,
    values: &impl SampleLevels<C>,
    (world, share): ([f64; 3], [f64; 3]),
    level: usize,
) -> Sample {
    let inside = is_sampled(view, world, share);
    let depth = if inside { depth(view, values, share, level) } else { 0.0 };
    let number = view.box_at(share);
    let level = values.part(level.max(number), number);
    let cell = |level| if inside { values.locate(level, share) } else { None };
    let mut values =
        cell(level).map_or_else(|| values.empty_color(level), |cell| values.color(level, &cell));
    let channels = 3 + view.features;
    let harmonics = view.view_dependence.as_ref().and_then(ViewDependence::harmonics);
    let coefficients = harmonics.map_or_else(Vec::new, |_| values[..channels].to_vec());
    let directional = if view.directional { brightness(&values) } else { [0.0; DIRECTIONAL] };
    match (harmonics, view.color_domain) {
        (Some(rules), _) => {
            let band_0 = Harmonics { degree: 0, ..*rules };
            let color = band_0.color(&[BAND_0; FUNCTIONS], &values[..3]);
            values[..3].copy_from_slice(&color);
        }
        (None, ColorDomain::Linear) => {}
        (None, ColorDomain::Logit) => values = values.map(lanes::sigmoid),
    }
    let features = if harmonics.is_some() { &[] } else { &values[3..channels] };
    let interval_world = view.march.stepsize * view.march.voxel_size;
    Sample {
        opacity: lanes::opacity(depth),
        density: depth / interval_world,
        color: [values[0], values[1], values[2]],
        features: features.to_vec(),
        directional,
        coefficients,
    }
}

/// A position this close to a face, in shares of the box, lies on it: corners are float32, while
/// the caller's may be float64.
const ROUNDING: f64 = 1e-6;

/// A position, snapped to faces that it lies on except for rounding.
pub fn on_faces(mut position: [f64; 3], bounds: &Bounds) -> [f64; 3] {
    let faces = bounds.min.into_iter().zip(bounds.max).map(|(min, max)| [min, max].map(f64::from));
    for (at, [min, max]) in position.iter_mut().zip(faces) {
        for face in [min, max] {
            let near = ROUNDING * (max - min) + f64::from(f32::EPSILON) * face.abs();
            if (*at - face).abs() <= near {
                *at = face;
            }
        }
    }
    position
}

/// Directional brightness, in the last lanes.
#[inline(always)]
pub fn brightness<const C: usize>(values: &[f32; C]) -> [f32; DIRECTIONAL] {
    std::array::from_fn(|part| values[C - DIRECTIONAL + part])
}
