//! A renderer's values at points of the world.

use super::renderer::{Content, Renderer, with_values};
use crate::base::error::Result;
use crate::model::activate::lanes;
use crate::model::directional::DIRECTIONAL;
use crate::model::harmonics::{Basis, basis};
use crate::model::trained_model::TrainedModel;
use crate::model::view_dependence::ViewDependence;
use crate::model::view_mlp::RAYS;
use crate::view::sample::{
    Macro, Sample, SampleLevels as _, View, check_level, depth, depths, is_sampled, sample_at,
    world_of,
};

/// Number of voxels in front of a point that are searched for occluders.
const BEFORE: usize = 4;
/// A point that gets less light than this from every direction lies inside a solid.
const HIDDEN: f64 = 1e-3;
/// Directions with less than this share of the brightest one's light do not count.
const FAINTEST: f64 = 1e-2;
/// Optical depth in front of a point above which a direction never counts: `exp(-12)` is below the
/// product of the two shares above.
const BLOCKED: f64 = 12.0;

impl Renderer {
    /// Number of levels of the field.
    pub fn levels(&self) -> usize {
        self.level_count()
    }

    /// Refuses a level that the field does not have.
    pub(super) fn check_level(&self, level: usize) -> Result<()> {
        check_level(level, self.levels())
    }

    /// The field's values at a `position` in world units, interpolated in one level. Opacity is 0
    /// outside the box, outside the free-space mask and in empty blocks.
    ///
    /// ```
    /// use mipvog::{RadianceField, Renderer};
    ///
    /// let field = RadianceField::builder([4; 3], vec![9.0; 64], vec![0.0; 192]).build()?;
    /// let renderer = Renderer::of_field(&field)?;
    /// let inside = renderer.sample([0.2, 0.0, -0.4], 0)?;
    /// assert_eq!(inside.color, [0.5; 3]);
    /// assert_eq!(renderer.sample([5.0; 3], 0)?.opacity, 0.0, "outside the box");
    /// assert!(renderer.sample([0.0; 3], 1).is_err(), "there is one level");
    /// # Ok::<(), mipvog::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// A level that the field does not have, or a position that is not finite.
    pub fn sample(&self, position: [f64; 3], level: usize) -> Result<Sample> {
        self.check_level(level)?;
        let (world, share) = self.view().places(position)?;
        Ok(self.sample_both(world, share, level))
    }

    /// As [`Self::sample`], at a position given as fractions of the box, `0..=1` along each axis.
    /// The level must exist.
    pub fn sample_at(&self, share: [f64; 3], level: usize) -> Sample {
        self.sample_both(world_of(self.view(), share), share, level)
    }

    /// Only the density of [`Self::sample_at`]: optical depth per world unit.
    pub fn density_at(&self, share: [f64; 3], level: usize) -> f32 {
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

    /// As [`Self::density_at`], at many positions.
    pub fn densities_at(&self, shares: &[[f64; 3]], level: usize) -> Vec<f32> {
        let view = self.view();
        let Content::Values(lanes) = self.content() else {
            return shares.iter().map(|&share| self.density_at(share, level)).collect();
        };
        let mut densities = with_values!(lanes, values => depths(view, values, shares, level));
        let interval = view.march.stepsize * view.march.voxel_size;
        for (density, &share) in densities.iter_mut().zip(shares) {
            let counts = is_sampled(view, world_of(view, share), share);
            *density = if counts { *density / interval } else { 0.0 };
        }
        densities
    }

    fn sample_both(&self, world: [f64; 3], share: [f64; 3], level: usize) -> Sample {
        match self.content() {
            Content::Values(lanes) => {
                with_values!(lanes, values => sample_at(self.view(), values, (world, share), level))
            }
            Content::Model(model) => of_model(&**model, self.view(), world),
        }
    }

    /// True if nothing is visible in a level between two corners, given as fractions of the box.
    /// False proves nothing.
    pub fn is_empty(&self, [low, high]: [[f64; 3]; 2], level: usize) -> bool {
        let (view, Content::Values(lanes)) = (self.view(), self.content()) else { return false };
        with_values!(lanes, values => {
            let number = view.box_at(low);
            if view.box_at(high) != number {
                return false;
            }
            let skip = values.skip(number);
            let [low, high] = match view.boxes.get(number) {
                Some(frame) => [low, high].map(|at| skip.place(frame.place_within(at))),
                None => [low, high].map(|at| skip.place(at)),
            };
            let cells = (low[0]..=high[0]).flat_map(|x| {
                (low[1]..=high[1]).flat_map(move |y| (low[2]..=high[2]).map(move |z| [x, y, z]))
            });
            let owner = if values.density_level(level) { level } else { 0 };
            let owner = owner.max(number) - number;
            cells.into_iter().all(|cell| matches!(skip.state([owner; 2], cell), Macro::Empty(_)))
        })
    }

    /// The mean colour at a point over directions, each colour clamped to 0 to 1. Directions are
    /// weighted by the transmittance towards the eye near the point, because training never saw
    /// walls from inside. The result is the diffuse colour if no colour depends on the direction,
    /// or if the point is hidden from all sides, which saves evaluating a network. `share` is the
    /// position as fractions of the box.
    pub fn mean_color(&self, share: [f64; 3], level: usize, directions: &Directions) -> [f32; 3] {
        self.mean_color_behind(share, level, directions, |number, step| {
            let by = directions.places[number][step];
            self.density_at([0, 1, 2].map(|axis| share[axis] + by[axis]), level)
        })
    }

    /// As [`Self::mean_color`], with densities from the caller: of a direction's number and one of
    /// its [`Directions::places`].
    pub fn mean_color_behind(
        &self,
        share: [f64; 3],
        level: usize,
        directions: &Directions,
        density_at: impl Fn(usize, usize) -> f32,
    ) -> [f32; 3] {
        let (mut sum, mut weights) = ([0.0f64; 3], 0.0f64);
        let mut add = |weight: f64, color: [f32; 3]| {
            let shown = color.map(|channel| f64::from(channel.clamp(0.0, 1.0)));
            sum.iter_mut().zip(shown).for_each(|(sum, value)| *sum += weight * value);
            weights += weight;
        };
        let seen_only = || directions.seen_from(self.view(), &density_at);
        let seen = || {
            let seen = seen_only();
            match seen.is_empty() {
                true => (0..directions.vectors.len()).map(|number| (number, 1.0)).collect(),
                false => seen,
            }
        };
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
                let seen = seen_only();
                if seen.is_empty() {
                    return sample.color;
                }
                let is_plain = sample.directional == [0.0; DIRECTIONAL];
                let packets = directions.vectors.chunks(RAYS).zip(&directions.sums);
                for (first, (vectors, sums)) in (0..).step_by(RAYS).zip(packets) {
                    let seen = seen.iter().filter(|(i, _)| (first..first + RAYS).contains(i));
                    if seen.clone().next().is_none() {
                        continue;
                    }
                    let own = if is_plain { &vectors[..1] } else { vectors };
                    let own: Vec<Vec<f32>> =
                        own.iter().map(|&vector| sample.values_from(vector)).collect();
                    let values: Vec<&[f32]> = own.iter().map(Vec::as_slice).collect();
                    let added = network.colors_of_sums(sums, &values);
                    for &(i, weight) in seen {
                        let (own, added) =
                            (values[if is_plain { 0 } else { i - first }], added[i - first]);
                        add(weight, [0, 1, 2].map(|channel| own[channel] + added[channel]));
                    }
                }
            }
        }
        sum.map(|sum| (sum / weights) as f32)
    }

    /// True if the colours of a point come from a network, which is slow.
    pub fn has_network(&self) -> bool {
        let view = &self.view().view_dependence;
        view.as_ref().is_some_and(|view| view.network().is_some())
    }
}

