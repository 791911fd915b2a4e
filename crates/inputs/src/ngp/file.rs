//! The parameters of a model in their file.

use std::sync::Arc;

use super::evaluate::Ngp;
use super::frame::Frame;
use super::occupancy::Occupancy;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::lazy::Lazy;
use crate::model::harmonics::FUNCTIONS;
use crate::model::ray_march::GrowingSteps;
use crate::packets::{
    HashField, HashGrid, HashNetwork, Layer, Levels, Matrix, Values, ViewNetwork,
};

/// The growth of steps with the distance.
#[derive(Debug, Clone, Copy)]
pub(super) enum Growth {
    /// They do not.
    None,
    /// By a ratio; on all rays, samples lie at whole numbers of steps.
    Ratio(GrowingSteps),
    /// Each is a share of the distance, up to a maximum. Longer steps use larger cells.
    Share { share: f64, longest: f64 },
}

/// The rules of a ray.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rules {
    /// Length of a step in edges of the unit cube; of the shortest one if steps grow.
    pub(super) step: f64,
    /// The growth of steps with the distance.
    pub(super) growth: Growth,
    /// Transmittance below which a ray ends.
    pub(super) min_transmittance: f64,
    /// True if the colour is divided by the opacity there.
    pub(super) divides: bool,
}

/// A model whose parameters are read on first use.
#[derive(Debug)]
pub(super) struct NgpFile {
    pub(super) levels: Levels,
    pub(super) table: Values,
    pub(super) density: Vec<Matrix>,
    pub(super) color: Vec<Matrix>,
    /// True if the colour network takes the direction first, and not the first output of the
    /// density network.
    pub(super) direction_first: bool,
    pub(super) reach: f64,
    /// The scene is a cube of this many unit cubes along an edge, around the same middle.
    pub(super) span: f64,
    pub(super) per_edge: f64,
    pub(super) frame: Frame,
    pub(super) occupancy: Occupancy,
    pub(super) rules: Rules,
    pub(super) limits: Limits,
    pub(super) loaded: Lazy<Ngp>,
}

impl NgpFile {
    /// The model in memory.
    pub(super) fn load(&self) -> Result<Arc<Ngp>> {
        self.loaded.get(|| self.read())
    }

    fn read(&self) -> Result<Ngp> {
        let mut budget = Budget::new(&self.limits);
        let table = self.table.read(&mut budget)?;
        let layers = |matrices: &[Matrix], budget: &mut Budget| -> Result<Vec<Layer>> {
            let read = matrices.iter().map(|matrix| {
                let weights = matrix.values.read(budget)?;
                Ok(Layer::unbiased(matrix.inputs, weights))
            });
            read.collect()
        };
        let grid = HashGrid { levels: self.levels.clone(), table };
        let shape = HashNetwork::new(grid, &layers(&self.density, &mut budget)?);
        let mut color = layers(&self.color, &mut budget)?;
        if let Some(last) = color.last_mut() {
            // Others are padding.
            last.weights.truncate(3 * last.inputs);
            last.biases.truncate(3);
        }
        let geometry = self.density.last().map_or(0, |matrix| matrix.outputs);
        let (firsts, skipped) = match self.direction_first {
            true => ([FUNCTIONS, 0], 1),
            false => ([0, geometry], 0),
        };
        let color = ViewNetwork::new(&color, firsts);
        let field = HashField { shape, color, skipped };
        Ok(Ngp { field, reach: self.reach, per_edge: self.per_edge })
    }

    /// True if the density at a position of the cube counts: in scenes of one unit cube, in
    /// occupied cells; in larger scenes, wherever the table reaches.
    pub(super) fn shows(&self, at: [f64; 3]) -> bool {
        match self.span > 1.0 {
            true => at.iter().all(|at| (at - 0.5).abs() <= 0.5 * self.span),
            false => self.occupancy.contains(at),
        }
    }

    /// Bytes of the parameters in memory.
    pub(super) fn memory_bytes(&self) -> u64 {
        let matrices = self.density.iter().chain(&self.color);
        4 * (self.table.count + matrices.map(|matrix| matrix.values.count).sum::<u64>())
    }

    /// Visits the bytes of the parameters.
    pub(super) fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        let matrices = self.density.iter().chain(&self.color).map(|matrix| &matrix.values);
        for values in matrices.chain([&self.table]) {
            values.digest(&mut Budget::new(&self.limits), hash)?;
        }
        Ok(())
    }
}

/// Refuses networks whose matrices do not follow each other from `inputs` values to `outputs` or
/// more.
pub(super) fn check_network(
    matrices: &[Matrix],
    inputs: usize,
    outputs: usize,
    place: &Place,
) -> Result<()> {
    let mut width = inputs;
    for matrix in matrices {
        if matrix.inputs != width || matrix.outputs == 0 {
            let found = format!("a layer [{}, {}]", matrix.outputs, matrix.inputs);
            let expected = format!("one of {width} inputs");
            return Err(Error::malformed(place.clone(), found, expected));
        }
        width = matrix.outputs;
    }
    if width < outputs || matrices.is_empty() {
        let found = format!("{width} outputs of {} layers", matrices.len());
        return Err(Error::malformed(place.clone(), found, format!("{outputs} at least")));
    }
    Ok(())
}
