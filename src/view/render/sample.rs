//! A field's values at points of the world.

use super::color_rule::brightness;
use super::packet::optical_depth;
use super::renderer::{Content, Renderer, with_values};
use super::view::View;
use crate::base::error::{Error, Result};
use crate::model::activate::lanes;
use crate::model::anisotropy::ANISOTROPY;
use crate::model::directional::{DIRECTIONAL, color_from};
use crate::model::field::ColorDomain;
use crate::model::grid::Bounds;
use crate::model::harmonics::{BAND_0, Basis, FUNCTIONS, Harmonics, basis};
use crate::model::trained_model::TrainedModel;
use crate::model::view_dependence::ViewDependence;
use crate::model::view_mlp::RAYS;
use crate::view::sample::{Macro, Sample as Values};

/// Voxels before a point that are searched for what hides it.
const BEFORE: u32 = 4;
/// A point that is seen less than this from everywhere lies inside a solid.
const HIDDEN: f64 = 1e-3;
/// Directions with less than this share of the freest one's light do not count.
const FAINTEST: f64 = 1e-2;

/// A field's activated values at a point of one level.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Sample {
    /// Opacity over one interval, 0 to 1.
    pub opacity: f32,
    /// Optical depth per world unit, from 0.
    pub density: f32,
    /// Diffuse colour in the colour space of training: 0 to 1 for logits. Of harmonics, that of
    /// band 0 alone; of a model with rules of its own, that seen from above, along -z.
    pub color: [f32; 3],
    /// Specular features, 0 to 1, as the view network takes them; empty without one.
    pub features: Vec<f32>,
    /// Directional brightness: its dot product with a unit direction is added to the logits of
    /// `color`. Zero where the level has none.
    pub directional: [f32; 3],
    /// All coefficients of harmonics, function by function, each red, green and blue; empty without
    /// them.
    pub coefficients: Vec<f32>,
}

impl Sample {
    /// The diffuse colour along a unit `direction`.
    pub(super) fn diffuse_from(&self, direction: [f64; 3]) -> [f32; 3] {
        color_from(self.color, self.directional, direction)
    }

    /// Diffuse colour along a unit `direction`, and features, as the view network takes them.
    pub(super) fn values_from(&self, direction: [f64; 3]) -> Vec<f32> {
        [&self.diffuse_from(direction)[..], &self.features].concat()
    }
}

impl Renderer {
    /// Levels of the field; 0 is the finest.
    pub fn levels(&self) -> usize {
        self.level_count()
    }

    /// Refuses a level that the field does not have.
    pub(super) fn check_level(&self, level: usize) -> Result<()> {
        let levels = self.levels();
        let expected = format!("a level below {levels}");
        Error::require_option(level < levels, "level", level, &expected)
    }

    /// The field's values at a `position` in world units, interpolated in one level. Outside the
    /// box, outside the free-space mask and where nothing is stored, opacity is 0.
    ///
    /// ```
    /// use mipvog_bake::{RadianceField, Renderer};
    ///
    /// let field = RadianceField::builder([4; 3], vec![9.0; 64], vec![0.0; 192]).build()?;
    /// let renderer = Renderer::of_field(&field)?;
    /// let inside = renderer.sample([0.2, 0.0, -0.4], 0)?;
    /// assert_eq!(inside.color, [0.5; 3]);
    /// assert_eq!(renderer.sample([5.0; 3], 0)?.opacity, 0.0, "outside the box");
    /// assert!(renderer.sample([0.0; 3], 1).is_err(), "there is one level");
    /// # Ok::<(), mipvog_bake::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// A level that the field does not have, or a position that is not finite.
    pub fn sample(&self, position: [f64; 3], level: usize) -> Result<Sample> {
        self.check_level(level)?;
        if position.iter().any(|value| !value.is_finite()) {
            let found = format!("{position:?}");
            return Err(Error::invalid_option("position", found, "finite numbers"));
        }
        let bounds = &self.view().bounds;
        let extent = bounds.extent();
        let position = on_faces(position, bounds);
        let share = |axis: usize| (position[axis] - f64::from(bounds.min[axis])) / extent[axis];
        Ok(self.sample_both(position, [0, 1, 2].map(share), level))
    }

    /// As [`Self::sample`], at a place in shares of the box, `0..=1` along each axis, in a level
    /// that the field has.
    pub(crate) fn sample_at(&self, share: [f64; 3], level: usize) -> Sample {
        self.sample_both(world_of(self.view(), share), share, level)
    }

