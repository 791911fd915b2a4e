//! The view-dependent network, `rgbnet`.
//!
//! Layers are the modules of a PyTorch `Sequential`, which may nest: `rgbnet.0`, `rgbnet.2.0`,
//! `rgbnet.3` hold the three layers of a network of depth 3. Their order is that of the dotted
//! indices, number by number.

use super::names::NamedValues;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, Budget, Limits};
use crate::model::view_mlp::{Layer, ViewInput, ViewMlp};
use crate::source::{Assumption, Family};
use crate::tensor::{Tensor, Value};

/// Default octaves of the direction's embedding.
const FREQUENCIES: usize = 4;
/// The most octaves that make sense in float32.
const MAX_FREQUENCIES: usize = 16;
/// The most layers that are read.
const LAYERS: u64 = 64;
/// Features of the deferred model.
const DEFERRED_FEATURES: usize = 4;

/// The network of a checkpoint whose colour has `features` more channels than three, if it has
/// one.
pub(super) fn find(
    names: &NamedValues<'_>,
    family: Family,
    features: usize,
    limits: &Limits,
    assumptions: &mut Vec<Assumption>,
) -> Result<Option<ViewMlp>> {
    let layers = layers(names, limits)?;
    if layers.is_empty() {
        return Ok(None);
    }
    let place = Place::Tensor("rgbnet".into());
    let frequencies = frequencies(names, assumptions)?;
    let mlp = ViewMlp::new(layers, frequencies, features, &place)?;
    // A plain DirectVoxGO network can have the width of a deferred one, but takes the features of
    // each sample.
    if family == Family::Dvgo && features != DEFERRED_FEATURES {
        let found = format!(
            "a colour grid of {} channels with a network of width {} that runs at every sample",
            features + 3,
            mlp.widths().first().copied().unwrap_or(0)
        );
        let expected = "a network that runs once per ray on 4 accumulated features (option mlp: \
                        none leaves the network out)";
        return Err(Error::unsupported(place, found, expected));
    }
    if mlp.input == ViewInput::Features && family == Family::Dvgo && !names.flag("rgbnet_direct")? {
        assumptions.push(Assumption {
            key: "mlp",
            value: "deferred".into(),
            message: "the network takes the embedding and 4 features: assuming that it runs once \
                      per ray; option mlp: none leaves it out"
                .into(),
        });
    }
    Ok(Some(mlp))
}

/// Weights and biases of the layers `rgbnet.0`, `rgbnet.2.0`, `rgbnet.3`, in the order of their
/// numbers.
///
/// # Errors
/// `Unsupported` for a layer without a number, `Malformed` for a weight without a bias, `OverLimit`
/// for too many.
pub fn layer_tensors<'a>(names: &NamedValues<'a>) -> Result<Vec<[&'a Tensor; 2]>> {
    let mut indices: Vec<(Vec<u64>, &str)> = Vec::new();
    for name in names.after("rgbnet.") {
        let Some(index) = name.strip_suffix(".weight") else { continue };
        let numbers: std::result::Result<Vec<u64>, _> = index.split('.').map(str::parse).collect();
        let numbers = numbers.map_err(|_| {
            let found = "a layer without a number";
            Error::unsupported(Place::Tensor(format!("rgbnet.{name}")), found, "rgbnet.0.weight")
        })?;
        indices.push((numbers, index));
    }
    indices.sort_unstable();
    let place = Place::Tensor("rgbnet".into());
    limits::check_fixed("layers", indices.len() as u64, LAYERS, &place)?;
    let tensor = |index: &str, part: &str| {
        let name = format!("rgbnet.{index}.{part}");
        names.tensor(&name).ok_or_else(|| {
            let expected = "a weight and a bias for each layer";
            Error::malformed(Place::Tensor(name.clone()), "no such tensor", expected)
        })
    };
    let layer = |(_, index): &(_, &str)| Ok([tensor(index, "weight")?, tensor(index, "bias")?]);
    indices.iter().map(layer).collect()
}

/// The layers in order.
fn layers(names: &NamedValues<'_>, limits: &Limits) -> Result<Vec<Layer>> {
    let mut budget = Budget::new(limits);
    let tensors = layer_tensors(names)?;
    tensors.into_iter().map(|tensors| layer(tensors, &mut budget)).collect()
}

fn layer([weight, bias]: [&Tensor; 2], budget: &mut Budget) -> Result<Layer> {
    let (&[outputs, inputs], &[biases]) = (weight.shape(), bias.shape()) else {
        let found = format!("shapes {:?} and {:?}", weight.shape(), bias.shape());
        return Err(Error::malformed(weight.place(), found, "[outputs, inputs] and [outputs]"));
    };
    if outputs != biases || outputs == 0 || inputs == 0 {
        let found = format!("{outputs} x {inputs} weights and {biases} biases");
        return Err(Error::malformed(weight.place(), found, "a bias for each output"));
    }
    let count = |size| crate::base::limits::product(&[size], "layer width", &weight.place());
    Ok(Layer {
        inputs: count(inputs)?,
        outputs: count(outputs)?,
        weights: finite(weight, budget)?,
        bias: finite(bias, budget)?,
    })
}

fn finite(tensor: &Tensor, budget: &mut Budget) -> Result<Vec<f32>> {
    let values = tensor.read_f32(budget)?;
    match values.iter().find(|value| !value.is_finite()) {
        None => Ok(values),
        Some(value) => {
            Err(Error::malformed(tensor.place(), format!("the weight {value}"), "finite weights"))
        }
    }
}

/// Octaves of the direction's embedding: `viewfreq` lists 1, 2, 4, ...
fn frequencies(names: &NamedValues<'_>, assumptions: &mut Vec<Assumption>) -> Result<usize> {
    let place = Place::Tensor("viewfreq".into());
    if let Some(tensor) = names.tensor("viewfreq") {
        let count = match *tensor.shape() {
            [count] if count <= MAX_FREQUENCIES as u64 => count,
            _ => {
                let found = format!("shape {:?}", tensor.shape());
                return Err(Error::malformed(place, found, "at most 16 frequencies"));
            }
        };
        // For a tensor without elements, only the direction itself is embedded.
        let found = if count == 0 {
            Vec::new()
        } else {
            Value::Tensor(tensor.clone()).numbers("viewfreq")?
        };
        let expected = std::iter::successors(Some(1.0), |frequency| Some(frequency * 2.0));
        if !found.iter().zip(expected).all(|(&found, expected)| found == expected) {
            let found = format!("frequencies {found:?}");
            return Err(Error::unsupported(place, found, "1, 2, 4, ..."));
        }
        return Ok(found.len());
    }
    if let Some(value) = names.setting("viewbase_pe") {
        let count = value.integer("model_kwargs.viewbase_pe")?;
        return usize::try_from(count).ok().filter(|&n| n <= MAX_FREQUENCIES).ok_or_else(|| {
            let place = Place::Key("model_kwargs.viewbase_pe".into());
            Error::malformed(place, count.to_string(), "0 to 16 frequencies")
        });
    }
    assumptions.push(Assumption {
        key: "viewfreq",
        value: FREQUENCIES.to_string(),
        message: format!(
            "neither viewfreq nor viewbase_pe is stored: assuming that directions are embedded \
             with {FREQUENCIES} octaves"
        ),
    });
    Ok(FREQUENCIES)
}
