//! The renderer's reference implementation: one pixel at a time as `formats/mipvog.md`, section 6,
//! says it, in float64 over dense arrays. It visits every sample of every ray and skips nothing.

use mipvog::model::baked::{Blend, DensityDomain, FootprintNeighbour, StepRule};
use mipvog::model::camera::Camera;
use mipvog::model::field::{ActivationOrder, ColorDomain, FreeSpace, Lookup};
use mipvog::model::harmonics::{Evaluation, basis_f64};
use mipvog::model::view_dependence::ViewDependence;
use mipvog::view::render::{LevelChoice, View};

use super::plain::{density, index, sigmoid, trilinear};
use super::plain_shade::{blended, is_close, length, limit, specular};

/// A sample this close to a face of the box, in shares of the box, lies on it.
const ON_FACE: f64 = 1e-9;

/// One level's arrays, z fastest.
pub struct PlainLevel {
    pub nodes: [usize; 3],
    /// Density; none where level 0's counts.
    pub density: Option<Vec<f64>>,
    /// Meaning of densities.
    pub domain: DensityDomain,
    /// Anisotropy of densities, a list for each channel; empty without.
    pub anisotropy: Vec<Vec<f64>>,
    /// Raw colour and features, a list for each channel.
    pub color: Vec<Vec<f64>>,
    /// The blocks that are not stored; none if all are.
    pub pruned: Option<Pruned>,
}

/// Blocks without a frame, and their values.
pub struct Pruned {
    /// For each node, whether its block is stored.
    pub stored: Vec<bool>,
    /// Density, of a level that has one.
    pub density: f64,
    /// Raw values of all channels.
    pub color: Vec<f64>,
}

/// A field as the reference renders it.
pub struct PlainField {
    view: View,
    levels: Vec<PlainLevel>,
    /// Values of a free-space mask that is interpolated.
    mask_values: Vec<f64>,
}

/// The values of a pixel.
pub struct Pixel {
    pub color: [f64; 3],
    pub transmittance: f64,
    pub distance: f64,
    pub level: f64,
    pub accumulated: Vec<f64>,
    /// Largest move of values because samples lie on a threshold: to either side is right.
    pub doubt: f64,
}

/// Sample `k` lies at `origin + direction * (entry + k * step)`.
struct PlainRay {
    origin: [f64; 3],
    direction: [f64; 3],
    entry: f64,
    step: f64,
    /// Intervals in a step.
    intervals: f64,
}

impl PlainRay {
    fn at(&self, t: f64) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.origin[axis] + self.direction[axis] * t)
    }

    fn length(&self) -> f64 {
        length(self.direction)
    }
}

impl PlainField {
    pub fn new(view: &View, mut levels: Vec<PlainLevel>) -> Self {
        // Interpolation is of raw density, density or opacity.
        let interval = f64::from(view.activation.interval);
        let density = |value: f64| density(value, &view.activation);
        let activate = |value: &mut f64| match view.activation.order {
            ActivationOrder::Raw => {}
            ActivationOrder::Density => *value = density(*value),
            ActivationOrder::Opacity => *value = -(-density(*value) * interval).exp_m1(),
        };
        for level in levels.iter_mut().filter(|level| level.domain == DensityDomain::Raw) {
            level.density.iter_mut().flatten().for_each(activate);
            level.pruned.iter_mut().for_each(|pruned| activate(&mut pruned.density));
        }
        let mask_values = match view.free_space.as_ref().map(|mask| &mask.lookup) {
            Some(Lookup::Trilinear { values, .. }) => values.iter().map(|&v| v.into()).collect(),
            _ => Vec::new(),
        };
        Self { view: view.clone(), levels, mask_values }
    }

