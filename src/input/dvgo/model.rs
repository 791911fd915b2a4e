//! DirectVoxGO by the rules of its own renderer.
//!
//! ```text
//! t      = entry of the box (between near and far) + k step, k = 0, 1, ...
//! alpha  = 1 - exp(-softplus(raw + shift) interval), left out at or below the threshold
//! weight = alpha T,  T *= 1 - alpha, and the ray ends below 1e-3
//! colour = sum of weight network(features, direction), where a weight is over the threshold
//! ```

use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::input::network::{Network, NetworkFile};
use crate::model::camera::Ray;
use crate::model::field::{Grid, RadianceField, Volume};
use crate::model::grid::Nodes;
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};

/// Transmittance below which a ray ends.
const ENDS: f64 = 1e-3;
/// Samples no farther beyond a face than this, in nodes, lie on it.
const ON_FACE: f64 = 1e-6;

/// A checkpoint, ready to be loaded.
#[derive(Debug)]
pub(super) struct DvgoFile {
    /// Density, settings and the mask.
    pub(super) field: RadianceField,
    /// All features.
    pub(super) color: Volume,
    pub(super) network: NetworkFile,
}

/// A model in memory.
#[derive(Debug)]
struct Dvgo {
    field: RadianceField,
    density: Vec<f32>,
    /// Node by node.
    features: Vec<f32>,
    width: usize,
    network: Network,
}

impl LoadModel for DvgoFile {
    fn load(&self, limits: &Limits) -> Result<Box<dyn TrainedModel>> {
        let mut budget = Budget::new(limits);
        let network = self.network.load(&mut budget)?;
        let (density, width) = (load(&self.field.density, &mut budget)?, self.color.channels);
        let features = load(&Grid::Array(self.color.clone()), &mut budget)?;
        Ok(Box::new(Dvgo { field: self.field.clone(), density, features, width, network }))
    }
}

/// All values, the channels of a node side by side.
fn load(grid: &Grid, budget: &mut Budget) -> Result<Vec<f32>> {
    let (Nodes([nx, ny, nz]), width) = (grid.nodes(), grid.channels());
    let place = Place::Key("grid".to_owned());
    let count = nx * ny * nz * width;
    let mut values: Vec<f32> = budget.zeroed(count, "bytes of a grid", &place)?;
    let mut plane: Vec<f32> = budget.zeroed(ny * nz, "bytes of a grid", &place)?;
    for channel in 0..width {
        for (x, out) in values.chunks_exact_mut(ny * nz * width).enumerate() {
            grid.read_plane(channel, x, &mut plane, |_| {})?;
            let out = out.iter_mut().skip(channel).step_by(width);
            out.zip(&plane).for_each(|(out, value)| *out = *value);
        }
    }
    Ok(values)
}

impl Dvgo {
    /// A position of the world in nodes.
    fn to_nodes(&self, world: [f64; 3]) -> [f64; 3] {
        let (bounds, nodes) = (&self.field.scene.bounds, self.field.scene.nodes);
        let mut at = world;
        let axes = at.iter_mut().zip(bounds.min).zip(nodes.spacing(bounds));
        axes.for_each(|((at, min), spacing)| *at = (*at - f64::from(min)) / spacing);
        at
    }

    /// Interpolated values of nodes of `width` channels.
    fn interpolate(&self, values: &[f32], width: usize, at: [f64; 3]) -> Vec<f64> {
        let Nodes(counts) = self.field.scene.nodes;
        let mut corners = [[(0, 0.0); 2]; 3];
        for ((corners, at), count) in corners.iter_mut().zip(at).zip(counts) {
            let at = at.clamp(0.0, (count - 1) as f64);
            let low = at.floor();
            #[expect(clippy::cast_possible_truncation, reason = "a node's number")]
            let node = low as usize;
            *corners = [(node, 1.0 - (at - low)), ((node + 1).min(count - 1), at - low)];
        }
        let [xs, ys, zs] = corners;
        let [_, ny, nz] = counts;
        let mut sums = vec![0.0; width];
        for (x, of_x) in xs {
            for (y, of_y) in ys {
                for (z, of_z) in zs {
                    let weight = of_x * of_y * of_z;
                    let first = ((x * ny + y) * nz + z) * width;
                    let stored = values.get(first..first + width).unwrap_or_default();
                    let sums = sums.iter_mut().zip(stored);
                    sums.for_each(|(sum, value)| *sum += weight * f64::from(*value));
                }
            }
        }
        sums
    }

