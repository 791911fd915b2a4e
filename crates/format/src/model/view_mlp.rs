//! View-dependent colour: a tiny network, evaluated once per ray.
//!
//! ```text
//! e   = [d, sin(2^k d), cos(2^k d)], k = 0..frequencies
//! c_s = sigmoid(W2 relu(W1 relu(W0 [e, A] + b0) + b1) + b2)
//! ```
//!
//! `d` is the unit view direction in world space and `A` the ray's accumulated colour and features.
//! The embedding is coordinate-major: `d` (3), then all sines, then all cosines, each ordered x*1,
//! x*2, x*4, x*8, y*1, ... , z*8.

use multiversion::multiversion;

use crate::base::error::{Error, Place, Result};
use crate::model::activate::lanes;
pub use crate::model::generated::ViewInput;

/// A dense layer: `out = weights * in + bias`.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Width of the input.
    pub inputs: usize,
    /// Width of the output.
    pub outputs: usize,
    /// `[outputs, inputs]`, C order.
    pub weights: Vec<f32>,
    /// `[outputs]`.
    pub bias: Vec<f32>,
}

/// The network: relu between layers, sigmoid after the last.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewMlp {
    /// First to last. Each layer has as many inputs as the previous one has outputs; the last gives
    /// RGB.
    pub layers: Vec<Layer>,
    /// Octaves of the direction embedding.
    pub frequencies: usize,
    /// The rest of the first layer's input, after the embedding.
    pub input: ViewInput,
}

impl ViewMlp {
    /// Makes a network for a field with `features` specular features, if the layers fit it.
    ///
    /// # Errors
    /// `Unsupported` if the width of the first layer does not match an embedding with the
    /// accumulated values, `Malformed` if layers do not match each other or the last does not have
    /// three outputs.
    pub fn new(
        layers: Vec<Layer>,
        frequencies: usize,
        features: usize,
        place: &Place,
    ) -> Result<Self> {
        let input = input_of(&layers, frequencies, features, place)?;
        Ok(Self { layers, frequencies, input })
    }

    /// Refuses a network that does not fit a field with `features` specular features.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn check(&self, features: usize, place: &Place) -> Result<()> {
        if input_of(&self.layers, self.frequencies, features, place)? == self.input {
            return Ok(());
        }
        let found = format!("{:?}", self.input);
        Err(Error::malformed(place.clone(), found, "the input that the first layer is wide for"))
    }

    /// Widths from input to output.
    pub fn widths(&self) -> Vec<usize> {
        self.each_width().collect()
    }

    fn each_width(&self) -> impl Iterator<Item = usize> {
        let first = self.layers.first().map(|layer| layer.inputs);
        first.into_iter().chain(self.layers.iter().map(|layer| layer.outputs))
    }
}

/// The input that layers are made for; see [`ViewMlp::new`].
fn input_of(
    layers: &[Layer],
    frequencies: usize,
    features: usize,
    place: &Place,
) -> Result<ViewInput> {
    let widths: Vec<_> = layers.iter().map(|layer| (layer.inputs, layer.outputs)).collect();
    let joined = widths.windows(2).all(|pair| pair[0].1 == pair[1].0);
    let is_whole = |layer: &Layer| {
        let weights = layer.inputs.checked_mul(layer.outputs);
        weights == Some(layer.weights.len()) && layer.bias.len() == layer.outputs
    };
    let joined = joined && layers.iter().all(is_whole);
    let (Some(&(first, _)), Some(&(_, 3)), true) = (widths.first(), widths.last(), joined) else {
        return Err(Error::malformed(
            place.clone(),
            format!("layers of (inputs, outputs) {widths:?}"),
            "layers that join, with 3 outputs at the end",
        ));
    };
    // Both are small if they were checked; otherwise no width fits.
    let embedding = frequencies.saturating_mul(6).saturating_add(3);
    match first.checked_sub(embedding) {
        Some(rest) if rest == features.saturating_add(3) => Ok(ViewInput::DiffuseAndFeatures),
        Some(rest) if rest == features => Ok(ViewInput::Features),
        _ => Err(Error::unsupported(
            place.clone(),
            format!("a first layer {first} wide"),
            format!(
                "{} for a network that runs once a ray on {features} features ({} without \
                         the diffuse colour); networks that run for each sample cannot be baked, \
                         option mlp: none leaves the network out",
                embedding.saturating_add(features).saturating_add(3),
                embedding.saturating_add(features)
            ),
        )),
    }
}

