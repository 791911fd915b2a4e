//! Opens a checkpoint whose network runs for every sample.

use std::sync::Arc;

use super::colors::FittedColors;
use super::model::DvgoFile;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::input::checkpoint;
use crate::input::network::{Inputs, NetworkFile};
use crate::input::options::{MlpChoice, SourceOptions, ViewChoice};
use crate::input::source::{Assumption, Family, Source};
use crate::input::tensor::{Tensor, TensorFile, Value};
use crate::model::field::{ColorDomain, Grid};
use crate::model::harmonics::{Clamp, Evaluation, Harmonics};
use crate::model::view_dependence::ViewDependence;

/// Channels of `k0` whose network runs once a ray.
const DEFERRED_CHANNELS: u64 = 7;
/// Octaves of a direction, at most.
const OCTAVES: u64 = 16;
/// Added to the sum of harmonics.
const OFFSET: f32 = 0.5;
/// The degree of a fit that nobody asked for another of.
const DEGREE: usize = 2;

/// True for checkpoints of DirectVoxGO whose network takes the colours' features of each sample.
pub fn knows(file: &TensorFile) -> bool {
    let direct = file.root.at(&["model_kwargs", "rgbnet_direct"]);
    let direct = direct.and_then(|flag| flag.boolean("rgbnet_direct").ok()).unwrap_or(false);
    let channels = weight(file, "k0.grid").and_then(|grid| grid.shape().get(1).copied());
    direct
        && channels.is_some_and(|channels| (3..=256).contains(&channels))
        && channels != Some(DEFERRED_CHANNELS)
        && weight(file, "rgbnet.0.weight").is_some()
        && weight(file, "viewfreq").is_some_and(|tensor| tensor.count() <= OCTAVES)
}

fn weight<'a>(file: &'a TensorFile, name: &str) -> Option<&'a Tensor> {
    file.root.at(&["model_state_dict", name]).and_then(Value::tensor)
}

/// Opens a checkpoint. Without the network it is opened as any other.
///
/// # Errors
/// Those of [`checkpoint::open_tensors`], and layers that do not follow each other.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    if options.mlp != MlpChoice::Auto || options.view == ViewChoice::None {
        return checkpoint::open_tensors(file, options, limits);
    }
    let plain = SourceOptions { mlp: MlpChoice::None, view: ViewChoice::Keep, ..options.clone() };
    let mut source = checkpoint::open_tensors(file, &plain, limits)?;
    let (Some(grid), Some(frequencies)) = (weight(file, "k0.grid"), weight(file, "viewfreq"))
    else {
        return Ok(source);
    };
    let color = grid.volume(limits)?;
    let inputs = Inputs {
        features: 0,
        position: 0,
        direction: u32::try_from(frequencies.count()).unwrap_or(0),
    };
    let network = NetworkFile::new(layers(file), inputs, color.channels)?;
    let degree = match options.view {
        ViewChoice::Harmonics(wanted) => wanted.min(Harmonics::MAX_DEGREE),
        _ => DEGREE,
    };
    let (evaluation, clamp) = (Evaluation::Ray, Clamp::Zero);
    let harmonics = Harmonics { degree, evaluation, offset: OFFSET, clamp };
    source.assumptions.retain(|assumption| assumption.key != "mlp");
    source.assumptions.push(Assumption {
        key: "view",
        value: format!("sh:{degree}"),
        message: format!(
            "colours come from a network for each sample: a bake fits harmonics of degree \
             {degree} to it at each node, over directions all around; pictures of the unbaked \
             file use the network; option view sets the degree"
        ),
    });
    source.family = Family::Dvgo;
    let field = source.field.clone();
    let model = Arc::new(DvgoFile { field, color: color.clone(), network: network.clone() });
    let colors = FittedColors::new(color, network, harmonics, limits);
    source.field.color = vec![Grid::Values(Arc::new(colors))];
    source.field.color_domain = ColorDomain::Linear;
    source.field.view = Some(ViewDependence::Harmonics(harmonics));
    source.field.check()?;
    source.model = Some(model);
    Ok(source)
}

/// Weights and biases of the layers `rgbnet.0`, `rgbnet.2.0`, `rgbnet.3`, in the order of their
/// numbers.
fn layers(file: &TensorFile) -> Vec<[Tensor; 2]> {
    let entries = file.root.get("model_state_dict").map_or(&[][..], Value::entries);
    let mut found: Vec<(Vec<u64>, [Tensor; 2])> = Vec::new();
    for (name, value) in entries {
        let index = name.strip_prefix("rgbnet.").and_then(|name| name.strip_suffix(".weight"));
        let Some(index) = index else { continue };
        let bias = weight(file, &format!("rgbnet.{index}.bias"));
        let numbers: std::result::Result<Vec<u64>, _> = index.split('.').map(str::parse).collect();
        if let (Some(weight), Some(bias), Ok(numbers)) = (value.tensor(), bias, numbers) {
            found.push((numbers, [weight.clone(), bias.clone()]));
        }
    }
    found.sort_by(|a, b| a.0.cmp(&b.0));
    found.into_iter().map(|(_, layer)| layer).collect()
}
