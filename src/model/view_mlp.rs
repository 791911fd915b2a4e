//! View-dependent colour: a tiny network, evaluated once a ray.
//!
//! ```text
//! e   = [d, sin(2^k d), cos(2^k d)], k = 0..frequencies
//! c_s = sigmoid(W2 relu(W1 relu(W0 [e, A] + b0) + b1) + b2)
//! ```
//!
//! `d` is the unit view direction in world space and `A` the ray's accumulated colour and features.
//! The embedding is coordinate-major: `d` (3), then all sines, then all cosines, each ordered x*1,
//! x*2, x*4, x*8, y*1, ... , z*8.

use crate::base::error::{Error, Place, Result};
use crate::model::activate::lanes;

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

/// The rest of the first layer's input, after the embedding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ViewInput {
    /// Accumulated diffuse colour, then the accumulated features.
    DiffuseAndFeatures,
    /// The accumulated features alone.
    Features,
}

/// The network: relu between layers, sigmoid after the last.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewMlp {
    /// First to last; each layer's input is as wide as the output before it, the last gives RGB.
    pub layers: Vec<Layer>,
    /// Octaves of the direction embedding.
    pub frequencies: usize,
    /// The rest of the first layer's input, after the embedding.
    pub input: ViewInput,
}

impl ViewMlp {
    /// Fits layers to a field of `features` specular features, or says why they do not fit.
    ///
    /// # Errors
    /// `Unsupported` where the first layer is not as wide as an embedding with the accumulated
    /// values, `Malformed` where layers do not join or the last does not give three colours.
    pub fn new(
        layers: Vec<Layer>,
        frequencies: usize,
        features: usize,
        place: &Place,
    ) -> Result<Self> {
        let input = input_of(&layers, frequencies, features, place)?;
        Ok(Self { layers, frequencies, input })
    }

    /// Refuses a network that does not fit a field of `features` specular features.
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
        let first = self.layers.first().map(|layer| layer.inputs);
        first.into_iter().chain(self.layers.iter().map(|layer| layer.outputs)).collect()
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
    // Both are small wherever they were checked; where not, no width fits.
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

/// The sum of products, in eight sums side by side.
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
        let embedding = 3 + 6 * self.frequencies;
        let skip = match self.input {
            ViewInput::DiffuseAndFeatures => 0,
            ViewInput::Features => 3,
        };
        let width = self.layers.first().map_or(0, |layer| layer.inputs);
        let mut values = vec![[0.0f32; RAYS]; width];
        for (ray, (direction, accumulated)) in directions.iter().zip(accumulated).enumerate() {
            self.embed(*direction, |i, value| values[i][ray] = value as f32);
            for (i, &value) in accumulated[skip..].iter().take(width - embedding).enumerate() {
                values[embedding + i][ray] = value;
            }
        }
        for (number, layer) in self.layers.iter().enumerate() {
            let is_last = number + 1 == self.layers.len();
            values = layer.apply(&values, is_last);
        }
        std::array::from_fn(|ray| std::array::from_fn(|channel| values[channel][ray]))
    }

    /// The network's input of one ray.
    fn input(&self, direction: [f64; 3], accumulated: &[f32]) -> Vec<f32> {
        let skip = if self.input == ViewInput::Features { 3 } else { 0 };
        let mut values = vec![0.0; 3 + 6 * self.frequencies];
        self.embed(direction, |i, value| values[i] = value as f32);
        values.extend_from_slice(&accumulated[skip..]);
        values
    }

    /// The error of one ray, which is `error` of its view-dependent colour, and the derivative of
    /// half the squared error by the ray's accumulated values, through the network alone.
    pub fn differentiate(
        &self,
        direction: [f64; 3],
        accumulated: &[f32],
        error: impl Fn([f32; 3]) -> [f32; 3],
    ) -> ([f32; 3], Vec<f32>) {
        let mut values = vec![self.input(direction, accumulated)];
        for (number, layer) in self.layers.iter().enumerate() {
            let is_last = number + 1 == self.layers.len();
            let input = &values[number];
            let rows = layer.weights.chunks_exact(layer.inputs).zip(&layer.bias);
            let output = rows.map(|(weights, bias)| {
                let sum = bias + dot(weights, input);
                if is_last { lanes::sigmoid(sum) } else { sum.max(0.0) }
            });
            let output = output.collect();
            values.push(output);
        }
        let color = &values[self.layers.len()];
        let errors = error([color[0], color[1], color[2]]);
        let slope = |(error, color): (&f32, &f32)| error * color * (1.0 - color);
        let mut by: Vec<f32> = errors.iter().zip(color).map(slope).collect();
        for (number, layer) in self.layers.iter().enumerate().rev() {
            let mut by_input = vec![0.0; layer.inputs];
            for (weights, by) in layer.weights.chunks_exact(layer.inputs).zip(&by) {
                by_input.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight * by);
            }
            // If a relu lets nothing through, the layers before it have no effect.
            if number > 0 {
                let closed = by_input.iter_mut().zip(&values[number]).filter(|(_, v)| **v <= 0.0);
                closed.for_each(|(by, _)| *by = 0.0);
            }
            by = by_input;
        }
        let embedding = 3 + 6 * self.frequencies;
        let skip = accumulated.len() - (by.len() - embedding);
        (errors, [vec![0.0; skip], by.split_off(embedding)].concat())
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

impl Layer {
    fn apply(&self, inputs: &[[f32; RAYS]], is_last: bool) -> Vec<[f32; RAYS]> {
        let rows = self.weights.chunks_exact(self.inputs.max(1)).zip(&self.bias);
        rows.map(|(weights, &bias)| {
            let mut sums = [bias; RAYS];
            for (input, &weight) in inputs.iter().zip(weights) {
                for ray in 0..RAYS {
                    sums[ray] += weight * input[ray];
                }
            }
            match is_last {
                true => sums.map(lanes::sigmoid),
                false => sums.map(|sum| sum.max(0.0)),
            }
        })
        .collect()
    }
}
