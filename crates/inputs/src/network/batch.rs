//! A network along many directions at once, in float32.
//!
//! The first layer is the sum of a part that depends on the node and a part that depends on the
//! direction. The second part is computed once for all nodes with the same directions. Values lie
//! direction by direction within each neuron, so vectors run over directions, and each sum has one
//! order.

use multiversion::multiversion;

use super::run::Network;
use crate::model::activate::lanes;

/// Directions per vector; batches are padded to a multiple.
const LANES: usize = 16;
/// Neurons and rows of inputs that are processed at once; layers are padded to a multiple.
const TILE: usize = 4;

/// The weights of a network for batches.
#[derive(Debug)]
pub struct BatchNetwork {
    layers: Vec<Layer>,
}

/// A layer.
#[derive(Debug)]
struct Layer {
    /// [`TILE`] neurons after the other: their weights of the first input, of the second one...
    weights: Vec<f32>,
    biases: Vec<f32>,
}

/// The directions of a batch.
#[derive(Debug)]
pub struct Batch {
    /// Their number.
    directions: usize,
    /// The first layer's sums of what depends on the direction alone, with its biases.
    first: Vec<f32>,
}

/// Memory of a batch at work.
#[derive(Debug, Default)]
pub struct Scratch {
    inputs: Vec<f64>,
    values: Vec<f32>,
    next: Vec<f32>,
}

impl BatchNetwork {
    /// Of a network's weights.
    #[expect(clippy::cast_possible_truncation, reason = "weights were float32")]
    pub fn new(network: &Network) -> Self {
        let layer = |(weights, biases): (&[f64], &[f64])| {
            let (outputs, inputs) = (biases.len(), weights.len() / biases.len().max(1));
            let [height, width] = [outputs, inputs].map(|count| count.next_multiple_of(TILE));
            let mut own = vec![0.0; height * width];
            for (input, row) in weights.chunks_exact(outputs.max(1)).enumerate() {
                for (output, weight) in row.iter().enumerate() {
                    let at = (output / TILE * width + input) * TILE + output % TILE;
                    if let Some(out) = own.get_mut(at) {
                        *out = *weight as f32;
                    }
                }
            }
            let mut biases: Vec<f32> = biases.iter().map(|bias| *bias as f32).collect();
            biases.resize(height, 0.0);
            Layer { weights: own, biases }
        };
        Self { layers: network.layers().map(layer).collect() }
    }

    /// A batch of unit directions.
    #[expect(clippy::cast_possible_truncation, reason = "values are float32")]
    pub fn batch(&self, network: &Network, directions: &[[f64; 3]]) -> Batch {
        let padded = directions.len().next_multiple_of(LANES);
        let width = network.hidden_width();
        let mut first = vec![0.0; width.next_multiple_of(TILE) * padded];
        for (number, direction) in directions.iter().enumerate() {
            let inputs = network.inputs_of(*direction);
            let sums = network.first_layer(&inputs, true);
            let out = first.iter_mut().skip(number).step_by(padded);
            out.zip(sums).for_each(|(out, sum)| *out = sum as f32);
        }
        Batch { directions: directions.len(), first }
    }

    /// Red, green and blue of features at a position (-1 to 1 in the box) along the directions of
    /// a batch.
    #[expect(clippy::cast_possible_truncation, reason = "values are float32")]
    pub fn colors(
        &self,
        network: &Network,
        batch: &Batch,
        features: &[f64],
        at: [f64; 3],
        scratch: &mut Scratch,
        colors: &mut [Vec<f64>; 3],
    ) {
        let padded = batch.directions.next_multiple_of(LANES);
        let Scratch { inputs, values, next } = scratch;
        let (added, features) = network.split(features);
        network.node_inputs(features, at, inputs);
        values.clone_from(&batch.first);
        let is_deep = self.layers.len() > 1;
        for (values, node) in
            values.chunks_exact_mut(padded).zip(network.first_layer(inputs, false))
        {
            let node = node as f32;
            let least = if is_deep { 0.0 } else { f32::NEG_INFINITY };
            values.iter_mut().for_each(|value| *value = (*value + node).max(least));
        }
        for (number, layer) in self.layers.iter().enumerate().skip(1) {
            next.resize(layer.biases.len() * padded, 0.0);
            let least = if number + 1 < self.layers.len() { 0.0 } else { f32::NEG_INFINITY };
            let inputs = layer.weights.len() / layer.biases.len().max(1);
            let tiles = layer.weights.chunks_exact((TILE * inputs).max(1));
            let tiles = tiles.zip(layer.biases.chunks_exact(TILE));
            for ((weights, biases), out) in tiles.zip(next.chunks_exact_mut(TILE * padded)) {
                sums(weights, biases, values, least, out);
            }
            std::mem::swap(values, next);
        }
        for ((color, sums), added) in colors.iter_mut().zip(values.chunks_exact(padded)).zip(added)
        {
            color.clear();
            let (shown, added) = (sums.iter().take(batch.directions), added as f32);
            color.extend(shown.map(|sum| f64::from(lanes::sigmoid(*sum + added))));
        }
    }
}

