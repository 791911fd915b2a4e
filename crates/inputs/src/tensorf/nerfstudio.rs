//! The checkpoints of nerfstudio's method `tensorf`.
//!
//! | key in `pipeline`, after `_model.field.` | shape | meaning |
//! |---|---|---|
//! | `aabb` | `[2, 3]` | the box |
//! | `density_encoding.plane_coef`, `.line_coef` | `[3, C, N, N]`, `[3, C, N, 1]` | factors, in TensoRF's order; a CP model has no planes |
//! | `color_encoding.plane_coef`, `.line_coef` | likewise | |
//! | `B.weight` | `[features, components]` | products of factors to features |
//! | `mlp_head.layers.{0,1}`, `field_output_rgb.net` | | three layers |
//!
//! Density is cut at 0 after interpolation. Inputs of the network are encoded with two waves of
//! `2 pi` and `8 pi`.

use std::f64::consts::TAU;

use super::keys::{Arrays, Settings, stacked_terms};
use super::read::corners;
use super::shading::ShadingFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::factors::{FactorArrays, Mix, Terms};
use crate::model::grid::Nodes;
use crate::network::{Inputs, NetworkFile};
use crate::source::Assumption;
use crate::tensor::{Tensor, TensorFile, Value};

/// The names of the field start so.
const FIELD: &str = "_model.field.";
/// Waves of an encoding.
const WAVES: u32 = 2;
/// Step length of a bake in voxels.
const STEP_RATIO: f64 = 0.5;

fn entry<'a>(file: &'a TensorFile, name: &str) -> Option<&'a Value> {
    file.root.at(&["pipeline", &format!("{FIELD}{name}")])
}

fn tensor<'a>(file: &'a TensorFile, name: &str) -> Result<&'a Tensor> {
    entry(file, name).and_then(Value::tensor).ok_or_else(|| {
        let place = Place::Tensor(format!("pipeline.{FIELD}{name}"));
        Error::malformed(place, "no such array", "an array of nerfstudio's tensorf")
    })
}

/// True for a checkpoint with factors in nerfstudio's names.
pub(super) fn knows(file: &TensorFile) -> bool {
    ["line_coef", "plane_coef"]
        .iter()
        .any(|part| entry(file, &format!("density_encoding.{part}")).is_some())
}

/// Finds the arrays and checks their shapes.
pub(super) fn find(file: &TensorFile, limits: &Limits) -> Result<Arrays> {
    let bounds = corners(entry(file, "aabb"), &format!("pipeline.{FIELD}aabb"))?;
    let refuse = |name: &str, found: &str, expected: &str| {
        let place = Place::Tensor(format!("pipeline.{FIELD}{name}"));
        Err(Error::unsupported(place, found, expected))
    };
    if entry(file, "density_encoding.line_coef").is_none() {
        let found = "planes without lines (triplane), which are not products of factors";
        return refuse("density_encoding.plane_coef", found, "the encoding vm or cp");
    }
    let tcnn = "mlp_head.tcnn_encoding.params";
    if entry(file, tcnn).is_some() {
        let found = "a network of tiny-cuda-nn, whose file does not state its widths";
        return refuse(tcnn, found, "a network of PyTorch (implementation torch)");
    }
    let lines = tensor(file, "density_encoding.line_coef")?;
    let side = lines.shape().get(2).copied().unwrap_or(0);
    let nodes = Nodes::checked([side; 3], limits, &lines.place())?;
    let basis = Mix { tensor: tensor(file, "B.weight")?.clone(), by_component: false };
    let density = FactorArrays::new(terms(file, "density_encoding")?, nodes, None)?;
    let features = FactorArrays::new(terms(file, "color_encoding")?, nodes, Some(basis))?;
    let layer = |name: &str| -> Result<[Tensor; 2]> {
        let part = |kind: &str| tensor(file, &format!("{name}.{kind}")).cloned();
        Ok([part("weight")?, part("bias")?])
    };
    let layers =
        ["mlp_head.layers.0", "mlp_head.layers.1", "field_output_rgb.net"].into_iter().map(layer);
    let inputs = Inputs { features: WAVES, position: 0, direction: WAVES };
    let network = NetworkFile::new(layers.collect::<Result<_>>()?, inputs, features.channels)?;
    let settings = Settings {
        bounds,
        nodes,
        shift: None,
        distance_scale: 1.0,
        threshold: 0.0,
        near: 0.0,
        far: None,
        step_ratio: STEP_RATIO,
        two_passes: true,
    };
    let shading = ShadingFile::Network(network.with_waves(TAU, 4.0));
    Ok(Arrays { settings, density, features, shading, mask: None })
}

fn terms(file: &TensorFile, encoding: &str) -> Result<Terms> {
    let lines = tensor(file, &format!("{encoding}.line_coef"))?;
    let planes = entry(file, &format!("{encoding}.plane_coef")).and_then(Value::tensor);
    let Some(&count) = lines.shape().get(1) else {
        let found = format!("shape {:?}", lines.shape());
        return Err(Error::malformed(lines.place(), found, "[3, components, rows, 1]"));
    };
    stacked_terms(planes, lines, 0..count)
}

/// The warning about settings that stand in `config.yml` alone.
pub(super) fn assumption() -> Assumption {
    Assumption {
        key: "config.yml",
        value: "white, 200 and 50 samples".to_owned(),
        message: "nerfstudio keeps the background, the numbers of samples and its own version in \
                  config.yml, which is not read: assuming a white background, 200 and 50 samples, \
                  and the network of version 1.1; option background sets the first. Cameras are \
                  those of the training, moved and scaled as dataparser_transforms.json says"
            .to_owned(),
    }
}
