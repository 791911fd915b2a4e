//! From features to colours.

use super::read::{key, malformed, tensor};
use crate::base::error::{Error, Result};
use crate::base::limits::Budget;
use crate::model::harmonics::basis_f64;
use crate::network::{Inputs, Network, NetworkFile};
use crate::tensor::{Tensor, Value};

/// Added to the sum of harmonics.
const OFFSET: f64 = 0.5;
/// Functions of a colour in the shading `SH`.
pub(super) const STORED_FUNCTIONS: usize = 9;
/// Octaves of an encoding, at most.
const OCTAVES: i64 = 24;

/// A shading with unread weights.
#[derive(Debug, Clone)]
pub(super) enum ShadingFile {
    /// Features are colours.
    Rgb,
    /// Features are coefficients: nine of red, then of green, then of blue.
    Harmonics,
    /// Weights and biases of three layers.
    Network(NetworkFile),
}

impl ShadingFile {
    /// The shading of a model with this many features.
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
        let layer = |number: usize| -> Result<[Tensor; 2]> {
            let part = |kind: &str| tensor(state, &format!("renderModule.mlp.{number}.{kind}"));
            Ok([part("weight")?.clone(), part("bias")?.clone()])
        };
        let layers = vec![layer(0)?, layer(2)?, layer(4)?];
        NetworkFile::new(layers, inputs, features).map(Self::Network)
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

/// A shading in memory.
#[derive(Debug)]
pub(super) enum Shading {
    Rgb,
    Harmonics,
    Network(Network),
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
                color = network.color(features, at, direction);
            }
        }
        color
    }
}
