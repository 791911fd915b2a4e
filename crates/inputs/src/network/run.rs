//! A network for the colour of each sample.

use std::ops::Range;

use multiversion::multiversion;

use crate::base::error::{Error, Place, Result};
use crate::base::limits::Budget;
use crate::model::activate;
use crate::tensor::Tensor;

/// Additional inputs as octaves of sines and cosines.
#[derive(Debug, Clone, Copy)]
pub struct Inputs {
    /// Of each feature.
    pub features: u32,
    /// Of the position, -1 to 1 in the box.
    pub position: u32,
    /// Of the direction.
    pub direction: u32,
}

/// The layers of a network, checked against its inputs, with unread weights.
#[derive(Debug, Clone)]
pub struct NetworkFile {
    layers: Vec<[Tensor; 2]>,
    inputs: Inputs,
    waves: Waves,
    features: usize,
    /// True if the first three features are not inputs, but logits that are added to the outputs.
    is_residual: bool,
}

/// The frequencies of the sines and cosines.
#[derive(Debug, Clone, Copy)]
struct Waves {
    first: f64,
    /// Ratio of each to the one before.
    ratio: f64,
}

/// 1, 2, 4, and so on.
const OCTAVES: Waves = Waves { first: 1.0, ratio: 2.0 };

/// A network in memory.
#[derive(Debug)]
pub struct Network {
    layers: Vec<Layer>,
    inputs: Inputs,
    waves: Waves,
    /// The features that are inputs.
    features: usize,
    is_residual: bool,
}

#[derive(Debug)]
struct Layer {
    /// Input by input, so that sums run over outputs.
    weights: Vec<f64>,
    biases: Vec<f64>,
}

impl NetworkFile {
    /// A network of weights `[outputs, inputs]` and biases, layer by layer, from this many features
    /// to three colours.
    ///
    /// # Errors
    /// `Malformed` if shapes do not follow each other, or without layers.
    pub fn new(layers: Vec<[Tensor; 2]>, inputs: Inputs, features: usize) -> Result<Self> {
        if layers.is_empty() {
            let place = Place::Key("network".to_owned());
            return Err(Error::malformed(place, "no layers", "one or more"));
        }
        let octaves = |octaves: u32, width: usize| 2 * octaves as usize * width;
        let mut width = features + 3 + octaves(inputs.features, features);
        width += octaves(inputs.position, 3) + octaves(inputs.direction, 3);
        for (number, [weight, bias]) in layers.iter().enumerate() {
            let last = number + 1 == layers.len();
            let fits = match (weight.shape(), bias.shape()) {
                (&[rows, columns], &[biases]) => {
                    let outputs = if last { 3..=3 } else { 1..=1024 };
                    columns == width as u64 && rows == biases && outputs.contains(&rows)
                }
                _ => false,
            };
            if !fits {
                let found = format!("shapes {:?} and {:?}", weight.shape(), bias.shape());
                let rows = if last { "3" } else { "1 to 1024" };
                let expected = format!("[{rows}, {width}], and as many biases");
                return Err(Error::malformed(weight.place(), found, expected));
            }
            width = usize::try_from(bias.count()).unwrap_or(0);
        }
        Ok(Self { layers, inputs, waves: OCTAVES, features, is_residual: false })
    }

    /// The same with three more features before them, logits that are added to the outputs.
    #[must_use]
    pub fn residual(self) -> Self {
        Self { is_residual: true, ..self }
    }

    /// The same with other frequencies than 1, 2, 4, ...: the first one, and the ratio of each to
    /// the one before.
    #[must_use]
    pub fn with_waves(self, first: f64, ratio: f64) -> Self {
        Self { waves: Waves { first, ratio }, ..self }
    }

    /// Reads the weights.
    ///
    /// # Errors
    /// Errors of reading, and NaN weights.
    pub fn load(&self, budget: &mut Budget) -> Result<Network> {
        let mut layers = Vec::new();
        for [weight, bias] in &self.layers {
            let (stored, biases) = (weight.read_f32(budget)?, bias.read_f32(budget)?);
            if stored.iter().chain(&biases).any(|value| !value.is_finite()) {
                return Err(Error::malformed(weight.place(), "no number", "finite numbers"));
            }
            let (outputs, inputs) = (biases.len(), stored.len() / biases.len().max(1));
            let mut weights: Vec<f64> =
                budget.zeroed(stored.len(), "bytes of a network", &weight.place())?;
            for (output, row) in stored.chunks_exact(inputs).enumerate() {
                let out = weights.iter_mut().skip(output).step_by(outputs);
                out.zip(row).for_each(|(out, value)| *out = f64::from(*value));
            }
            layers.push(Layer { weights, biases: biases.into_iter().map(f64::from).collect() });
        }
        let Self { inputs, waves, features, is_residual, .. } = *self;
        Ok(Network { layers, inputs, waves, features, is_residual })
    }

    /// Neurons of the first layer.
    pub(super) fn hidden_width(&self) -> usize {
        let first = self.layers.first();
        first.and_then(|[_, bias]| usize::try_from(bias.count()).ok()).unwrap_or(0)
    }
}