    /// Optical depth of a step at a position, 0 where the mask is not set.
    fn depth(&self, world: [f64; 3]) -> f64 {
        let (at, Nodes(counts)) = (self.to_nodes(world), self.field.scene.nodes);
        let on =
            |(at, count): (f64, usize)| (-ON_FACE..=(count - 1) as f64 + ON_FACE).contains(&at);
        let inside = at.into_iter().zip(counts).all(on);
        let masked =
            |field: &RadianceField| field.free_space.as_ref().is_none_or(|m| m.contains(world));
        if !inside || !masked(&self.field) {
            return 0.0;
        }
        let raw: f64 = self.interpolate(&self.density, 1, at).into_iter().sum();
        let activation = &self.field.scene.activation;
        activation.density(raw) * f64::from(activation.interval)
    }

    fn color(&self, world: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let features = self.interpolate(&self.features, self.width, self.to_nodes(world));
        let seen = |&along: &[f64; 3]| self.network.color(&features, [0.0; 3], along);
        directions.iter().map(seen).collect()
    }

    fn step(&self) -> f64 {
        let march = &self.field.scene.march;
        f64::from(march.stepsize) * f64::from(march.voxel_size)
    }
}

impl TrainedModel for Dvgo {
    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn ray_color(&self, ray: &Ray, rules: &RayRules) -> RayColor {
        let direction = (ray.direction / ray.direction.length()).to_array();
        let (origin, step) = (ray.origin.to_array(), self.step());
        let (mut enters, mut leaves) = (f64::NEG_INFINITY, f64::INFINITY);
        let bounds = &self.field.scene.bounds;
        let corners = bounds.min.into_iter().zip(bounds.max);
        for ((from, by), (low, high)) in origin.into_iter().zip(direction).zip(corners) {
            let by = if by == 0.0 { 1e-6 } else { by };
            let (a, b) = ((f64::from(low) - from) / by, (f64::from(high) - from) / by);
            (enters, leaves) = (enters.max(a.min(b)), leaves.min(a.max(b)));
        }
        let far = rules.far.map_or(f64::INFINITY, f64::from);
        let start = enters.min(far).max(f64::from(rules.near));
        let march = &self.field.scene.march;
        let (mut passes, mut sum, mut distance, mut number) = (1.0, [0.0; 3], 0.0, 0.0);
        while passes >= ENDS {
            let t = start + number * step;
            if t > leaves + ON_FACE {
                break;
            }
            number += 1.0;
            let mut world = origin;
            world.iter_mut().zip(direction).for_each(|(at, by)| *at += t * by);
            let alpha = -libm::expm1(-self.depth(world));
            if alpha <= f64::from(march.alpha_threshold) {
                continue;
            }
            let weight = alpha * passes;
            passes *= 1.0 - alpha;
            distance += weight * t;
            if weight > f64::from(march.color_threshold) {
                let seen = self.color(world, &[direction]);
                let seen = seen.first().copied().unwrap_or_default();
                sum.iter_mut().zip(seen).for_each(|(sum, seen)| *sum += weight * seen);
            }
        }
        let mut color = rules.background;
        for (value, sum) in color.iter_mut().zip(sum) {
            *value = (sum + passes * f64::from(*value)) as f32;
        }
        let distance = (distance + passes * rules.far.map_or(0.0, f64::from)) as f32;
        RayColor { color, transmittance: passes as f32, distance }
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        (self.depth(position) / self.step()) as f32
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let colors = self.color(position, directions);
        colors.into_iter().map(|color| color.map(|value| value as f32)).collect()
    }
}