/// Unit directions spread evenly over the sphere, each with its harmonics and its terms of a
/// field's network.
#[derive(Debug)]
pub struct Directions {
    vectors: Vec<[f64; 3]>,
    bases: Vec<Basis>,
    /// Of each packet of directions; empty without a network.
    sums: Vec<Vec<[f32; RAYS]>>,
    /// By direction, steps to the places in front of a point where occluders are searched, nearest
    /// first, as fractions of the box.
    places: Vec<[[f64; 3]; BEFORE]>,
}

impl Directions {
    /// `count` directions for a field, on a spiral with equal height steps and turns of the golden
    /// angle.
    pub fn spread(field: &Renderer, count: usize) -> Self {
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
        let network = field.view().view_dependence.as_ref().and_then(ViewDependence::network);
        let sums = network.map_or_else(Vec::new, |network| {
            vectors.chunks(RAYS).map(|packet| network.direction_sums(packet)).collect()
        });
        let (extent, step) = (field.view().bounds.extent(), field.view().march.voxel_size);
        let places = vectors.iter().map(|vector| {
            std::array::from_fn(|number| {
                let back = (number + 1) as f64 * f64::from(step);
                [0, 1, 2].map(|axis| -back * vector[axis] / extent[axis])
            })
        });
        let places = places.collect();
        Self { vectors, bases, sums, places }
    }

    /// By direction, steps from a point to the places where occluders are searched, nearest first,
    /// as fractions of the box.
    pub fn places(&self) -> &[[[f64; 3]; BEFORE]] {
        &self.places
    }

    /// The indices of the directions from which a point is visible, with their transmittances.
    /// Empty if all directions are blocked.
    fn seen_from(
        &self,
        view: &View,
        density_at: impl Fn(usize, usize) -> f32,
    ) -> Vec<(usize, f64)> {
        let step = f64::from(view.march.voxel_size);
        let seen = (0..self.vectors.len()).map(|number| {
            let mut depth = 0.0;
            for place in 0..BEFORE {
                depth += f64::from(density_at(number, place)) * step;
                if depth > BLOCKED {
                    return (number, 0.0);
                }
            }
            (number, f64::from(lanes::exp(-depth as f32)))
        });
        let seen: Vec<(usize, f64)> = seen.collect();
        let most = seen.iter().fold(0.0, |most: f64, (_, weight)| most.max(*weight));
        if most < HIDDEN {
            return Vec::new();
        }
        seen.into_iter().filter(|(_, weight)| *weight > FAINTEST * most).collect()
    }
}

/// The sample of a model with its own rules.
fn of_model(model: &dyn TrainedModel, view: &View, position: [f64; 3]) -> Sample {
    let density = model.density(position);
    let seen = model.colors(position, &[[0.0, 0.0, -1.0]]);
    let opacity = lanes::opacity(density * view.march.stepsize * view.march.voxel_size);
    Sample::plain(opacity, density, seen.first().copied().unwrap_or_default())
}