    /// The density alone of [`Self::sample_at`]: optical depth per world unit.
    pub(crate) fn density_at(&self, share: [f64; 3], level: usize) -> f32 {
        let view = self.view();
        let world = world_of(view, share);
        match self.content() {
            Content::Model(model) => model.density(world),
            Content::Values(_) if !is_sampled(view, world, share) => 0.0,
            Content::Values(lanes) => {
                let depth = with_values!(lanes, values => depth(view, values, share, level));
                depth / (view.march.stepsize * view.march.voxel_size)
            }
        }
    }

    fn sample_both(&self, world: [f64; 3], share: [f64; 3], level: usize) -> Sample {
        match self.content() {
            Content::Values(lanes) => {
                with_values!(lanes, values => sample(self.view(), values, (world, share), level))
            }
            Content::Model(model) => of_model(&**model, self.view(), world),
        }
    }

    /// True where no place of a part of the box, given by two corners in shares of it, is visible
    /// in a level; false says nothing.
    pub(crate) fn is_empty(&self, [low, high]: [[f64; 3]; 2], level: usize) -> bool {
        let Content::Values(lanes) = self.content() else { return false };
        with_values!(lanes, values => {
            let skip = values.skip();
            let (low, high) = (skip.place(low), skip.place(high));
            let cells = (low[0]..=high[0]).flat_map(|x| {
                (low[1]..=high[1]).flat_map(move |y| (low[2]..=high[2]).map(move |z| [x, y, z]))
            });
            let owner = if values.density_level(level) { level } else { 0 };
            cells.into_iter().all(|cell| matches!(skip.state([owner; 2], cell), Macro::Empty(_)))
        })
    }

    /// The mean of a place's colours over directions, each limited to 0 to 1; its diffuse colour
    /// where no colour depends on the direction. A direction counts as far as light passes the
    /// nearest density towards the eye: nobody has trained what walls look like from inside.
    /// `share` is a place in shares of the box.
    pub(crate) fn mean_color(
        &self,
        share: [f64; 3],
        level: usize,
        directions: &Directions,
    ) -> [f32; 3] {
        let (mut sum, mut weights) = ([0.0f64; 3], 0.0f64);
        let mut add = |weight: f64, color: [f32; 3]| {
            let shown = color.map(|channel| f64::from(channel.clamp(0.0, 1.0)));
            sum.iter_mut().zip(shown).for_each(|(sum, value)| *sum += weight * value);
            weights += weight;
        };
        let seen = || directions.seen_from(self, share, level);
        let model = match self.content() {
            Content::Model(model) => Some(&**model),
            Content::Values(_) => None,
        };
        if let Some(model) = model {
            let seen = seen();
            let vectors: Vec<[f64; 3]> = seen.iter().map(|&(i, _)| directions.vectors[i]).collect();
            let colors = model.colors(world_of(self.view(), share), &vectors);
            seen.iter().zip(colors).for_each(|(&(_, weight), color)| add(weight, color));
            return sum.map(|sum| (sum / weights) as f32);
        }
        let sample = self.sample_at(share, level);
        match &self.view().view_dependence {
            None if sample.directional == [0.0; DIRECTIONAL] => return sample.color,
            None => {
                for (i, weight) in seen() {
                    add(weight, sample.diffuse_from(directions.vectors[i]));
                }
            }
            Some(ViewDependence::Harmonics(rules)) => {
                for (i, weight) in seen() {
                    add(weight, rules.color(&directions.bases[i], &sample.coefficients));
                }
            }
            Some(ViewDependence::Network(network)) => {
                for seen in seen().chunks(RAYS) {
                    let vectors: Vec<[f64; 3]> =
                        seen.iter().map(|&(i, _)| directions.vectors[i]).collect();
                    let values: Vec<Vec<f32>> =
                        vectors.iter().map(|&v| sample.values_from(v)).collect();
                    let values: Vec<&[f32]> = values.iter().map(|values| &values[..]).collect();
                    let added = network.colors(&vectors, &values);
                    for ((&(_, weight), added), vector) in seen.iter().zip(added).zip(vectors) {
                        let diffuse = sample.diffuse_from(vector);
                        add(weight, [0, 1, 2].map(|channel| diffuse[channel] + added[channel]));
                    }
                }
            }
        }
        sum.map(|sum| (sum / weights) as f32)
    }

    /// True if colours of a point come from a network, which takes time.
    pub(crate) fn has_network(&self) -> bool {
        let view = &self.view().view_dependence;
        view.as_ref().is_some_and(|view| view.network().is_some())
    }
}

