//! The parameters of a model in their file.

use std::sync::Arc;

use super::evaluate::Ngp;
use super::frame::Frame;
use super::layout::Layout;
use super::occupancy::Occupancy;
use super::perceptron::{Layer, Perceptron};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::lazy::Lazy;
use crate::model::grid::Element;
use crate::model::harmonics::FUNCTIONS;
use crate::model::ray_march::GrowingSteps;
use crate::tensor::Tensor;

/// Bytes that are read at once.
const PIECE: usize = 1 << 20;

/// A matrix in a file.
#[derive(Debug, Clone)]
pub(super) struct Matrix {
    pub(super) values: Values,
    pub(super) outputs: usize,
    pub(super) inputs: usize,
}

/// Numbers that follow each other in a file.
#[derive(Debug, Clone)]
pub(super) struct Values {
    /// Of numbers, or of their bytes.
    pub(super) tensor: Tensor,
    /// The numbers' type.
    pub(super) element: Element,
    /// Numbers before the first one, and from it on.
    pub(super) first: u64,
    pub(super) count: u64,
}

impl Values {
    /// All numbers, which must be finite.
    fn read(&self, budget: &mut Budget) -> Result<Vec<f32>> {
        let place = self.tensor.place();
        let count = usize::try_from(self.count).unwrap_or(usize::MAX);
        let mut values: Vec<f32> = budget.zeroed(count, "bytes of parameters", &place)?;
        let storage = self.tensor.storage(budget)?;
        let size = self.element.size();
        let mut bytes = vec![0; PIECE];
        let mut at = self.first * size as u64;
        for values in values.chunks_mut(PIECE / size) {
            let Some(bytes) = bytes.get_mut(..values.len() * size) else { continue };
            storage.read_into(at, bytes)?;
            self.element.decode(bytes, values);
            at += bytes.len() as u64;
        }
        match values.iter().position(|value| !value.is_finite()) {
            None => Ok(values),
            Some(at) => {
                let found =
                    format!("parameter {} that is no finite number", self.first + at as u64);
                Err(Error::malformed(place, found, "finite numbers"))
            }
        }
    }
}

/// The rules of a ray.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rules {
    /// Length of a step, in edges of the unit cube; of the least one where they grow.
    pub(super) step: f64,
    /// Steps that grow with the distance.
    pub(super) growing: Option<GrowingSteps>,
    /// Transmittance below which a ray ends.
    pub(super) min_transmittance: f64,
    /// True if the colour is divided by the opacity there.
    pub(super) divides: bool,
}

/// A model whose parameters are read when they are first wanted.
#[derive(Debug)]
pub(super) struct NgpFile {
    pub(super) layout: Layout,
    pub(super) table: Values,
    pub(super) density: Vec<Matrix>,
    pub(super) color: Vec<Matrix>,
    /// True if the colour network takes the direction first, and not the first output of the other.
    pub(super) direction_first: bool,
    pub(super) reach: f64,
    /// The scene is a cube of so many unit cubes along an edge, around the same middle.
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
                Ok(Layer { inputs: matrix.inputs, weights })
            });
            read.collect()
        };
        let density = Perceptron::new(layers(&self.density, &mut budget)?);
        let mut color = layers(&self.color, &mut budget)?;
        if self.direction_first
            && let Some(first) = color.first_mut()
        {
            turn(first);
        }
        if let Some(last) = color.last_mut() {
            // Others are padding.
            last.weights.truncate(3 * last.inputs);
        }
        let (layout, color) = (self.layout.clone(), Perceptron::new(color));
        let (reach, per_edge) = (self.reach, self.per_edge);
        Ok(Ngp { layout, table, density, color, reach, per_edge })
    }

    /// True if the density at a position of the cube counts: of one unit cube in occupied cells, of
    /// larger scenes wherever the table reaches.
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

    /// Shows the bytes of the parameters.
    pub(super) fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        let matrices = self.density.iter().chain(&self.color).map(|matrix| &matrix.values);
        let mut bytes = vec![0; PIECE];
        for values in matrices.chain([&self.table]) {
            let storage = values.tensor.storage(&mut Budget::new(&self.limits))?;
            let size = values.element.size() as u64;
            let (mut at, end) = (values.first * size, (values.first + values.count) * size);
            while at < end {
                let count = usize::try_from(end - at).unwrap_or(PIECE).min(PIECE);
                let Some(bytes) = bytes.get_mut(..count) else { break };
                storage.read_into(at, bytes)?;
                hash(bytes);
                at += count as u64;
            }
        }
        Ok(())
    }
}

/// Orders the columns of a first layer: outputs of the density network, then the direction.
fn turn(layer: &mut Layer) {
    let mut turned = Vec::with_capacity(layer.weights.len() + layer.weights.len() / 8);
    for row in layer.weights.chunks_exact(layer.inputs) {
        let (direction, geometry) = row.split_at(FUNCTIONS.min(row.len()));
        turned.push(0.0);
        turned.extend_from_slice(geometry);
        turned.extend_from_slice(direction);
    }
    (layer.inputs, layer.weights) = (layer.inputs + 1, turned);
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