/// Reusable memory of [`ViewMlp::differentiate`].
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    /// Inputs of layers, then the output.
    values: Vec<Vec<f32>>,
    /// Derivatives by them.
    by: Vec<Vec<f32>>,
}

/// A layer's output of one ray.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn apply(layer: &Layer, input: &[f32], is_last: bool, output: &mut [f32]) {
    let rows = layer.weights.chunks_exact(layer.inputs).zip(&layer.bias);
    for ((weights, bias), output) in rows.zip(output) {
        let sum = bias + dot(weights, input);
        *output = if is_last { lanes::sigmoid(sum) } else { sum.max(0.0) };
    }
}

/// Adds the derivative by a layer's input, given the derivative `by` by its output before the
/// activation.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn apply_transposed(layer: &Layer, by: &[f32], by_input: &mut [f32]) {
    for (weights, by) in layer.weights.chunks_exact(layer.inputs).zip(by) {
        by_input.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight * by);
    }
}

/// The dot product, as eight parallel sums.
#[inline(always)]
fn dot(weights: &[f32], values: &[f32]) -> f32 {
    let (weights, last_weights) = weights.as_chunks::<8>();
    let (values, last) = values.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for (weights, values) in weights.iter().zip(values) {
        for lane in 0..8 {
            sums[lane] += weights[lane] * values[lane];
        }
    }
    let last = last_weights.iter().zip(last).map(|(weight, value)| weight * value);
    sums.into_iter().chain(last).sum()
}

/// Rays whose colours are computed together.
pub const RAYS: usize = 16;

impl ViewMlp {
    /// View-dependent colour of up to [`RAYS`] rays: `directions` of unit length, and each ray's
    /// accumulated values, diffuse colour first.
    pub fn colors(&self, directions: &[[f64; 3]], accumulated: &[&[f32]]) -> [[f32; 3]; RAYS] {
        let embedding = self.embedding();
        let width = self.layers.first().map_or(0, |layer| layer.inputs);
        let mut values = vec![[0.0f32; RAYS]; width];
        for (ray, (direction, accumulated)) in directions.iter().zip(accumulated).enumerate() {
            self.embed(*direction, |i, value| values[i][ray] = value as f32);
            let own = accumulated[self.skipped()..].iter();
            for (i, &value) in own.take(width - embedding).enumerate() {
                values[embedding + i][ray] = value;
            }
        }
        self.through(values, 0)
    }

    /// The part of the first layer's sums that depends on the directions of up to [`RAYS`] rays
    /// alone, by output, for [`Self::colors_of_sums`].
    pub fn direction_sums(&self, directions: &[[f64; 3]]) -> Vec<[f32; RAYS]> {
        let mut inputs = vec![[0.0f32; RAYS]; self.embedding()];
        for (ray, direction) in directions.iter().enumerate() {
            self.embed(*direction, |i, value| inputs[i][ray] = value as f32);
        }
        let Some(layer) = self.layers.first() else { return Vec::new() };
        let rows = layer.weights.chunks_exact(layer.inputs).zip(&layer.bias);
        let sums = rows.map(|(weights, &bias)| {
            let pairs = weights.iter().zip(&inputs);
            pairs.fold([bias; RAYS], |sums, (weight, input)| {
                std::array::from_fn(|ray| sums[ray] + weight * input[ray])
            })
        });
        sums.collect()
    }