impl Batch {
    /// Bytes of a batch of this many directions.
    pub(super) fn bytes(directions: usize, width: usize) -> u64 {
        (4 * directions.next_multiple_of(LANES) * width.next_multiple_of(TILE)) as u64
    }
}

/// The sums of [`TILE`] neurons along all directions, not below `least`. [`TILE`] rows of inputs
/// are added at once, in order, while the sums are in registers.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn sums(weights: &[f32], biases: &[f32], inputs: &[f32], least: f32, out: &mut [f32]) {
    let width = out.len() / TILE;
    for (sums, bias) in out.chunks_exact_mut(width).zip(biases) {
        sums.fill(*bias);
    }
    let (first, second) = out.split_at_mut(2 * width);
    let ((sums_a, sums_b), (sums_c, sums_d)) =
        (first.split_at_mut(width), second.split_at_mut(width));
    let tiles = weights.as_chunks::<TILE>().0.as_chunks::<TILE>().0;
    for ([a, b, c, d], rows) in tiles.iter().zip(inputs.chunks_exact(TILE * width)) {
        let (first, second) = rows.split_at(2 * width);
        let ((rows_a, rows_b), (rows_c, rows_d)) = (first.split_at(width), second.split_at(width));
        let rows = rows_a.iter().zip(rows_b).zip(rows_c).zip(rows_d);
        let sums = sums_a.iter_mut().zip(&mut *sums_b).zip(&mut *sums_c).zip(&mut *sums_d);
        for ((((sum_a, sum_b), sum_c), sum_d), (((in_a, in_b), in_c), in_d)) in sums.zip(rows) {
            *sum_a = *sum_a + a[0] * in_a + b[0] * in_b + c[0] * in_c + d[0] * in_d;
            *sum_b = *sum_b + a[1] * in_a + b[1] * in_b + c[1] * in_c + d[1] * in_d;
            *sum_c = *sum_c + a[2] * in_a + b[2] * in_b + c[2] * in_c + d[2] * in_d;
            *sum_d = *sum_d + a[3] * in_a + b[3] * in_b + c[3] * in_c + d[3] * in_d;
        }
    }
    out.iter_mut().for_each(|sum| *sum = sum.max(least));
}

#[cfg(test)]
mod tests {
    use super::super::run::Inputs;
    use super::*;

    /// Numbers from -0.5 to 0.5.
    fn noise(seed: &mut u32) -> f64 {
        *seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(*seed >> 8) / f64::from(1 << 24) - 0.5
    }

    #[test]
    fn batches_agree_with_the_plain_network() {
        let seed = &mut 7;
        let encodings = [[0, 0, 0], [2, 0, 1], [0, 3, 2]];
        for ([features, position, direction], widths) in
            encodings.into_iter().zip([&[3][..], &[9, 3], &[17, 6, 3]])
        {
            let inputs = Inputs { features, position, direction };
            let network = Network::of(5, inputs, widths, || noise(seed));
            let batches = BatchNetwork::new(&network);
            for count in [1, 16, 21] {
                let directions: Vec<[f64; 3]> = (0..count)
                    .map(|_| {
                        let at = [(); 3].map(|()| noise(seed) + 0.01);
                        let length = at.iter().map(|value| value * value).sum::<f64>().sqrt();
                        at.map(|value| value / length)
                    })
                    .collect();
                let batch = batches.batch(&network, &directions);
                let features: Vec<f64> = (0..5).map(|_| 4.0 * noise(seed)).collect();
                let at = [(); 3].map(|()| 2.0 * noise(seed));
                let mut colors = [(); 3].map(|()| Vec::new());
                let scratch = &mut Scratch::default();
                batches.colors(&network, &batch, &features, at, scratch, &mut colors);
                for (number, direction) in directions.into_iter().enumerate() {
                    let expected = network.color(&features, at, direction);
                    for (color, expected) in colors.iter().zip(expected) {
                        // Sums of float32 numbers of about 1.
                        assert!((color[number] - expected).abs() < 2e-6, "{widths:?} {count}");
                    }
                }
            }
        }
    }
}
