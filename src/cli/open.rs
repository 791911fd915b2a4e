//! Fields for programs that embed this library, such as the Python module: opened like a verb's
//! input, with the same options and the same settings beside it.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{ColorChoice, Command, CommandFactory, FromArgMatches, Parser};

use super::call::Failure;
use super::common::Common;
use super::field::FieldArguments;
use super::scene::SceneArguments;
use crate::base::bytes::SourceFile;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::container::Container;
use crate::view::render::Renderer;
use mipvog_inputs::{self, Source, tensor};

/// The options of an open field.
#[derive(Debug, Parser)]
#[command(name = "open", disable_help_flag = true)]
struct Arguments {
    field: PathBuf,
    #[command(flatten)]
    which: FieldArguments,
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    common: Common,
}

/// A field that is open.
#[derive(Debug)]
pub struct OpenField {
    content: Content,
    limits: Limits,
}

#[derive(Debug)]
enum Content {
    /// With the settings that override its own.
    Baked(Box<Container>, Box<SceneArguments>),
    Trained(Box<Source>),
}

impl OpenField {
    /// Opens the field that the arguments name: options, then a path.
    ///
    /// # Errors
    /// Invalid arguments, and errors of opening.
    pub fn new(arguments: Vec<OsString>) -> std::result::Result<Self, Box<Failure>> {
        let words = std::iter::once("open".into()).chain(arguments);
        let parsed = command().try_get_matches_from(words);
        let parsed = parsed.and_then(|matches| Arguments::from_arg_matches(&matches));
        let parsed = parsed.map_err(|error| Failure::of_arguments(&error.to_string()))?;
        let opened = parsed.open(None).map_err(|error| error.in_file(&parsed.field));
        opened.map_err(|error| Failure::of(&error))
    }

    /// Opens bytes that the caller holds, with the same options.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn held(
        options: Vec<OsString>,
        file: &Arc<SourceFile>,
    ) -> std::result::Result<Self, Box<Failure>> {
        let words = std::iter::once("open".into()).chain(options);
        let words = words.chain(["--".into(), file.path().into()]);
        let parsed = command().try_get_matches_from(words);
        let parsed = parsed.and_then(|matches| Arguments::from_arg_matches(&matches));
        let parsed = parsed.map_err(|error| Failure::of_arguments(&error.to_string()))?;
        let opened = parsed.open(Some(file)).map_err(|error| error.in_file(file.path()));
        opened.map_err(|error| Failure::of(&error))
    }

    /// From an open trained input.
    pub fn of_source(source: Source) -> Self {
        Self { content: Content::Trained(Box::new(source)), limits: Limits::default() }
    }

    /// Its container, if it is baked.
    pub fn container(&self) -> Option<&Container> {
        match &self.content {
            Content::Baked(container, _) => Some(container),
            Content::Trained(_) => None,
        }
    }

    /// Its trained input, if it is not baked.
    pub fn source(&self) -> Option<&Source> {
        match &self.content {
            Content::Baked(..) => None,
            Content::Trained(source) => Some(source),
        }
    }

    /// Its renderer; only level 0 for a trained input.
    ///
    /// # Errors
    /// Errors of reading.
    pub fn renderer(&self) -> Result<Renderer> {
        match &self.content {
            Content::Baked(container, scene) => {
                scene.open_baked(&container.read()?, None, &self.limits)
            }
            Content::Trained(source) => source.renderer(None, &self.limits),
        }
    }
}

impl Arguments {
    /// Opens the file that the arguments name, or bytes in memory.
    fn open(&self, held: Option<&Arc<SourceFile>>) -> Result<OpenField> {
        let limits = self.common.limits();
        let _permit = self.common.network_permit();
        let content = match held {
            Some(file) => self.content_of(file, &limits)?,
            None => self.content(&limits)?,
        };
        // The owner of a field may bake to its file again.
        match &content {
            Content::Baked(container, _) => container.file().unguard(),
            Content::Trained(source) => source.file.unguard(),
        }
        Ok(OpenField { content, limits })
    }

    fn content(&self, limits: &Limits) -> Result<Content> {
        self.which.check(&[&self.field])?;
        let path: &Path = &mipvog_inputs::file_of(&self.field);
        match self.which.container(path, limits)? {
            Some(container) => self.baked(container),
            None => {
                let options = self.scene.settings(path, None, limits)?.options;
                let source = mipvog_inputs::open_with(path, &options, limits)?;
                Ok(Content::Trained(Box::new(source)))
            }
        }
    }

    fn content_of(&self, file: &Arc<SourceFile>, limits: &Limits) -> Result<Content> {
        match self.which.container_of(Arc::clone(file), limits)? {
            Some(container) => self.baked(container),
            None => {
                let options = self.scene.source_options();
                options.check()?;
                let tensors = tensor::open_file(file, limits)?;
                let source = mipvog_inputs::open_tensors(&tensors, &options, limits)?;
                source.field.check()?;
                Ok(Content::Trained(Box::new(source)))
            }
        }
    }

    fn baked(&self, container: Container) -> Result<Content> {
        self.scene.check_container()?;
        Ok(Content::Baked(Box::new(container), Box::new(self.scene.clone())))
    }
}

/// The command line of [`OpenField::new`].
pub(super) fn command() -> Command {
    Arguments::command().color(ColorChoice::Never)
}
