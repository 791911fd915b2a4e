//! From features to colours.

use super::read::{key, malformed, tensor};
use crate::base::error::{Error, Result};
use crate::base::limits::Budget;
use crate::input::tensor::{Tensor, Value};
use crate::model::activate;
use crate::model::harmonics::basis_f64;

/// Added to the sum of harmonics.
const OFFSET: f64 = 0.5;
/// Functions of a colour in the shading `SH`.
pub(super) const STORED_FUNCTIONS: usize = 9;
/// Octaves of an encoding, at most.
const OCTAVES: i64 = 24;

/// The inputs of a network beside features and directions, in octaves.
#[derive(Debug, Clone, Copy)]
struct Inputs {
    features: u32,
    position: u32,
    direction: u32,
}

/// A shading that was found; its weights are not yet read.
#[derive(Debug, Clone)]
pub(super) enum ShadingFile {
    /// Features are colours.
    Rgb,
    /// Features are coefficients: nine of red, then of green, then of blue.
    Harmonics,
    /// Weights and biases of three layers.
    Network(NetworkFile),
}

/// The arrays of a network.
#[derive(Debug, Clone)]
pub(super) struct NetworkFile {
    layers: [[Tensor; 2]; 3],
    inputs: Inputs,
}

impl ShadingFile {
    /// The shading of a model with so many features.
    pub(super) fn find(kwargs: &Value, state: &Value, features: usize) -> Result<Self> {
        let octaves = |name: &str| -> Result<u32> {
            let found = kwargs.get(name).map_or(Ok(0), |value| value.integer(name))?;
            match found {
                0..=OCTAVES => Ok(u32::try_from(found).unwrap_or(0)),
                _ => Err(malformed(name, found.to_string(), "0 to 24 octaves")),
            }
        };
        let require = |count: usize| match features == count {
            true => Ok(()),
            false => Err(malformed("app_dim", features.to_string(), count.to_string())),
        };
        let name = match kwargs.get("shadingMode") {
            Some(Value::Text(name)) => name.as_str(),
            other => {
                let found = other.map_or_else(|| "none".to_owned(), Value::describe);
                return Err(malformed("shadingMode", found, "the name of a shading"));
            }
        };
        let none = Inputs { features: 0, position: 0, direction: octaves("view_pe")? };
        let inputs = match name {
            "RGB" => return require(3).map(|()| Self::Rgb),
            "SH" => return require(3 * STORED_FUNCTIONS).map(|()| Self::Harmonics),
            "MLP_Fea" => Inputs { features: octaves("fea_pe")?, ..none },
            "MLP_PE" => Inputs { position: octaves("pos_pe")?, ..none },
            "MLP" => none,
            other => {
                let expected = "MLP_Fea, MLP_PE, MLP, SH or RGB";
                return Err(Error::unsupported(key("shadingMode"), other, expected));
            }
        };
        NetworkFile::find(state, inputs, features).map(Self::Network)
    }

    /// Reads the weights.
    pub(super) fn load(&self, budget: &mut Budget) -> Result<Shading> {
        match self {
            Self::Rgb => Ok(Shading::Rgb),
            Self::Harmonics => Ok(Shading::Harmonics),
            Self::Network(file) => file.load(budget).map(Shading::Network),
        }
    }
}

