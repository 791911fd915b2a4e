//! What the names in a checkpoint mean: Mip-VoG and DirectVoxGO to [`RadianceField`].
//!
//! Both families store dense grids of raw density and colour in a box, a small network, a mask of
//! free space, and settings. What a checkpoint does not say has a default here, an option in
//! [`SourceOptions`], and an [`Assumption`] in the result, to be shown to the user. Background,
//! near and far plane and the colour threshold belong to the scene and are never stored: their
//! usual values (white, 0, none, 1e-4) are defaults like those of any option.
//!
//! Opening reads settings, the network and the mask; the grids stay in the file.

mod coarse;
mod grids;
mod inspect;
mod march;
mod mask;
mod mlp;
mod names;

use std::path::{Path, PathBuf};
use std::sync::Arc;

pub use inspect::{Inspection, Listed, Model, inspect, inspect_tensors};

use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::input::tensor::{self, FileKind, TensorFile};
use crate::model::field::{RadianceField, Scene};
use mask::Mask;
use names::Names;

/// What the user says about a checkpoint.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SourceOptions {
    /// Step length in voxels. Default: 0.5, with an assumption
    pub stepsize: Option<f32>,
    /// The coarse checkpoint that the mask comes from. Default: where the checkpoint says, else
    /// beside it
    pub coarse: Option<PathBuf>,
    /// The network to bake. Default: the checkpoint's
    pub mlp: MlpChoice,
    /// Where rays start, in units of the unnormalised direction. Default: 0
    pub near: Option<f32>,
    /// Where rays enter the box at the latest, likewise. Default: without bound
    pub far: Option<f32>,
    /// Colour behind the field. Default: white
    pub background: Option<[f32; 3]>,
    /// Samples of at most this weight add no colour. Default: the checkpoint's
    /// `fast_color_thres`, else 1e-4
    pub color_threshold: Option<f32>,
}

/// Which network to bake.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum MlpChoice {
    /// The checkpoint's, if it has one.
    #[default]
    Auto,
    /// None: only the first three channels of colour, as they are.
    None,
    /// The `rgbnet` of another file.
    File(PathBuf),
}

/// A checkpoint, understood.
#[derive(Debug, Clone)]
pub struct Source {
    /// The trained scene; its grids are still in the file.
    pub field: RadianceField,
    /// Who wrote it.
    pub family: Family,
    /// How it is written.
    pub kind: FileKind,
    /// What it does not say and was assumed, to be shown to the user.
    pub assumptions: Vec<Assumption>,
    /// SHA-256 of what stands for its content; see [`TensorFile::digest`].
    pub digest: [u8; 32],
    /// The open file.
    pub file: Arc<SourceFile>,
    /// Other files that were used: the coarse checkpoint, the network's.
    pub companions: Vec<Companion>,
}

/// Another file that a scene was read from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Companion {
    /// `coarse` or `mlp`.
    pub role: &'static str,
    /// Where it lies.
    pub path: PathBuf,
    /// SHA-256 of what stands for its content.
    pub digest: [u8; 32],
}

/// The code that wrote a checkpoint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// Mip-VoG's research code.
    MipVog,
    /// DirectVoxGO, either generation of names.
    Dvgo,
}

impl Family {
    /// Its name, as people know it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::MipVog => "Mip-VoG",
            Self::Dvgo => "DirectVoxGO",
        }
    }
}

/// Something that a checkpoint does not say.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Assumption {
    /// What is missing, in a word.
    pub key: &'static str,
    /// What was assumed.
    pub value: String,
    /// The warning: what is missing, what was assumed, and which option sets it.
    pub message: String,
}

/// Opens a checkpoint of any kind.
///
/// # Errors
/// As [`tensor::open`]; `Unsupported` for models that are not dense grids in a box or whose
/// network runs for each sample, `Malformed` where parts are missing or do not fit, `Usage` for
/// options out of range.
pub fn open(path: &Path, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    open_tensors(&tensor::open(path, limits)?, options, limits)
}

/// The same for a file that is open already.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    let path = file.file.path();
    let in_file = |error: Error| error.in_file(path);
    let (mut source, mask) = assemble(file, options, limits).map_err(in_file)?;
    if let Some(mask) = mask {
        source.field.free_space = Some(mask.load(limits).map_err(in_file)?);
    }
    Ok(source)
}