    /// As [`Self::colors`], from the [`Self::direction_sums`] of the rays, which leaves a third of
    /// the work. `accumulated` has the values of each ray, or common ones for all. Sums are rounded
    /// in another order.
    pub fn colors_of_sums(&self, sums: &[[f32; RAYS]], accumulated: &[&[f32]]) -> [[f32; 3]; RAYS] {
        let Some(layer) = self.layers.first() else { return [[0.0; 3]; RAYS] };
        let inputs = [self.embedding(), self.skipped()];
        self.through(first_of_sums(layer, inputs, sums, accumulated, self.layers.len() == 1), 1)
    }

    /// Numbers of the embedding of a direction: the first inputs of the first layer.
    fn embedding(&self) -> usize {
        3 + 6 * self.frequencies
    }

    /// Accumulated values that the network does not take.
    fn skipped(&self) -> usize {
        match self.input {
            ViewInput::DiffuseAndFeatures => 0,
            ViewInput::Features => 3,
        }
    }

    /// Propagates values through this and all following layers.
    fn through(&self, mut values: Vec<[f32; RAYS]>, first: usize) -> [[f32; 3]; RAYS] {
        for (number, layer) in self.layers.iter().enumerate().skip(first) {
            let is_last = number + 1 == self.layers.len();
            values = apply_to_rays(layer, &values, is_last);
        }
        std::array::from_fn(|ray| std::array::from_fn(|channel| values[channel][ray]))
    }

    /// The error of one ray, which is `error` of its view-dependent colour. `by_accumulated`
    /// becomes the derivative of half the squared error by the ray's accumulated values, through
    /// the network alone.
    pub fn differentiate(
        &self,
        direction: [f64; 3],
        accumulated: &[f32],
        error: impl Fn([f32; 3]) -> [f32; 3],
        by_accumulated: &mut [f32],
        workspace: &mut Workspace,
    ) -> [f32; 3] {
        let embedding = self.embedding();
        let Workspace { values, by } = workspace;
        values.resize_with(self.layers.len() + 1, Vec::new);
        by.resize_with(self.layers.len() + 1, Vec::new);
        for (values, width) in values.iter_mut().zip(self.each_width()) {
            values.resize(width, 0.0);
        }
        let skip = accumulated.len() - (values[0].len() - embedding);
        self.embed(direction, |i, value| values[0][i] = value as f32);
        values[0][embedding..].copy_from_slice(&accumulated[skip..]);
        for (number, layer) in self.layers.iter().enumerate() {
            let is_last = number + 1 == self.layers.len();
            let (before, after) = values.split_at_mut(number + 1);
            apply(layer, &before[number], is_last, &mut after[0]);
        }
        let color = &values[self.layers.len()];
        let errors = error([color[0], color[1], color[2]]);
        let slope = |(error, color): (&f32, &f32)| error * color * (1.0 - color);
        by[self.layers.len()].clear();
        by[self.layers.len()].extend(errors.iter().zip(color).map(slope));
        for (number, layer) in self.layers.iter().enumerate().rev() {
            let (before, after) = by.split_at_mut(number + 1);
            let by_input = &mut before[number];
            by_input.clear();
            by_input.resize(layer.inputs, 0.0);
            apply_transposed(layer, &after[0], by_input);
            // If a relu is 0 everywhere, the layers before it have no effect.
            if number > 0 {
                let closed = by_input.iter_mut().zip(&values[number]).filter(|(_, v)| **v <= 0.0);
                closed.for_each(|(by, _)| *by = 0.0);
            }
        }
        by_accumulated[..skip].fill(0.0);
        by_accumulated[skip..].copy_from_slice(&by[0][embedding..]);
        errors
    }

    /// The embedding of a direction, by its numbers in the first layer's input.
    fn embed(&self, direction: [f64; 3], mut put: impl FnMut(usize, f64)) {
        for (axis, &value) in direction.iter().enumerate() {
            put(axis, value);
            let (mut sine, mut cosine) = libm::sincos(value);
            for octave in 0..self.frequencies {
                put(3 + axis * self.frequencies + octave, sine);
                put(3 + (3 + axis) * self.frequencies + octave, cosine);
                (sine, cosine) = (2.0 * sine * cosine, (cosine - sine) * (cosine + sine));
            }
        }
    }
}