impl Network {
    /// The colour of features at a position (-1 to 1 in the box) seen along a unit direction.
    pub fn color(&self, features: &[f64], at: [f64; 3], direction: [f64; 3]) -> [f64; 3] {
        let (added, features) = self.split(features);
        let mut values: Vec<f64> = features.iter().copied().chain(direction).collect();
        self.waves.encode(features, self.inputs.features, &mut values);
        self.waves.encode(&at, self.inputs.position, &mut values);
        self.waves.encode(&direction, self.inputs.direction, &mut values);
        for (number, layer) in self.layers.iter().enumerate() {
            let mut sums = layer.biases.clone();
            for (value, weights) in values.iter().zip(layer.weights.chunks_exact(sums.len())) {
                // Most inputs of later layers are 0.
                if *value != 0.0 {
                    sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * weight);
                }
            }
            if number + 1 < self.layers.len() {
                sums.iter_mut().for_each(|sum| *sum = sum.max(0.0));
            }
            values = sums;
        }
        let mut color = added;
        color
            .iter_mut()
            .zip(values)
            .for_each(|(out, value)| *out = activate::sigmoid(*out + value));
        color
    }

    /// The logits that are added to the outputs, and the features that are inputs.
    pub(super) fn split<'a>(&self, features: &'a [f64]) -> ([f64; 3], &'a [f64]) {
        match features.split_first_chunk() {
            Some((added, rest)) if self.is_residual => (*added, rest),
            _ => ([0.0; 3], features),
        }
    }

    /// A network with layers of these widths, and weights from `number`.
    #[cfg(test)]
    pub(super) fn of(
        features: usize,
        inputs: Inputs,
        widths: &[usize],
        mut number: impl FnMut() -> f64,
    ) -> Self {
        let (waves, is_residual) = (OCTAVES, false);
        let mut network = Self { layers: Vec::new(), inputs, waves, features, is_residual };
        let mut width = network.direction_inputs().end;
        for &outputs in widths {
            let mut numbers = |count: usize| -> Vec<f64> {
                (0..count).map(|_| f64::from(number() as f32)).collect()
            };
            let (weights, biases) = (numbers(width * outputs), numbers(outputs));
            network.layers.push(Layer { weights, biases });
            width = outputs;
        }
        network
    }

    /// The inputs of a node; direction inputs are 0.
    pub(super) fn node_inputs(&self, features: &[f64], at: [f64; 3], inputs: &mut Vec<f64>) {
        inputs.clear();
        inputs.extend(features.iter().copied().chain([0.0; 3]));
        self.waves.encode(features, self.inputs.features, inputs);
        self.waves.encode(&at, self.inputs.position, inputs);
    }

    /// The inputs of a direction; node inputs are 0.
    pub(super) fn inputs_of(&self, direction: [f64; 3]) -> Vec<f64> {
        let mut inputs = vec![0.0; self.features];
        inputs.extend(direction);
        inputs.resize(self.direction_inputs().start, 0.0);
        self.waves.encode(&direction, self.inputs.direction, &mut inputs);
        inputs
    }

    /// The range of inputs that encode a direction.
    fn direction_inputs(&self) -> Range<usize> {
        let width = |octaves: u32, values: usize| 2 * octaves as usize * values;
        let of_node = width(self.inputs.features, self.features) + width(self.inputs.position, 3);
        let start = self.features + 3 + of_node;
        start..start + width(self.inputs.direction, 3)
    }

    /// Neurons of the first layer.
    pub(super) fn hidden_width(&self) -> usize {
        self.layers.first().map_or(0, |layer| layer.biases.len())
    }

    /// Weights, input by input, and biases of each layer.
    pub(super) fn layers(&self) -> impl Iterator<Item = (&[f64], &[f64])> {
        self.layers.iter().map(|layer| (&layer.weights[..], &layer.biases[..]))
    }

    /// The first layer's sums over the first of its inputs, with or without its biases.
    pub(super) fn first_layer(&self, inputs: &[f64], biased: bool) -> Vec<f64> {
        let Some(Layer { weights, biases }) = self.layers.first() else { return Vec::new() };
        let mut sums = if biased { biases.clone() } else { vec![0.0; biases.len()] };
        add_rows(inputs, weights, &mut sums);
        sums
    }
}

/// Adds the rows of `weights`, each times its input, in order.
#[multiversion(targets("x86_64+avx2", "aarch64+neon"))]
fn add_rows(inputs: &[f64], weights: &[f64], sums: &mut [f64]) {
    for (value, weights) in inputs.iter().zip(weights.chunks_exact(sums.len().max(1))) {
        if *value != 0.0 {
            sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * weight);
        }
    }
}

impl Waves {
    /// Adds the sines of all values by octave, then the cosines.
    fn encode(self, values: &[f64], octaves: u32, out: &mut Vec<f64>) {
        for wave in [libm::sin as fn(f64) -> f64, libm::cos] {
            for value in values {
                let next = |frequency: &f64| Some(frequency * self.ratio);
                let frequencies = std::iter::successors(Some(self.first), next);
                let octaves = frequencies.take(octaves as usize);
                out.extend(octaves.map(|frequency| wave(value * frequency)));
            }
        }
    }
}