/// Everything but the mask's values.
fn assemble<'a>(
    file: &'a TensorFile,
    options: &SourceOptions,
    limits: &Limits,
) -> Result<(Source, Option<Mask<'a>>)> {
    options.check()?;
    let path = file.file.path();
    let names = Names::new(file);
    let (mut assumptions, mut companions) = (Vec::new(), Vec::new());
    grids::refuse_others(&names)?;
    let (density, mut color) = grids::find(&names, limits)?;
    let nodes = density.nodes;
    let bounds = grids::bounds(&names)?;
    let family = grids::family(&names, color.channels);
    let (activation, march) =
        march::find(&names, family, &bounds, nodes, options, &mut assumptions)?;
    let features = color.channels - 3;
    let view_mlp = match &options.mlp {
        MlpChoice::None => None,
        MlpChoice::Auto => mlp::find(&names, family, features, limits, &mut assumptions)?,
        MlpChoice::File(path) => {
            let other = tensor::open(path, limits)?;
            let names = Names::new(&other);
            // A network that was named is meant to run once a ray.
            let found = mlp::find(&names, Family::MipVog, features, limits, &mut assumptions)
                .map_err(|error| error.in_file(path))?;
            let digest = other.digest;
            companions.push(Companion { role: "mlp", path: path.clone(), digest });
            Some(found.ok_or_else(|| {
                Error::usage(format!("--mlp {}: no network rgbnet in this file", path.display()))
            })?)
        }
    };
    if view_mlp.is_none() {
        let asked = options.mlp == MlpChoice::None;
        grids::drop_features(&mut color, asked, &mut assumptions);
    }
    let mask = Mask::find(&names, &bounds, nodes, path, options, limits, &mut assumptions)?;
    let coarse = mask.as_ref().and_then(|mask| mask.coarse.as_ref()?.file.clone());
    companions.extend(coarse.map(|(path, digest)| Companion { role: "coarse", path, digest }));
    if let Some(path) = options
        .coarse
        .as_ref()
        .filter(|_| companions.iter().all(|companion: &Companion| companion.role != "coarse"))
    {
        // A file that was named must be there, even where this scene does without it.
        SourceFile::open(path)?;
        assumptions.push(Assumption {
            key: "coarse",
            value: "unused".to_owned(),
            message: format!(
                "--coarse {} is not used: this scene's mask needs none",
                path.display()
            ),
        });
    }
    let background = options.background.unwrap_or([1.0; 3]);
    let scene = Scene { bounds, nodes, activation, march, background };
    let field = RadianceField { scene, density, color: vec![color], view_mlp, free_space: None };
    let source = Source {
        field,
        family,
        kind: file.kind,
        assumptions,
        digest: file.digest,
        file: Arc::clone(&file.file),
        companions,
    };
    Ok((source, mask))
}

impl SourceOptions {
    /// Refuses values that no scene has.
    pub fn check(&self) -> Result<()> {
        let usage = |message: String| Err(Error::usage(message));
        if let Some(step) = self.stepsize.filter(|step| !(*step > 0.0 && *step <= 64.0)) {
            return usage(format!(
                "--stepsize {step}: expected a number of voxels above 0, up to 64"
            ));
        }
        if let Some(near) = self.near.filter(|near| !(*near >= 0.0 && near.is_finite())) {
            return usage(format!("--near {near}: expected a distance of 0 or more"));
        }
        let near = self.near.unwrap_or(0.0);
        if let Some(far) = self.far.filter(|far| !(*far > near && far.is_finite())) {
            return usage(format!("--far {far}: expected a distance beyond --near {near}"));
        }
        if let Some(color) = self.background.filter(|c| !c.iter().all(|v| (0.0..=1.0).contains(v)))
        {
            return usage(format!("--background {color:?}: expected three numbers from 0 to 1"));
        }
        if let Some(least) = self.color_threshold.filter(|t| !(0.0..1.0).contains(t)) {
            return usage(format!(
                "--color-threshold {least}: expected a weight from 0 to below 1"
            ));
        }
        Ok(())
    }
}