/// Sums of a layer after its last function.
#[inline(always)]
fn activated(sums: [f32; RAYS], is_last: bool) -> [f32; RAYS] {
    match is_last {
        true => sums.map(lanes::sigmoid),
        false => sums.map(|sum| sum.max(0.0)),
    }
}

/// A layer's outputs of [`RAYS`] rays side by side.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn apply_to_rays(layer: &Layer, inputs: &[[f32; RAYS]], is_last: bool) -> Vec<[f32; RAYS]> {
    let mut outputs = Vec::with_capacity(layer.bias.len());
    for (weights, &bias) in layer.weights.chunks_exact(layer.inputs.max(1)).zip(&layer.bias) {
        let mut sums = [bias; RAYS];
        for (input, &weight) in inputs.iter().zip(weights) {
            for ray in 0..RAYS {
                sums[ray] += weight * input[ray];
            }
        }
        outputs.push(activated(sums, is_last));
    }
    outputs
}

/// The first layer's outputs of [`RAYS`] rays, from the sums of their directions. Its inputs after
/// the embedding are the accumulated values after the skipped ones.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn first_of_sums(
    layer: &Layer,
    [embedding, skipped]: [usize; 2],
    sums: &[[f32; RAYS]],
    accumulated: &[&[f32]],
    is_last: bool,
) -> Vec<[f32; RAYS]> {
    let mut outputs = Vec::with_capacity(layer.bias.len());
    for (weights, sums) in layer.weights.chunks_exact(layer.inputs).zip(sums) {
        let own = |accumulated: &[f32]| dot(&weights[embedding..], &accumulated[skipped..]);
        let mut lanes = *sums;
        if let [all] = accumulated {
            let own = own(all);
            lanes.iter_mut().for_each(|lane| *lane += own);
        } else {
            lanes.iter_mut().zip(accumulated).for_each(|(lane, values)| *lane += own(values));
        }
        outputs.push(activated(lanes, is_last));
    }
    outputs
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The network's derivatives against differences of its own colours.
    #[test]
    fn the_network_is_differentiated() {
        let wave = |at: usize, by: f32| 0.6 * libm::sinf(at as f32 * by);
        let layer = |inputs: usize, outputs: usize| {
            let weights = (0..inputs * outputs).map(|at| wave(at, 1.7)).collect();
            Layer { inputs, outputs, weights, bias: (0..outputs).map(|at| wave(at, 2.3)).collect() }
        };
        for rest in [4, 7] {
            let layers = vec![layer(27 + rest, 16), layer(16, 16), layer(16, 3)];
            let network = ViewMlp::new(layers, 4, 4, &Place::File).expect("a network");
            let (direction, target) = ([0.48, -0.6, 0.64], [0.2f32, 0.9, 0.4]);
            let accumulated: Vec<f32> = (0..7).map(|i| 0.1 + 0.11 * i as f32).collect();
            let color = |accumulated: &[f32]| network.colors(&[direction], &[accumulated])[0];
            let half_square = |accumulated: &[f32]| -> f64 {
                let errors = color(accumulated).into_iter().zip(target);
                errors.map(|(got, want)| 0.5 * f64::from(got - want).powi(2)).sum()
            };
            let error = |got: [f32; 3]| [0, 1, 2].map(|c| got[c] - target[c]);
            let mut workspace = Workspace::default();
            // Old content of the memory does not affect the next call.
            for _ in 0..2 {
                let mut by = [9.0; 7];
                let errors =
                    network.differentiate(direction, &accumulated, error, &mut by, &mut workspace);
                let want = error(color(&accumulated));
                assert!((0..3).all(|c| (errors[c] - want[c]).abs() < 1e-6), "{errors:?} {want:?}");
                for (channel, by) in by.iter().enumerate() {
                    let moved = |by: f32| {
                        let mut moved = accumulated.clone();
                        moved[channel] += by;
                        half_square(&moved)
                    };
                    let slope = (moved(1e-2) - moved(-1e-2)) / 2e-2;
                    let off = (slope - f64::from(*by)).abs();
                    assert!(off < 2e-4, "channel {channel}: {by} for {slope}");
                }
            }
        }
    }
}
