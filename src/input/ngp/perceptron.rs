//! Networks without biases, many inputs at a time.

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
            let rows = layer.weights.chunks_exact(layer.inputs.max(1));
            let outputs = rows.map(|weights| {
                let mut sums = [0.0; LANES];
                for (value, weight) in values.iter().zip(weights) {
                    sums.iter_mut().zip(value).for_each(|(sum, value)| *sum += weight * value);
                }
                if is_last { sums } else { sums.map(|sum: f32| sum.max(0.0)) }
            });
            values = outputs.collect();
        }
        values
    }
}
