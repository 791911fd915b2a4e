//! A tree by the rules of svox: leaf after leaf along a ray.

use std::sync::Arc;

use super::basis::Basis;
use super::keys::Arrays;
use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::progress::Progress;
use crate::model::activate;
use crate::model::camera::Ray;
use crate::model::ray_march::{
    DepthComposite, SampleBudget, crossing_by, point_at, unit_direction,
};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};

/// Added to the chord of each leaf, in units of the tree's box: svox's `step_size`, with volrend's
/// value.
pub const MORE_LENGTH: f64 = 1e-4;
/// The box of a tree, and of a leaf.
const CUBE: [[f64; 3]; 2] = [[0.0; 3], [1.0; 3]];
/// Added to directions, so that none is 0.
const NEARLY_ZERO: f64 = 1e-9;
/// Optical depth at which a ray ends: anything behind is invisible in 8 bits.
const OPAQUE_DEPTH: f64 = 20.0;

/// A file, ready to be loaded.
#[derive(Debug)]
pub(super) struct TreeFile {
    pub(super) arrays: Arc<Arrays>,
    /// The first functions, which are used.
    pub(super) functions: usize,
}

impl LoadModel for TreeFile {
    fn load(&self, limits: &Limits) -> Result<Box<dyn TrainedModel>> {
        let arrays = Arc::clone(&self.arrays);
        let mut budget = Budget::new(limits);
        let place = Place::Tensor("child".to_owned());
        let mut places = budget.zeroed(arrays.tree.cells(), "bytes of a tree", &place)?;
        let (mut values, mut cell) = (Vec::new(), 0);
        let mut spent = Ok(());
        arrays.rows.for_each_piece(|piece| {
            let before = values.len();
            for row in piece.chunks_exact(arrays.rows.width()) {
                let density = row.last().copied().unwrap_or(0.0);
                // Cells with children hold values of former leaves.
                if (density > 0.0 || density.is_nan()) && arrays.tree.is_leaf(cell) {
                    values.extend_from_slice(row);
                    if let Some(place) = places.get_mut(cell) {
                        // No tree has 2^32 cells.
                        *place = u32::try_from(values.len() / row.len()).unwrap_or(0);
                    }
                }
                cell += 1;
            }
            let bytes = size_of_val(values.get(before..).unwrap_or_default()) as u64;
            if spent.is_ok() {
                spent = budget.spend(bytes, "bytes of leaves", &place);
            }
            if spent.is_err() {
                values.clear();
            }
        })?;
        spent?;
        arrays.rows.check_finite(&values)?;
        Ok(Box::new(PlenOctree { arrays, places, values, functions: self.functions }))
    }
}

/// A tree in memory.
#[derive(Debug)]
struct PlenOctree {
    arrays: Arc<Arrays>,
    /// For each cell, its row in `values` plus one; 0 if it is empty.
    places: Vec<u32>,
    values: Vec<f32>,
    functions: usize,
}

impl PlenOctree {
    /// The values of a leaf, colours, then density; none without density.
    fn leaf(&self, cell: usize) -> &[f32] {
        let width = self.arrays.rows.width();
        let row = self.places.get(cell).and_then(|place| place.checked_sub(1));
        let row = row.and_then(|row| self.values.chunks_exact(width).nth(row as usize));
        row.unwrap_or_default()
    }

    /// A position of the world in the tree, which spans 0 to 1.
    fn to_tree(&self, world: [f64; 3]) -> [f64; 3] {
        let mut at = world;
        let axes = self.arrays.center.into_iter().zip(self.arrays.radius);
        for (at, (center, radius)) in at.iter_mut().zip(axes) {
            *at = 0.5 + 0.5 * (*at - center) / radius;
        }
        at
    }

    fn color(&self, leaf: &[f32], functions: &[f64]) -> [f64; 3] {
        let stored = self.arrays.basis.functions();
        let mut sums = [0.0; 3];
        for (sum, coefficients) in sums.iter_mut().zip(leaf.chunks_exact(stored)) {
            let terms = functions.iter().zip(coefficients).take(self.functions);
            *sum = terms.map(|(function, k)| function * f64::from(*k)).sum();
        }
        match self.arrays.basis {
            Basis::Colors { logits: false } => sums,
            _ => sums.map(activate::sigmoid),
        }
    }
}

impl TrainedModel for PlenOctree {
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor {
        let unit = unit_direction(ray);
        let functions = self.arrays.basis.values(unit);
        let origin = self.to_tree(ray.origin.to_array());
        let mut direction = unit;
        direction.iter_mut().zip(self.arrays.radius).for_each(|(by, radius)| *by /= 2.0 * radius);
        // World units for a unit of the tree along the ray.
        let length = 1.0 / direction.iter().map(|by| by * by).sum::<f64>().sqrt();
        let direction = direction.map(|by| by * length);
        let inverse = direction.map(|by| 1.0 / (by + NEARLY_ZERO));
        let [enter, end] = crossing_by(origin, inverse, CUBE);
        let near = f64::from(rules.near) / length;
        let far = rules.farthest() / length;
        let mut t = enter.max(near).min(far).max(0.0);
        let mut light = DepthComposite::default();
        // Steps are as long as leaves and never 0, so a ray always advances.
        let mut samples = SampleBudget::new(t, f64::INFINITY, progress);
        while t < end && light.depth < OPAQUE_DEPTH && samples.take() {
            let at = point_at(origin, direction, t);
            let leaf = self.arrays.tree.leaf(at);
            let [enter, exit] = crossing_by(leaf.at, inverse, CUBE);
            let chord = (exit - enter.max(0.0)) * leaf.size + MORE_LENGTH;
            let values = self.leaf(leaf.cell);
            let density = values.last().copied().map_or(0.0, f64::from);
            if density > 0.0 {
                let seen = self.color(values, &functions);
                light.add(chord * length * density / self.arrays.unit, t * length, seen);
            }
            // A chord is never shorter than the length that is added to it.
            t = (t + chord.max(MORE_LENGTH)).max(t.next_up());
        }
        light.over_background(rules)
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        let at = self.to_tree(position);
        if !at.iter().all(|value| (0.0..=1.0).contains(value)) {
            return 0.0;
        }
        let leaf = self.leaf(self.arrays.tree.leaf(at).cell);
        let density = leaf.last().copied().unwrap_or(0.0).max(0.0);
        (f64::from(density) / self.arrays.unit) as f32
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let leaf = self.leaf(self.arrays.tree.leaf(self.to_tree(position)).cell);
        let colors = directions.iter().map(|&direction| {
            self.color(leaf, &self.arrays.basis.values(direction)).map(|value| value as f32)
        });
        colors.collect()
    }
}
