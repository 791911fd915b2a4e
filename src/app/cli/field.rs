//! Fields that verbs render: a container, alone or in a glTF asset, or a trained input, and the
//! user's settings for it.

use std::path::Path;
use std::sync::Arc;

use clap::Args;

use super::common::Common;
use super::outcome::warn;
use super::values::{Background, parse_background, parse_mlp};
use crate::bake::Filter;
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::codec::container::{Container, is_container};
use crate::input;
use crate::input::checkpoint::{MlpChoice, SourceOptions};
use crate::model::baked::BakedField;
use crate::output::gltf::asset::{Asset, is_asset};
use crate::view::render::{Renderer, TrainedLevels};

/// The user's settings for a scene, beside those of its file.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Scene")]
pub struct SceneArguments {
    /// Step length in voxels [default: the container's; 0.5 for checkpoints, with a warning]
    #[arg(long, value_name = "VOXELS")]
    pub stepsize: Option<f32>,
    /// Weight up to which a sample adds no colour [default: the file's, else 0.0001]
    #[arg(long, value_name = "WEIGHT")]
    pub color_threshold: Option<f32>,
    /// Start of rays [default: the container's, else 0]
    #[arg(long, value_name = "T")]
    pub near: Option<f32>,
    /// Farthest entry of rays into the box [default: the container's, else without bound]
    #[arg(long, value_name = "T")]
    pub far: Option<f32>,
    /// Colour behind the field: one number or three, 0 to 1 [default: the container's, else 1]
    #[arg(long, value_name = "R,G,B", value_parser = parse_background)]
    pub background: Option<Background>,
    /// The view network of a checkpoint: auto, none, or the file that holds it
    #[arg(long, value_name = "auto|none|FILE", default_value = "auto", value_parser = parse_mlp)]
    pub mlp: MlpChoice,
    /// The coarse checkpoint, for the free-space mask's threshold [default: beside the input]
    #[arg(long, value_name = "FILE")]
    pub coarse: Option<std::path::PathBuf>,
}

/// The choice of one of several fields.
#[derive(Debug, Clone, Copy, Args)]
pub struct FieldArguments {
    /// Of a glTF asset, the field of this number
    #[arg(long = "field", value_name = "I", default_value_t = 0)]
    number: usize,
}

impl FieldArguments {
    /// Opens a container, or that of a field of a glTF asset; `None` if the file is neither.
    pub fn container(self, path: &Path, limits: &Limits) -> Result<Option<Container>> {
        let file = Arc::new(SourceFile::open(path)?);
        if is_container(&file) {
            return Container::open(file, limits).map(Some);
        }
        match is_asset(&file) {
            true => Asset::open(file, limits)?.open_field(self.number).map(Some),
            false => Ok(None),
        }
    }
}

impl SceneArguments {
    /// As the library takes them.
    pub fn source_options(&self) -> SourceOptions {
        SourceOptions {
            stepsize: self.stepsize,
            coarse: self.coarse.clone(),
            mlp: self.mlp.clone(),
            near: self.near,
            far: self.far,
            background: self.background.map(|Background(color)| color),
            color_threshold: self.color_threshold,
        }
    }

    /// Opens a container, the one of an asset, or a trained input for rendering. `filter` makes
    /// coarser levels of a trained input; without it there is level 0 alone.
    pub fn open(
        &self,
        path: &Path,
        which: FieldArguments,
        filter: Option<Filter>,
        common: &Common,
    ) -> Result<Renderer> {
        let limits = common.limits();
        let options = self.source_options();
        options.check()?;
        if let Some(container) = which.container(path, &limits)? {
            return self.open_baked(&container.read()?, filter, &limits);
        }
        let source = input::open_with(path, &options, &limits)?;
        for assumption in &source.assumptions {
            warn(&assumption.message, common);
        }
        let scene = &source.field.scene;
        let levels = filter.as_ref().map(|filter| TrainedLevels::of_training(filter, scene));
        Renderer::trained(&source.field, levels, &limits).map_err(|error| error.in_file(path))
    }

    /// As [`Self::open`]; of a container that ends at a level, the levels that are there.
    pub fn open_or_prefix(
        &self,
        path: &Path,
        which: FieldArguments,
        filter: Option<Filter>,
        common: &Common,
    ) -> Result<Renderer> {
        let limits = common.limits();
        let file = Arc::new(SourceFile::open(path)?);
        if is_container(&file) {
            let prefix = Container::read_prefix(file, &limits)?;
            let (count, levels) = (prefix.missing().len(), prefix.metadata().levels.len());
            if count > 0 {
                let missing = format!("the finest {count} of {levels} levels are missing");
                warn(&format!("the file ends early: {missing}"), common);
                return self.open_baked(&prefix.read()?, filter, &limits);
            }
        }
        self.open(path, which, filter, common)
    }

    /// A baked field, rendered by the rules that the user overrides.
    fn open_baked(
        &self,
        field: &BakedField,
        filter: Option<Filter>,
        limits: &Limits,
    ) -> Result<Renderer> {
        self.source_options().check()?;
        if filter.is_some() || self.coarse.is_some() || self.mlp != MlpChoice::Auto {
            let message = "--filter, --coarse and --mlp belong to trained inputs; a container \
                           states these itself";
            return Err(Error::usage(message));
        }
        let mut renderer = Renderer::baked(field, limits)?;
        self.override_container(&mut renderer);
        Ok(renderer)
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
