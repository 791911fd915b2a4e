//! Fields that a program which holds this library opens, such as the Python module: as verbs open
//! theirs, with the same options and the same settings beside the input.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use clap::{ColorChoice, Command, CommandFactory, FromArgMatches, Parser};

use super::call::Failure;
use super::common::Common;
use super::field::FieldArguments;
use super::scene::SceneArguments;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::codec::container::Container;
use crate::input::{self, Source};
use crate::view::render::Renderer;

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
    /// Arguments that no field has, and those of opening.
    pub fn new(arguments: Vec<OsString>) -> std::result::Result<Self, Box<Failure>> {
        let words = std::iter::once("open".into()).chain(arguments);
        let parsed = command().try_get_matches_from(words);
        let parsed = parsed.and_then(|matches| Arguments::from_arg_matches(&matches));
        let parsed = parsed.map_err(|error| Failure::of_arguments(&error.to_string()))?;
        let opened = parsed.open().map_err(|error| error.in_file(&parsed.field));
        opened.map_err(|error| Failure::of(&error))
    }

    /// Of a trained input that is open already.
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

    /// What shows it: level 0 alone of a trained input.
    ///
    /// # Errors
    /// Those of reading.
    pub fn renderer(&self) -> Result<Renderer> {
        match &self.content {
            Content::Baked(container, scene) => {
                scene.open_baked(&container.read()?, None, &self.limits)
            }
            Content::Trained(source) => Renderer::of_source(source, None, &self.limits),
        }
    }
}

impl Arguments {
    fn open(&self) -> Result<OpenField> {
        let limits = self.common.limits();
        let _permit = self.common.network_permit();
        self.which.check(&[&self.field])?;
        let path: &Path = &input::file_of(&self.field);
        let content = match self.which.container(path, &limits)? {
            Some(container) => {
                self.scene.check_container()?;
                Content::Baked(Box::new(container), Box::new(self.scene.clone()))
            }
            None => {
                let options = self.scene.settings(path, None, &limits)?.options;
                Content::Trained(Box::new(input::open_with(path, &options, &limits)?))
            }
        };
        Ok(OpenField { content, limits })
    }
}

/// The command line of [`OpenField::new`].
pub(super) fn command() -> Command {
    Arguments::command().color(ColorChoice::Never)
}
