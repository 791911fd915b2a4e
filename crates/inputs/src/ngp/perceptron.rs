//! Networks without biases, many inputs at a time.

use multiversion::multiversion;

/// Inputs that are computed together.
pub(super) const LANES: usize = 16;

/// A value for each of the inputs.
pub(super) type Lanes = [f32; LANES];

/// Layers with relu between them.
#[derive(Debug)]
pub(super) struct Perceptron {
    layers: Vec<Layer>,
}

/// A matrix `[outputs, inputs]`.
#[derive(Debug)]
pub(super) struct Layer {
    pub(super) inputs: usize,
    pub(super) weights: Vec<f32>,
}

impl Perceptron {
    /// Of layers that follow each other.
    pub(super) fn new(layers: Vec<Layer>) -> Self {
        Self { layers }
    }

    /// The outputs for each lane of the inputs.
    pub(super) fn run(&self, inputs: &[Lanes]) -> Vec<Lanes> {
        let mut values = inputs.to_vec();
        for (number, layer) in self.layers.iter().enumerate() {
            let is_last = number + 1 == self.layers.len();
            let mut outputs = vec![[0.0; LANES]; layer.weights.len() / layer.inputs.max(1)];
            multiply(&values, layer.inputs, &layer.weights, &mut outputs);
            if !is_last {
                outputs.iter_mut().flatten().for_each(|value| *value = value.max(0.0));
            }
            values = outputs;
        }
        values
    }
}

/// The products of a matrix with all lanes. The same on every machine: terms are added in order.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn multiply(values: &[Lanes], inputs: usize, weights: &[f32], outputs: &mut [Lanes]) {
    for (sums, weights) in outputs.iter_mut().zip(weights.chunks_exact(inputs.max(1))) {
        for (value, weight) in values.iter().zip(weights) {
            sums.iter_mut().zip(value).for_each(|(sum, value)| *sum += weight * value);
        }
    }
}
