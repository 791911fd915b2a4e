//! Opens a checkpoint: finds grids, settings, the network and the mask.

use std::sync::Arc;

use super::contracted::Inner;
use super::march::Recorded;
use super::mask::Mask;
use super::names::NamedValues;
use super::wrappers::unwrapped;
use super::{grids, march, mlp};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::model::field::{ColorDomain, FreeSpace, RadianceField, Scene};
use crate::model::grid::Bounds;
use crate::model::view_dependence::ViewDependence;
use crate::options::{MlpChoice, SourceOptions, ViewChoice};
use crate::source::{Assumption, Family, SideFile, Source};
use crate::tensor::{self, TensorFile};

/// Maximum initial opacity of coarse stages; fine stages start at 1e-2.
const COARSE_ALPHA: f64 = 1e-5;

/// Opens a checkpoint of any kind.
///
/// # Errors
/// `Unsupported` for models that are not grids in a box or whose network runs for each
/// sample, `Malformed` if parts are missing or do not fit, `InvalidOption` for options out of
/// range.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    let path = file.file.path();
    let in_file = |error: Error| error.in_file(path);
    let (mut source, mask) = assemble(file, options, limits).map_err(in_file)?;
    if let Some(mask) = mask {
        source.field.free_space = Some(mask.load(limits).map_err(in_file)?);
    }
    Ok(source)
}

/// An unbounded scene: a field without network colours, and the meaning of contracted space.
#[derive(Debug)]
pub struct Whole {
    /// Settings and grids; the box is that of contracted space.
    pub source: Source,
    /// The box that is not contracted.
    pub inner: Inner,
    /// The mask in contracted space.
    pub mask: Option<FreeSpace>,
    /// The box of contracted space, in half sizes of the inner one.
    pub contracted: Bounds,
}

/// Opens an unbounded scene with all of its space; none for other scenes.
///
/// # Errors
/// Those of [`open_tensors`].
pub fn open_whole(
    file: &TensorFile,
    options: &SourceOptions,
    limits: &Limits,
) -> Result<Option<Whole>> {
    let names = NamedValues::new(file);
    let options = SourceOptions {
        drop_background: true,
        mlp: MlpChoice::None,
        view: ViewChoice::Keep,
        ..options.clone()
    };
    let Some(inner) = Inner::find(&names, &options)? else { return Ok(None) };
    let contracted = grids::bounds(&names)?;
    let (mut source, mask) = assemble(file, &options, limits)?;
    let dropped = [inner.assumption().key, "mlp"];
    source.assumptions.retain(|assumption| !dropped.contains(&assumption.key));
    source.field.scene.march.sampled = None;
    let mask = mask.map(|mut mask| {
        mask.inner = None;
        mask.load(limits)
    });
    let mask = mask.transpose()?;
    Ok(Some(Whole { source, inner, mask, contracted }))
}

/// As [`open_tensors`], without the mask's values, and the mask's nodes.
///
/// # Errors
/// Those of [`open_tensors`].
pub fn describe(
    file: &TensorFile,
    options: &SourceOptions,
    limits: &Limits,
) -> Result<(Source, Option<[usize; 3]>)> {
    let (source, mask) = assemble(file, options, limits)?;
    Ok((source, mask.map(|mask| mask.nodes.0)))
}