impl NetworkFile {
    fn find(state: &Value, inputs: Inputs, features: usize) -> Result<Self> {
        let layer = |number: usize| -> Result<[Tensor; 2]> {
            let part = |kind: &str| tensor(state, &format!("renderModule.mlp.{number}.{kind}"));
            Ok([part("weight")?.clone(), part("bias")?.clone()])
        };
        let layers = [layer(0)?, layer(2)?, layer(4)?];
        let octaves = |octaves: u32, width: usize| 2 * octaves as usize * width;
        let mut width = features + 3 + octaves(inputs.features, features);
        width += octaves(inputs.position, 3) + octaves(inputs.direction, 3);
        for (number, [weight, bias]) in layers.iter().enumerate() {
            let (&[rows, columns], &[biases]) = (weight.shape(), bias.shape()) else {
                let found = format!("shapes {:?} and {:?}", weight.shape(), bias.shape());
                return Err(Error::malformed(weight.place(), found, "a matrix and a vector"));
            };
            let last = number == 2;
            let fits = columns == width as u64
                && rows == biases
                && if last { rows == 3 } else { (1..=1024).contains(&rows) };
            if !fits {
                let found = format!("shapes {:?} and {:?}", weight.shape(), bias.shape());
                let rows = if last { "3" } else { "1 to 1024" };
                let expected = format!("[{rows}, {width}], and as many biases");
                return Err(Error::malformed(weight.place(), found, expected));
            }
            width = usize::try_from(rows).unwrap_or(0);
        }
        Ok(Self { layers, inputs })
    }

    fn load(&self, budget: &mut Budget) -> Result<Network> {
        let mut layers = Vec::new();
        for [weight, bias] in &self.layers {
            let (stored, biases) = (weight.read_f32(budget)?, bias.read_f32(budget)?);
            if stored.iter().chain(&biases).any(|value| !value.is_finite()) {
                return Err(Error::malformed(weight.place(), "no number", "finite numbers"));
            }
            let (outputs, inputs) = (biases.len(), stored.len() / biases.len().max(1));
            // Input by input, so that sums run over outputs.
            let mut weights: Vec<f64> =
                budget.zeroed(stored.len(), "bytes of a network", &weight.place())?;
            for (output, row) in stored.chunks_exact(inputs).enumerate() {
                let out = weights.iter_mut().skip(output).step_by(outputs);
                out.zip(row).for_each(|(out, value)| *out = f64::from(*value));
            }
            layers.push(Layer { weights, biases: biases.into_iter().map(f64::from).collect() });
        }
        Ok(Network { layers, inputs: self.inputs })
    }
}

/// A shading in memory.
#[derive(Debug)]
pub(super) enum Shading {
    Rgb,
    Harmonics,
    Network(Network),
}

/// A network that is run for each sample.
#[derive(Debug)]
pub(super) struct Network {
    layers: Vec<Layer>,
    inputs: Inputs,
}

#[derive(Debug)]
struct Layer {
    weights: Vec<f64>,
    biases: Vec<f64>,
}

impl Shading {
    /// The colour of features at a position (-1 to 1 in the box) seen along a unit direction.
    pub(super) fn color(&self, features: &[f64], at: [f64; 3], direction: [f64; 3]) -> [f64; 3] {
        let mut color = [0.0; 3];
        match self {
            Self::Rgb => color.iter_mut().zip(features).for_each(|(out, value)| *out = *value),
            Self::Harmonics => {
                let functions = basis_f64(direction);
                let colors = features.chunks_exact(STORED_FUNCTIONS);
                for (out, coefficients) in color.iter_mut().zip(colors) {
                    let terms = functions.iter().zip(coefficients);
                    let sum: f64 = terms.map(|(function, value)| function * value).sum();
                    *out = (sum + OFFSET).max(0.0);
                }
            }
            Self::Network(network) => {
                let seen = network.run(features, at, direction);
                color.iter_mut().zip(seen).for_each(|(out, value)| *out = activate::sigmoid(value));
            }
        }
        color
    }
}

impl Network {
    fn run(&self, features: &[f64], at: [f64; 3], direction: [f64; 3]) -> Vec<f64> {
        let mut values: Vec<f64> = features.iter().copied().chain(direction).collect();
        encode(features, self.inputs.features, &mut values);
        encode(&at, self.inputs.position, &mut values);
        encode(&direction, self.inputs.direction, &mut values);
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
        values
    }
}

/// Adds the sines of all values by octave, then the cosines.
fn encode(values: &[f64], octaves: u32, out: &mut Vec<f64>) {
    for wave in [libm::sin as fn(f64) -> f64, libm::cos] {
        for value in values {
            out.extend((0..octaves).map(|octave| wave(value * f64::from(1u32 << octave))));
        }
    }
}