/// Unit directions spread evenly over the sphere, and the harmonics of each.
#[derive(Debug)]
pub(crate) struct Directions {
    vectors: Vec<[f64; 3]>,
    bases: Vec<Basis>,
}

impl Directions {
    /// So many, on a spiral of equal steps in height and turns of the golden angle.
    pub(crate) fn spread(count: usize) -> Self {
        let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
        let vectors: Vec<[f64; 3]> = (0..count)
            .map(|i| {
                let height = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
                let radius = (1.0 - height * height).max(0.0).sqrt();
                let (sine, cosine) = libm::sincos(golden * i as f64);
                [radius * cosine, radius * sine, height]
            })
            .collect();
        let bases = vectors.iter().map(|&vector| basis(vector)).collect();
        Self { vectors, bases }
    }

    /// The directions along which a place is seen, by their numbers, and the share of light that
    /// passes what is before it. All of them count the same where none is free.
    fn seen_from(&self, field: &Renderer, share: [f64; 3], level: usize) -> Vec<(usize, f64)> {
        let extent = field.view().bounds.extent();
        let step = f64::from(field.view().march.voxel_size);
        let seen = self.vectors.iter().enumerate().map(|(number, vector)| {
            let depth = (1..=BEFORE).map(|steps| {
                let back = f64::from(steps) * step;
                let at = [0, 1, 2].map(|axis| share[axis] - back * vector[axis] / extent[axis]);
                f64::from(field.density_at(at, level)) * step
            });
            (number, libm::exp(-depth.sum::<f64>()))
        });
        let seen: Vec<(usize, f64)> = seen.collect();
        let most = seen.iter().fold(0.0, |most: f64, (_, weight)| most.max(*weight));
        if most < HIDDEN {
            return seen.into_iter().map(|(number, _)| (number, 1.0)).collect();
        }
        seen.into_iter().filter(|(_, weight)| *weight > FAINTEST * most).collect()
    }
}

/// Of a model that is evaluated by its own rules.
fn of_model(model: &dyn TrainedModel, view: &View, position: [f64; 3]) -> Sample {
    let density = model.density(position);
    let seen = model.colors(position, &[[0.0, 0.0, -1.0]]);
    Sample {
        opacity: lanes::opacity(density * view.march.stepsize * view.march.voxel_size),
        density,
        color: seen.first().copied().unwrap_or_default(),
        features: Vec::new(),
        directional: [0.0; DIRECTIONAL],
        coefficients: Vec::new(),
    }
}

/// The world position of a place in shares of the box.
fn world_of(view: &View, share: [f64; 3]) -> [f64; 3] {
    let extent = view.bounds.extent();
    [0, 1, 2].map(|axis| f64::from(view.bounds.min[axis]) + share[axis] * extent[axis])
}

/// True for a place in which samples count: free, and in the part of the box that is sampled.
fn is_sampled(view: &View, world: [f64; 3], share: [f64; 3]) -> bool {
    let sampled = share.iter().zip(view.march.sampled_shares(&view.bounds));
    let inside = sampled.into_iter().all(|(at, [low, high])| (low..=high).contains(at));
    inside && view.free_space.as_ref().is_none_or(|mask| mask.contains(world))
}

/// Optical depth over one interval at a place in shares of the box.
fn depth<const C: usize>(
    view: &View,
    values: &impl Values<C>,
    share: [f64; 3],
    level: usize,
) -> f32 {
    // A level without density has level 0's.
    let owner = if values.density_level(level) { level } else { 0 };
    values.locate(owner, share).map_or(0.0, |cell| {
        let density = values.density(owner, &cell, &[0.0; ANISOTROPY]);
        optical_depth(density, values.density_domain(owner), view)
    })
}

fn sample<const C: usize>(
    view: &View,
    values: &impl Values<C>,
    (world, share): ([f64; 3], [f64; 3]),
    level: usize,
) -> Sample {
    let inside = is_sampled(view, world, share);
    let cell = |level| if inside { values.locate(level, share) } else { None };
    let depth = if inside { depth(view, values, share, level) } else { 0.0 };
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

/// A position this near to a face, in shares of the box, lies on it: corners are float32, and the
/// caller's own, on whose faces nodes lie, may be float64.
const ROUNDING: f64 = 1e-6;

/// A position, moved to each face that it is on but for rounding.
pub(super) fn on_faces(mut position: [f64; 3], bounds: &Bounds) -> [f64; 3] {
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