/// Everything but the mask's values.
fn assemble<'a>(
    file: &'a TensorFile,
    options: &SourceOptions,
    limits: &Limits,
) -> Result<(Source, Option<Mask<'a>>)> {
    options.check()?;
    if let ViewChoice::Harmonics(_) = options.view {
        return Err(Error::usage(
            "--view sh:D takes harmonics, and this model's view-dependent colour is a network",
        ));
    }
    let mlp_choice = match options.view {
        ViewChoice::None => &MlpChoice::None,
        _ => &options.mlp,
    };
    let path = file.file.path();
    let names = NamedValues::new(file);
    let (mut assumptions, mut side_files) = (Vec::new(), Vec::new());
    grids::refuse_others(&names)?;
    let inner = Inner::find(&names, options)?;
    let (density, mut color) = grids::find(&names, limits)?;
    let nodes = density.nodes();
    let stored_bounds = grids::bounds(&names)?;
    let bounds = inner.as_ref().map_or(Ok(stored_bounds), |inner| inner.to_world(stored_bounds))?;
    let family = grids::family(&names, color.channels);
    let recorded = Recorded::find(&names)?;
    let (activation, mut march) =
        march::find(&names, family, &bounds, nodes, options, &recorded, &mut assumptions)?;
    if let Some(inner) = &inner {
        march.sampled = Some(inner.bounds());
        assumptions.push(inner.assumption());
    }
    let features = color.channels - 3;
    let view_mlp = match mlp_choice {
        MlpChoice::None => None,
        MlpChoice::Auto => mlp::find(&names, family, features, limits, &mut assumptions)?,
        MlpChoice::File(path) => {
            let other = tensor::open(path, limits)?;
            let other = unwrapped(&other);
            let names = NamedValues::new(&other);
            // A network from an option runs once per ray.
            let found = mlp::find(&names, Family::MipVog, features, limits, &mut assumptions)
                .map_err(|error| error.in_file(path))?;
            let digest = other.digest;
            side_files.push(SideFile { role: "mlp", path: path.clone(), digest });
            Some(found.ok_or_else(|| {
                Error::invalid_option(
                    "mlp",
                    path.display().to_string(),
                    "a file with a network rgbnet",
                )
            })?)
        }
    };
    if view_mlp.is_none() {
        let asked = *mlp_choice == MlpChoice::None;
        grids::drop_features(&mut color, asked, &mut assumptions);
    }
    if view_mlp.is_none() && names.number("alpha_init")?.is_some_and(|alpha| alpha <= COARSE_ALPHA)
    {
        assumptions.push(Assumption {
            key: "stage",
            value: "coarse".to_owned(),
            message: "this looks like the coarse stage of a training, because its colours do not \
                      depend on the view; usually the fine stage's checkpoint is wanted"
                .to_owned(),
        });
    }
    let mut mask =
        Mask::find(&names, &stored_bounds, nodes, path, options, limits, &mut assumptions)?;
    if let Some(mask) = &mut mask {
        mask.inner = inner;
    }
    let coarse = mask.as_ref().and_then(|mask| mask.coarse.as_ref()?.file.clone());
    side_files.extend(coarse.map(|(path, digest)| SideFile { role: "coarse", path, digest }));
    if let Some(path) = options
        .coarse
        .as_ref()
        .filter(|_| side_files.iter().all(|side_file: &SideFile| side_file.role != "coarse"))
    {
        // A named file must exist, even if this scene does not need it.
        SourceFile::open(path)?;
        assumptions.push(Assumption {
            key: "coarse",
            value: "unused".to_owned(),
            message: format!(
                "option coarse, {}, is not used: this scene's mask does not need it",
                path.display()
            ),
        });
    }
    let background = options.background.or(recorded.background).unwrap_or([1.0; 3]);
    let scene = Scene { bounds, nodes, activation, march, background };
    let field = RadianceField {
        scene,
        density: density.into_grid(),
        color: vec![color.into_grid()],
        color_domain: ColorDomain::Logit,
        view: view_mlp.map(ViewDependence::Network),
        free_space: None,
        shells: Vec::new(),
    };
    let source = Source {
        field,
        model: None,
        scene_scale: 1.0,
        family,
        kind: file.kind,
        has_checksums: file.has_checksums,
        is_unbounded: false,
        assumptions,
        recorded: recorded.names(),
        digest: file.digest,
        file: Arc::clone(&file.file),
        side_files,
    };
    Ok((source, mask))
}