    /// One pixel, looked at through its centre.
    pub fn pixel(&self, camera: &Camera, [x, y]: [usize; 2], choice: LevelChoice) -> Pixel {
        let march = &self.view.march;
        let center = [x as f64 + 0.5, y as f64 + 0.5];
        let ray = self.ray(camera, center);
        let aside = [[0.5, 0.0], [0.0, 0.5]]
            .map(|[by_x, by_y]| self.ray(camera, [center[0] + by_x, center[1] + by_y]));
        let mut accumulated = vec![0.0; 3 + self.view.features];
        let (mut left, mut distance, mut mean_level, mut doubt) = (1.0, 0.0, 0.0, 0.0);
        let unit = ray.direction.map(|along| along / ray.length());
        let mut counted = 0.0;
        let diagonal = length(self.view.nodes.0.map(|size| (size + 1) as f64));
        let max_samples = (diagonal / f64::from(march.stepsize)).floor();
        let (mut next, mut entered) = (0.0, false);
        while next <= max_samples {
            let k = next;
            let t = ray.entry + k * ray.step;
            let lambda = match (choice, &self.view.level_of_detail) {
                (LevelChoice::Fixed(level), _) => level.min(self.levels.len() - 1) as f64,
                (LevelChoice::Auto, None) => 0.0,
                (LevelChoice::Auto, Some(_)) => self.lambda(&ray, &aside, k),
            };
            let inside = self.in_box(ray.at(t));
            entered |= inside.is_some();
            let steps = match self.view.step_rule {
                StepRule::LevelOfDetail if entered => lambda.exp2(),
                _ => 1.0,
            };
            next += steps;
            let intervals = steps * ray.intervals;
            let Some(position) = inside else { continue };
            if self.view.free_space.as_ref().is_some_and(|mask| !self.keeps(mask, ray.at(t))) {
                continue;
            }
            let Some(depth) = self.optical_depth(lambda, position, unit) else { continue };
            let alpha = -(-depth * intervals).exp_m1();
            let threshold = f64::from(march.alpha_threshold);
            if is_close(alpha, threshold) {
                // Its own light, and the share of light that it takes from all behind it.
                doubt += 2.0 * alpha * left;
            }
            if alpha <= threshold {
                continue;
            }
            let weight = alpha * left;
            left *= 1.0 - alpha;
            distance += weight * t * ray.length();
            mean_level += weight * lambda;
            let threshold = f64::from(march.color_threshold);
            if is_close(weight, threshold) {
                doubt += weight;
            }
            if weight > threshold {
                counted += weight;
                let color = self.color(lambda, position, unit);
                accumulated.iter_mut().zip(color).for_each(|(sum, color)| *sum += weight * color);
            }
        }
        if let Some(ViewDependence::Harmonics(rules)) = &self.view.view_dependence
            && rules.evaluation == Evaluation::Ray
        {
            let offset = f64::from(rules.offset) * counted;
            accumulated[..3].iter_mut().for_each(|sum| *sum = limit(rules.clamp, *sum + offset));
        }
        let network = self.view.view_dependence.as_ref().and_then(ViewDependence::network);
        let specular = network.map_or([0.0; 3], |network| specular(network, unit, &accumulated));
        let color = [0, 1, 2]
            .map(|c| accumulated[c] + specular[c] + left * f64::from(self.view.background[c]));
        distance += left * march.far.map_or(0.0, f64::from);
        Pixel { color, transmittance: left, distance, level: mean_level, accumulated, doubt }
    }

    /// Positions and weights of level 0's samples on the ray through a point of a picture.
    pub fn weights(&self, camera: &Camera, point: [f64; 2]) -> Vec<([f64; 3], f64)> {
        let ray = self.ray(camera, point);
        let unit = ray.direction.map(|along| along / ray.length());
        let diagonal = length(self.view.nodes.0.map(|size| (size + 1) as f64));
        let max_samples = (diagonal / f64::from(self.view.march.stepsize)).floor() as usize;
        let (mut left, mut weights) = (1.0, Vec::new());
        for k in 0..=max_samples {
            let at = ray.at(ray.entry + k as f64 * ray.step);
            let Some(position) = self.in_box(at) else { continue };
            let depth = self.optical_depth(0.0, position, unit).unwrap_or(0.0);
            let alpha = -(-depth * ray.intervals).exp_m1();
            if alpha > f64::from(self.view.march.alpha_threshold) {
                weights.push((position, alpha * left));
                left *= 1.0 - alpha;
            }
        }
        weights
    }

    fn ray(&self, camera: &Camera, [x, y]: [f64; 2]) -> PlainRay {
        let (lens, march) = (&camera.lens, &self.view.march);
        let local =
            [(x - lens.center[0]) / lens.focal[0], -(y - lens.center[1]) / lens.focal[1], -1.0];
        let columns = camera.to_world.to_cols_array_2d();
        let direction = [0, 1, 2]
            .map(|row| (0..3).map(|column| columns[column][row] * local[column]).sum::<f64>());
        let origin = [0, 1, 2].map(|row| columns[3][row]);
        let mut entry = f64::NEG_INFINITY;
        for axis in 0..3 {
            // A ray along a face is within it from the start.
            if direction[axis] == 0.0 {
                continue;
            }
            let sampled = march.sampled.unwrap_or(self.view.bounds);
            let faces = [sampled.min[axis], sampled.max[axis]];
            let [a, b] = faces.map(|face| (f64::from(face) - origin[axis]) / direction[axis]);
            entry = entry.max(a.min(b));
        }
        let far = march.far.map_or(f64::INFINITY, f64::from);
        // Voxels that a unit of `t` is long.
        let voxels = match march.voxel {
            Some(edges) => length([0, 1, 2].map(|axis| direction[axis] / f64::from(edges[axis]))),
            None => length(direction) / f64::from(march.voxel_size),
        };
        let step = f64::from(march.stepsize) / voxels;
        let interval = f64::from(march.stepsize) * f64::from(march.voxel_size);
        let intervals = step * length(direction) / interval;
        let entry = entry.max(march.near.into()).min(far);
        PlainRay { origin, direction, entry, step, intervals }
    }

