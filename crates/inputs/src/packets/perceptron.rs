//! Networks of layers with relu between them.

use super::kernels::Kernels;
use super::multiply::TILE;
use super::real::{LANES, Lanes};

/// A layer in file order.
#[derive(Debug, Clone)]
pub struct Layer {
    /// Inputs of each neuron.
    pub inputs: usize,
    /// `[outputs, inputs]`.
    pub weights: Vec<f32>,
    /// One for each neuron. Sums of weights and inputs that never change belong to them.
    pub biases: Vec<f64>,
}

impl Layer {
    /// A layer without biases.
    pub fn unbiased(inputs: usize, weights: Vec<f32>) -> Self {
        let biases = vec![0.0; weights.len() / inputs.max(1)];
        Self { inputs, weights, biases }
    }

    /// The layer without the inputs from `first` on, which always have these values.
    #[must_use]
    pub fn with_constants(mut self, first: usize, constants: &[f64]) -> Self {
        let mut weights = Vec::with_capacity(self.biases.len() * first);
        for (row, bias) in self.weights.chunks_exact(self.inputs.max(1)).zip(&mut self.biases) {
            let (kept, constant) = row.split_at(first.min(row.len()));
            weights.extend_from_slice(kept);
            let terms = constant.iter().zip(constants);
            *bias += terms.map(|(weight, value)| f64::from(*weight) * value).sum::<f64>();
        }
        (self.inputs, self.weights) = (first.min(self.inputs), weights);
        self
    }
}

/// A float type of networks.
pub trait Number: Kernels {
    /// The network of these numbers.
    fn of_both(both: &Both) -> &Perceptron<Self>;
}

impl Number for f32 {
    fn of_both(both: &Both) -> &Perceptron<Self> {
        &both.narrow
    }
}

impl Number for f64 {
    fn of_both(both: &Both) -> &Perceptron<Self> {
        &both.wide
    }
}

/// A network in both widths of numbers.
#[derive(Debug)]
pub struct Both {
    pub(super) narrow: Perceptron<f32>,
    pub(super) wide: Perceptron<f64>,
}

impl Both {
    /// Of layers that follow each other.
    pub fn new(layers: &[Layer]) -> Self {
        Self { narrow: Perceptron::new(layers), wide: Perceptron::new(layers) }
    }

    /// The network of a float type.
    pub fn of<T: Number>(&self) -> &Perceptron<T> {
        T::of_both(self)
    }
}

/// Layers with relu between them.
#[derive(Debug)]
pub struct Perceptron<T> {
    layers: Vec<Tiles<T>>,
}

/// A layer with weights in the order of their use.
#[derive(Debug)]
struct Tiles<T> {
    inputs: usize,
    outputs: usize,
    /// [`TILE`] neurons after the other: their weights of the first input, of the second one...
    weights: Vec<T>,
    /// Filled up.
    biases: Vec<T>,
}

impl<T: Kernels> Tiles<T> {
    fn new(layer: &Layer) -> Self {
        let (inputs, outputs) = (layer.inputs, layer.biases.len());
        let padded = outputs.next_multiple_of(TILE);
        let mut weights = vec![T::default(); padded * inputs];
        for (output, row) in layer.weights.chunks_exact(inputs.max(1)).enumerate() {
            for (input, weight) in row.iter().enumerate() {
                let at = (output / TILE * inputs + input) * TILE + output % TILE;
                if let Some(out) = weights.get_mut(at) {
                    *out = T::of_stored(*weight);
                }
            }
        }
        let mut biases: Vec<T> = layer.biases.iter().map(|bias| T::of(*bias)).collect();
        biases.resize(padded, T::default());
        Self { inputs, outputs, weights, biases }
    }

    /// Adds the sums of inputs from `first` on.
    fn add(&self, first: usize, inputs: &[Lanes<T>], sums: &mut [Lanes<T>]) {
        let weights = self.weights.get(first * TILE..).unwrap_or_default();
        T::multiply(weights, self.inputs, inputs, sums);
    }

    fn begin(&self, sums: &mut Vec<Lanes<T>>) {
        sums.clear();
        sums.extend(self.biases.iter().map(|bias| [*bias; LANES]));
    }
}

impl<T: Kernels> Perceptron<T> {
    fn new(layers: &[Layer]) -> Self {
        Self { layers: layers.iter().map(Tiles::new).collect() }
    }

