//! The rules of MERF's viewer within the core. Its own space is the world with permuted axes.

use std::sync::Arc;

use super::sums::{Assets, Sums, density};
use crate::base::error::Result;
use crate::folder::{Corners, Light, OPACITY, Samples, Viewed, ViewerRules};
use crate::model::activate::sigmoid;
use crate::model::trained_model::RayRules;
use crate::snerg::layout::FAINT;

/// The core of contracted space.
const CORE: Corners = [[-1.0; 3], [1.0; 3]];

impl Viewed for Assets {
    type Rules = Rules;

    fn rules(&self) -> Result<Rules> {
        Ok(Rules(self.sums()?))
    }
}

#[derive(Debug)]
pub(super) struct Rules(Arc<Sums>);

impl Rules {
    /// Sums at a position of the world, where a ray takes samples.
    fn at(&self, world: [f64; 3]) -> Option<[f64; 8]> {
        let own = self.position(world);
        let inside = own.iter().all(|at| at.abs() <= 1.0);
        let shown = inside && self.0.occupancy.empty_cell(own).is_none();
        shown.then(|| self.0.at(own, 0.0)).flatten()
    }
}

impl ViewerRules for Rules {
    /// It runs for every ray.
    const CLEAR: f64 = 1.0;

    fn position(&self, world: [f64; 3]) -> [f64; 3] {
        self.0.parameters.axes.within(world)
    }

    fn direction(&self, world: [f64; 3]) -> [f64; 3] {
        self.position(world)
    }

    fn space(&self) -> Corners {
        CORE
    }

    fn samples(&self, [enters, leaves]: [f64; 2], rules: &RayRules) -> Samples {
        let parameters = &self.0.parameters;
        // The viewer counts the voxels along the diagonal of a plane, else of the grid.
        let axes: f64 = if parameters.planes.is_some() { 2.0 } else { 3.0 };
        Samples {
            start: enters.max(f64::from(rules.near)).max(0.0),
            end: leaves.min(rules.farthest()),
            step: parameters.voxel_size(),
            most: (axes.sqrt() * parameters.resolution() as f64).ceil(),
        }
    }

    fn visit(&self, at: [f64; 3], [t, length]: [f64; 2], light: &mut Light) -> Option<Corners> {
        let cell = self.0.occupancy.empty_cell(at);
        if cell.is_none()
            && let Some([red, green, blue, sum, a, b, c, d]) = self.0.at(at, 0.0)
        {
            let opacity = -libm::expm1(-density(sum) * length);
            if opacity > FAINT {
                let seen = [red, green, blue, a, b, c, d].map(sigmoid);
                light.add(opacity, t, |_| Some(seen));
            }
        }
        cell
    }

    fn density(&self, world: [f64; 3]) -> f64 {
        let sum = self.at(world).and_then(|values| values.get(OPACITY).copied());
        sum.map_or(0.0, density)
    }

    fn values(&self, world: [f64; 3]) -> ([f64; 3], [f64; 4]) {
        let values = self.at(world).map_or([0.0; 8], |values| values.map(sigmoid));
        let [red, green, blue, _, features @ ..] = values;
        ([red, green, blue], features)
    }
}