    /// A position as shares of the box; none outside.
    fn in_box(&self, world: [f64; 3]) -> Option<[f64; 3]> {
        let (bounds, extent) = (&self.view.bounds, self.view.bounds.extent());
        let share = [0, 1, 2].map(|a| (world[a] - f64::from(bounds.min[a])) / extent[a]);
        let sampled = self.view.march.sampled.unwrap_or(*bounds);
        let inside = (0..3).all(|axis| {
            let [low, high] = [sampled.min[axis], sampled.max[axis]]
                .map(|at| (f64::from(at) - f64::from(bounds.min[axis])) / extent[axis]);
            (low - ON_FACE..=high + ON_FACE).contains(&share[axis])
        });
        inside.then(|| share.map(|share| share.clamp(0.0, 1.0)))
    }

    /// True if the free-space mask keeps a sample.
    fn keeps(&self, mask: &FreeSpace, world: [f64; 3]) -> bool {
        let nodes = mask.nodes.0;
        let at = [0, 1, 2].map(|axis| world[axis] * mask.scale[axis] + mask.shift[axis]);
        let within = |at: [f64; 3]| (0..3).all(|a| at[a] >= 0.0 && at[a] <= (nodes[a] - 1) as f64);
        match &mask.lookup {
            Lookup::Nearest(inside) => {
                let nearest = at.map(f64::round_ties_even);
                within(nearest) && inside[index(nodes, nearest.map(|at| at as usize))]
            }
            Lookup::Trilinear { threshold, .. } => {
                within(at) && trilinear(nodes, &self.mask_values, at) >= f64::from(*threshold)
            }
        }
    }

    /// Level of detail of sample `k`.
    fn lambda(&self, ray: &PlainRay, aside: &[PlainRay; 2], k: f64) -> f64 {
        let Some(rule) = &self.view.level_of_detail else { return 0.0 };
        let extent = self.view.bounds.extent();
        let t = |ray: &PlainRay| ray.entry + k * ray.step;
        let here = ray.at(t(ray));
        let rho = aside.each_ref().map(|other| {
            let there = match rule.neighbour {
                FootprintNeighbour::SameIndex => other.at(t(other)),
                FootprintNeighbour::SameDistance => other.at(t(ray)),
            };
            let voxels = |a: usize| (there[a] - here[a]) / extent[a] * self.view.nodes.0[a] as f64;
            length([0, 1, 2].map(voxels)) / 0.5
        });
        let rho = f64::max(rho[0], rho[1]);
        let last = (self.levels.len() - 1) as f64;
        let last = rule.bound.map_or(last, |bound| last.min(bound.into()));
        match rho > 0.0 {
            true => {
                let line = f64::from(rule.factor) * rho.log2() + f64::from(rule.bias);
                let bends = rule.bends.as_slice().iter().map(|bend| bend.map(f64::from));
                let bent: f64 = bends.map(|[at, by]| by * (rho.log2() - at).max(0.0)).sum();
                (line + bent).clamp(0.0, last)
            }
            false => 0.0,
        }
    }

