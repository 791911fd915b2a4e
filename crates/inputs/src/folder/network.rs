//! The network of a folder, which runs once per ray.

use crate::base::error::{Error, Place, Result};
use crate::base::limits::Budget;
use crate::model::view_mlp::{Layer, ViewMlp};
use crate::snerg::layout::{FEATURES, NEARLY_ZERO, OCTAVES, folder_input};
use crate::tensor::{TensorFile, Value};

/// Layers.
const LAYERS: usize = 3;
/// Widest layer.
const WIDEST: u64 = 64;

/// The order in which a folder's network takes its inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputOrder {
    /// SNeRG's: the direction with its sines and cosines, then colours and features.
    DirectionFirst,
    /// MERF's: colours and features, then the direction with its sines and cosines.
    ValuesFirst,
}

impl InputOrder {
    /// The index in the folder of an input in this program's order.
    fn place(self, input: usize) -> usize {
        let direction = 3 + 6 * OCTAVES;
        match self {
            Self::DirectionFirst => folder_input(input),
            Self::ValuesFirst if input < direction => 3 + FEATURES + folder_input(input),
            Self::ValuesFirst => input - direction,
        }
    }
}

/// The network, with its inputs in this program's order; none for a folder of diffuse colours.
///
/// # Errors
/// `Malformed` for layers that do not fit each other, and for weights that are not finite.
pub fn read_network(
    file: &TensorFile,
    order: InputOrder,
    budget: &mut Budget,
) -> Result<Option<ViewMlp>> {
    if file.root.get("0_bias").is_none_or(Value::is_none) {
        return Ok(None);
    }
    let mut layers = Vec::with_capacity(LAYERS);
    for number in 0..LAYERS {
        layers.push(layer(file, number, order, budget)?);
    }
    let place = Place::Key("0_weights".to_owned());
    ViewMlp::new(layers, OCTAVES, FEATURES, &place).map(Some)
}

/// A value for the network: tiny values become 0.
pub(super) fn narrow(value: f64) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "networks are float32")]
    let value = value as f32;
    if value.abs() < NEARLY_ZERO { 0.0 } else { value }
}

fn layer(
    file: &TensorFile,
    number: usize,
    order: InputOrder,
    budget: &mut Budget,
) -> Result<Layer> {
    let (weights, bias) = (format!("{number}_weights"), format!("{number}_bias"));
    let place = Place::Key(weights.clone());
    let stored = file.root.get(&weights).unwrap_or(&Value::None);
    let (inputs, outputs) = match stored.tensor().map(|tensor| tensor.shape()) {
        Some(&[inputs @ 1..=WIDEST, outputs @ 1..=WIDEST]) => (inputs, outputs),
        _ => {
            let expected = format!("numbers [inputs, outputs], 1 to {WIDEST} each");
            return Err(Error::malformed(place, stored.describe(), expected));
        }
    };
    let values = match stored.tensor() {
        Some(tensor) => tensor.read_f32(budget)?,
        None => Vec::new(),
    };
    let numbers = file.root.get(&bias).unwrap_or(&Value::None).numbers(&bias)?;
    #[expect(clippy::cast_possible_truncation, reason = "checked below")]
    let bias: Vec<f32> = numbers.into_iter().map(|value| value as f32).collect();
    if values.iter().chain(&bias).any(|value| !value.is_finite()) {
        return Err(Error::malformed(
            place,
            "a weight that is not a finite float32",
            "finite weights",
        ));
    }
    let [inputs, outputs] = [inputs, outputs].map(|width| usize::try_from(width).unwrap_or(0));
    // A folder has the weights input by input, and sines and cosines of a direction by octave.
    let row = |input: usize| if number == 0 { order.place(input) } else { input };
    let of_output = |output: usize| (0..inputs).map(move |input| row(input) * outputs + output);
    let places = (0..outputs).flat_map(of_output);
    let weights = places.map(|at| values.get(at).copied().unwrap_or(0.0)).collect();
    Ok(Layer { inputs, outputs, weights, bias })
}
