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
//! Density is cut at 0 after interpolation. Inputs of the network are encoded with sines and
//! cosines of the frequencies `2 pi` and `8 pi`. The background and the numbers of samples are in
//! the run's `config.yml`.

use std::f64::consts::TAU;
use std::path::Path;

use super::keys::{Arrays, Settings, stacked_terms};
use super::read::corners;
use super::shading::ShadingFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::factors::{FactorArrays, Mix, Terms};
use crate::model::grid::Nodes;
use crate::nerfstudio::{RunSettings, place};
use crate::network::{Inputs, NetworkFile};
use crate::source::{Assumption, SideFile};
use crate::tensor::{Tensor, TensorFile, Value};

/// The prefix of the field's names.
const FIELD: &str = "_model.field.";
/// Frequencies of an encoding.
const WAVES: u32 = 2;
/// Step length of a bake in voxels.
const STEP_RATIO: f64 = 0.5;
/// Intervals of a pass, at most.
const MOST_SAMPLES: usize = 1 << 14;

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
        two_passes: None,
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

/// The rendering settings of a run.
pub(super) struct Pictures {
    /// Intervals of the first and of the second pass.
    pub(super) passes: [usize; 2],
    pub(super) background: [f32; 3],
    pub(super) file: Option<SideFile>,
    pub(super) assumptions: Vec<Assumption>,
}

/// Reads the settings of a checkpoint's run.
///
/// # Errors
/// `Unsupported` for other methods, and for a background without a colour unless `background` is
/// given; `Malformed` for impossible numbers.
pub(super) fn pictures(
    checkpoint: &Path,
    background: Option<[f32; 3]>,
    limits: &Limits,
) -> Result<Pictures> {
    pictures_of(RunSettings::of(checkpoint, limits)?, background)
}

fn pictures_of(mut run: RunSettings, background: Option<[f32; 3]>) -> Result<Pictures> {
    let found = settings_of(&mut run, background);
    let (passes, background) = found.map_err(|error| run.blame(error))?;
    let (file, assumption) = run.told();
    let version = Assumption {
        key: "nerfstudio",
        value: "1.1".to_owned(),
        message: "nerfstudio does not store its version: assuming the network of 1.1. Cameras are \
                  those of the training, moved and scaled as dataparser_transforms.json says"
            .to_owned(),
    };
    let assumptions = assumption.into_iter().chain([version]).collect();
    Ok(Pictures { passes, background, file, assumptions })
}

fn settings_of(
    run: &mut RunSettings,
    background: Option<[f32; 3]>,
) -> Result<([usize; 2], [f32; 3])> {
    run.refuse_others("TensoRFModel", "tensorf")?;
    let even = run.count("num_uniform_samples", 200, MOST_SAMPLES)?;
    let found = run.count("num_samples", 50, MOST_SAMPLES)?;
    let key = "background_color";
    let named = run.get(key, "white".to_owned(), "a name")?;
    let color = match (background, named.as_str()) {
        (Some(color), _) => color,
        (None, "white") => [1.0; 3],
        // A model that was trained over random colours has no background.
        (None, "black" | "random") => [0.0; 3],
        (None, other) => {
            let error = Error::unsupported(place(key), other, "white, black or random");
            return Err(error.advise("set the colour with --background"));
        }
    };
    Ok(([even, found], color))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pictures(lines: &str, background: Option<[f32; 3]>) -> Result<Pictures> {
        let text = format!("pipeline:\n  model:\n    {lines}\n");
        pictures_of(RunSettings::of_text(&text), background)
    }

    #[test]
    fn settings_of_the_run_are_taken_and_missing_ones_told() {
        let all = "num_samples: 30\n    num_uniform_samples: 80\n    background_color: black";
        let found = pictures(all, None).expect("settings");
        assert_eq!((found.passes, found.background), ([80, 30], [0.0; 3]));
        assert!(found.assumptions.iter().all(|told| told.key != "config.yml"));
        let found = pictures("num_samples: 30", None).expect("defaults");
        assert_eq!((found.passes, found.background), ([200, 30], [1.0; 3]));
        let told = &found.assumptions[0].message;
        assert!(told.contains("num_uniform_samples 200") && !told.contains("num_samples 30"));
    }

    #[test]
    fn settings_that_no_picture_has_are_refused() {
        for line in [
            "num_samples: 0",
            "num_uniform_samples: 9999999",
            "background_color: last_sample",
            "_target: !!python/name:nerfstudio.models.nerfacto.NerfactoModel ''",
        ] {
            assert!(pictures(line, None).is_err(), "{line}");
        }
        let found = pictures("background_color: last_sample", Some([0.5; 3])).expect("a colour");
        assert_eq!(found.background, [0.5; 3]);
    }
}
