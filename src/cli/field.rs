//! Fields that verbs render: a container, alone or in a glTF asset, or a trained input, and the
//! user's settings for it.

use std::path::Path;
use std::sync::Arc;

use clap::Args;

use super::cameras::CameraSource;
use super::common::Common;
use super::outcome::{assumed, warn};
use super::scene::SceneArguments;
use super::stdin;
use super::values::Background;
use crate::bake::Filter;
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::container::{Container, Prefix, is_container};
use crate::model::baked::BakedField;
use crate::model::field::March;
use crate::view::render::{Renderer, TrainedLevels};
use mipvog_inputs::tensor::describe;
use mipvog_outputs::gltf::asset::{Asset, is_asset};

/// The choice of one of several fields.
#[derive(Debug, Clone, Copy, Args)]
pub struct FieldArguments {
    /// Select a field of a glTF asset [default: 0]
    #[arg(long = "field", value_name = "I")]
    number: Option<usize>,
}

/// The error for a file that a verb does not accept.
pub fn wrong_kind(path: &Path, expected: &str) -> Error {
    let file = SourceFile::open(path);
    let found = file.and_then(|file| describe(&file)).unwrap_or("another file");
    Error::wrong_kind(found, expected).in_file(path)
}

/// Names the missing levels of a truncated container.
pub fn warn_of_missing(prefix: &Prefix, common: &Common) {
    let (count, levels) = (prefix.missing().len(), prefix.metadata().levels.len());
    if count > 0 {
        let missing = format!("the finest {count} of {levels} levels are missing");
        warn(&format!("the file ends early: {missing}"), common);
    }
}

impl FieldArguments {
    /// Refuses a choice if no input is an asset.
    pub fn check(self, inputs: &[&Path]) -> Result<()> {
        let Some(number) = self.number else { return Ok(()) };
        for path in inputs {
            let path = stdin::resolve(path)?;
            if !path.is_dir() && is_asset(&SourceFile::open(&path)?) {
                return Ok(());
            }
        }
        let names: Vec<String> = inputs.iter().map(|path| path.display().to_string()).collect();
        let (names, asset) = (names.join(", "), "one of the fields of a glTF asset");
        Err(Error::usage(format!("--field {number} is {asset}, and there is none in {names}")))
    }

    /// Opens a container, or that of a field of a glTF asset; `None` if the file is neither.
    pub fn container(self, path: &Path, limits: &Limits) -> Result<Option<Container>> {
        self.container_of(Arc::new(SourceFile::open(&stdin::resolve(path)?)?), limits)
    }

    /// The same of an open file.
    pub fn container_of(self, file: Arc<SourceFile>, limits: &Limits) -> Result<Option<Container>> {
        if is_container(&file) {
            return Container::open(file, limits).map(Some);
        }
        match is_asset(&file) {
            true => Asset::open(file, limits)?.open_field(self.number.unwrap_or(0)).map(Some),
            false => Ok(None),
        }
    }
}

impl SceneArguments {
    /// Opens a container, the one of an asset, or a trained input for rendering. `filter` makes
    /// coarser levels of a trained input; without it there is level 0 alone. A trained input also
    /// takes settings from the file of `cameras`.
    pub fn open(
        &self,
        path: &Path,
        which: FieldArguments,
        filter: Option<Filter>,
        cameras: Option<&CameraSource>,
        common: &Common,
    ) -> Result<Renderer> {
        let limits = common.limits();
        self.source_options().check()?;
        if let Some(container) = which.container(path, &limits)? {
            return self.open_baked(&container.read()?, filter, &limits);
        }
        let options = self.settings(path, cameras, &limits)?.options;
        let source = mipvog_inputs::open_with(&stdin::resolve(path)?, &options, &limits)?;
        for assumption in &source.assumptions {
            warn(&assumed(&assumption.message), common);
        }
        let scene = &source.field.scene;
        let levels = filter.as_ref().map(|filter| TrainedLevels::of_training(filter, scene));
        source.renderer(levels, &limits).map_err(|error| error.in_file(path))
    }

    /// As [`Self::open`], but accepts a container that ends at a level, with its complete levels.
    pub fn open_or_prefix(
        &self,
        path: &Path,
        which: FieldArguments,
        filter: Option<Filter>,
        cameras: Option<&CameraSource>,
        common: &Common,
    ) -> Result<Renderer> {
        let limits = common.limits();
        let file = Arc::new(SourceFile::open(&stdin::resolve(path)?)?);
        if is_container(&file) {
            let prefix = Container::read_prefix(file, &limits)?;
            warn_of_missing(&prefix, common);
            if !prefix.missing().is_empty() {
                return self.open_baked(&prefix.read()?, filter, &limits);
            }
        }
        self.open(path, which, filter, cameras, common)
    }

    /// A baked field, rendered with the user's overrides.
    pub(super) fn open_baked(
        &self,
        field: &BakedField,
        filter: Option<Filter>,
        limits: &Limits,
    ) -> Result<Renderer> {
        if filter.is_some() {
            return Err(Error::usage("--filter belongs to trained inputs"));
        }
        self.check_container()?;
        self.show(field, limits)
    }

    /// The same where settings of a model are at their place: the field was baked with them.
    pub(super) fn show(&self, field: &BakedField, limits: &Limits) -> Result<Renderer> {
        let mut renderer = Renderer::baked(field, limits)?;
        self.override_container(&mut renderer);
        if let Some(stepsize) = self.stepsize {
            renderer.view().check().map_err(|_| {
                let expected =
                    format!("steps such that a ray takes at most {}", March::MAX_SAMPLES);
                Error::invalid_option("stepsize", stepsize.to_string(), expected)
            })?;
        }
        Ok(renderer)
    }

    /// Refuses settings that do not apply to containers.
    pub(super) fn check_container(&self) -> Result<()> {
        self.source_options().check()?;
        match self.reads_a_model() {
            false => Ok(()),
            true => Err(Error::usage(
                "--coarse, --mlp, --scene-scale, --view, --resolution, --extent, \
                 --appearance, --grid and --drop-background belong to trained inputs; a container states these itself",
            )),
        }
    }

    fn override_container(&self, field: &mut Renderer) {
        let view = field.view_mut();
        if let Some(stepsize) = self.stepsize {
            view.set_stepsize(stepsize);
        }
        view.march.color_threshold = self.color_threshold.unwrap_or(view.march.color_threshold);
        view.march.near = self.near.unwrap_or(view.march.near);
        view.march.far = self.far.or(view.march.far);
        view.background = self.background.map_or(view.background, |Background(color)| color);
    }
}