    /// Optical depth of a sample over one interval; none where all that it reads is empty.
    fn optical_depth(&self, lambda: f64, position: [f64; 3], unit: [f64; 3]) -> Option<f64> {
        // The functions of band 2.
        let along = &basis_f64(unit)[4..9];
        let owner = |level: usize| match self.levels[level].density {
            Some(_) => level,
            None => 0,
        };
        let mut anything = false;
        let mut value = |level: usize| {
            let level = &self.levels[owner(level)];
            anything |= level.is_stored(position);
            let density = level.density.as_deref().expect("level 0 has density");
            let mean =
                level.value(density, level.pruned.as_ref().map(|pruned| pruned.density), position);
            if level.anisotropy.is_empty() {
                return mean;
            }
            let empty = level.pruned.as_ref().map(|_| 0.0);
            let of = |channel: &Vec<f64>| level.value(channel, empty, position);
            let added = level.anisotropy.iter().map(of).zip(along).map(|(a, y)| a * y);
            (mean + added.sum::<f64>()).max(0.0)
        };
        let decode = |level: usize, value: f64| self.decoded(self.levels[level].domain, value);
        let depth = match self.view.blend {
            Blend::BeforeActivation => decode(0, blended(lambda, value)),
            Blend::AfterActivation => blended(lambda, |level| decode(level, value(level))),
        };
        anything.then_some(depth)
    }

    /// Optical depth over one interval of an interpolated value.
    fn decoded(&self, decode: DensityDomain, value: f64) -> f64 {
        let activation = &self.view.activation;
        let interval = f64::from(activation.interval);
        let depth = |alpha: f64| -(-alpha.clamp(0.0, 1.0 - f64::from(f32::EPSILON))).ln_1p();
        match (decode, activation.order) {
            (DensityDomain::SqrtOpticalDepth, _) => value * value,
            (DensityDomain::Opacity, _) | (_, ActivationOrder::Opacity) => depth(value),
            (_, ActivationOrder::Raw) => density(value, activation) * interval,
            (_, ActivationOrder::Density) => value * interval,
        }
    }

    /// Activated colours and features, seen along a unit direction.
    fn color(&self, lambda: f64, position: [f64; 3], unit: [f64; 3]) -> Vec<f64> {
        let channels = 3 + self.view.features;
        let stored = channels + if self.view.directional { 3 } else { 0 };
        let values = |level: usize| -> Vec<f64> {
            let level = &self.levels[level];
            let value = |channel: usize| {
                let empty = level.pruned.as_ref().map(|pruned| pruned.color[channel]);
                level.value(&level.color[channel], empty, position)
            };
            (0..stored).map(value).collect()
        };
        let mixed = |value: &dyn Fn(usize) -> Vec<f64>| -> Vec<f64> {
            (0..channels).map(|channel| blended(lambda, |level| value(level)[channel])).collect()
        };
        match self.view.blend {
            Blend::BeforeActivation => self.activated(mixed(&values), unit),
            Blend::AfterActivation => mixed(&|level| self.activated(values(level), unit)),
        }
    }

    /// Colours and features of interpolated values.
    fn activated(&self, values: Vec<f64>, unit: [f64; 3]) -> Vec<f64> {
        match (&self.view.view_dependence, self.view.color_domain) {
            (Some(ViewDependence::Harmonics(rules)), _) => {
                let basis = basis_f64(unit);
                let sum = |channel: usize| -> f64 {
                    let functions = 0..(rules.degree + 1).pow(2);
                    functions.map(|number| basis[number] * values[3 * number + channel]).sum()
                };
                let color = |channel: usize| match rules.evaluation {
                    Evaluation::Ray => sum(channel),
                    Evaluation::Sample => {
                        limit(rules.clamp, sum(channel) + f64::from(rules.offset))
                    }
                };
                let rest = vec![0.0; values.len() - 3];
                [(0..3).map(color).collect(), rest].concat()
            }
            (_, ColorDomain::Linear) => values,
            (_, ColorDomain::Logit) => {
                let (own, brightness) = values.split_at(3 + self.view.features);
                let added: f64 = unit.iter().zip(brightness).map(|(along, b)| along * b).sum();
                let logit = |(channel, value)| if channel < 3 { value + added } else { value };
                own.iter().copied().enumerate().map(logit).map(sigmoid).collect()
            }
        }
    }
}

impl PlainLevel {
    /// The same position in index space.
    fn node_position(&self, position: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| position[axis] * (self.nodes[axis] - 1) as f64)
    }

    /// True if the block of the cell's lowest node is stored.
    fn is_stored(&self, position: [f64; 3]) -> bool {
        let u = self.node_position(position);
        let low = [0, 1, 2].map(|axis| (u[axis] as usize).min(self.nodes[axis] - 2));
        let stored = |pruned: &Pruned| pruned.stored[index(self.nodes, low)];
        self.pruned.as_ref().is_none_or(stored)
    }

    fn value(&self, values: &[f64], empty: Option<f64>, position: [f64; 3]) -> f64 {
        match empty.filter(|_| !self.is_stored(position)) {
            Some(empty) => empty,
            None => trilinear(self.nodes, values, self.node_position(position)),
        }
    }
}