    /// The first layer's sums of no inputs.
    pub fn begin(&self, sums: &mut Vec<Lanes<T>>) {
        sums.clear();
        if let Some(first) = self.layers.first() {
            first.begin(sums);
        }
    }

    /// Adds inputs, starting at a number, to the first layer's sums.
    pub fn add(&self, first: usize, inputs: &[Lanes<T>], sums: &mut [Lanes<T>]) {
        if let Some(layer) = self.layers.first() {
            layer.add(first, inputs, sums);
        }
    }

    /// Turns the first layer's sums into the network's outputs. `scratch` may have any content.
    pub fn finish(&self, sums: &mut Vec<Lanes<T>>, scratch: &mut Vec<Lanes<T>>) {
        for layer in self.layers.iter().skip(1) {
            T::relu(sums);
            layer.begin(scratch);
            layer.add(0, sums.get(..layer.inputs).unwrap_or_default(), scratch);
            std::mem::swap(sums, scratch);
        }
        sums.truncate(self.layers.last().map_or(0, |layer| layer.outputs));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers from -0.5 to 0.5.
    fn noise(seed: &mut u32) -> f64 {
        *seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(*seed >> 8) / f64::from(1 << 24) - 0.5
    }

    /// A network, neuron by neuron.
    fn plain(layers: &[Layer], inputs: &[f64]) -> Vec<f64> {
        let mut values = inputs.to_vec();
        for (number, layer) in layers.iter().enumerate() {
            if number > 0 {
                values.iter_mut().for_each(|value| *value = value.max(0.0));
            }
            let rows = layer.weights.chunks_exact(layer.inputs).zip(&layer.biases);
            let sum = |(row, bias): (&[f32], &f64)| {
                let terms = row.iter().zip(&values);
                bias + terms.map(|(weight, value)| f64::from(*weight) * value).sum::<f64>()
            };
            values = rows.map(sum).collect();
        }
        values
    }

    fn held<T: Number>(layers: &[Layer], inputs: &[Lanes<f64>], split: usize, most: f64) {
        let network = Both::new(layers);
        let network = network.of::<T>();
        let narrow: Vec<Lanes<T>> = inputs.iter().map(|lanes| lanes.map(T::of)).collect();
        let (mut sums, mut scratch) = (Vec::new(), Vec::new());
        network.begin(&mut sums);
        network.add(0, &narrow[..split], &mut sums);
        network.add(split, &narrow[split..], &mut sums);
        network.finish(&mut sums, &mut scratch);
        for lane in 0..LANES {
            let own: Vec<f64> = inputs.iter().map(|lanes| lanes[lane]).collect();
            let expected = plain(layers, &own);
            assert_eq!(expected.len(), sums.len());
            for (found, expected) in sums.iter().zip(expected) {
                assert!((found[lane].wide() - expected).abs() < most, "{expected}");
            }
        }
    }

    #[test]
    fn packets_agree_with_the_plain_network() {
        let seed = &mut 5;
        for widths in [&[3, 5][..], &[1, 1, 1], &[12, 16, 16], &[32, 64, 16, 3], &[7, 9, 6, 2]] {
            let layers: Vec<Layer> = widths
                .windows(2)
                .map(|pair| Layer {
                    inputs: pair[0],
                    weights: (0..pair[0] * pair[1]).map(|_| noise(seed) as f32).collect(),
                    biases: (0..pair[1]).map(|_| noise(seed)).collect(),
                })
                .collect();
            let inputs: Vec<Lanes<f64>> =
                (0..widths[0]).map(|_| [(); LANES].map(|()| 4.0 * noise(seed))).collect();
            for split in [0, widths[0] / 2, widths[0]] {
                held::<f64>(&layers, &inputs, split, 1e-13);
                held::<f32>(&layers, &inputs, split, 2e-5);
            }
        }
    }

    #[test]
    fn constant_inputs_are_biases() {
        let seed = &mut 9;
        let layer = Layer {
            inputs: 5,
            weights: (0..15).map(|_| noise(seed) as f32).collect(),
            biases: (0..3).map(|_| noise(seed)).collect(),
        };
        let constants = [0.3, -2.0];
        let inputs = [1.0, 0.25, -0.5];
        let all: Vec<f64> = inputs.into_iter().chain(constants).collect();
        let expected = plain(std::slice::from_ref(&layer), &all);
        let found = plain(&[layer.with_constants(3, &constants)], &inputs);
        assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-15));
    }
}
