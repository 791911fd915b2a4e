//! The field that `export` takes. A page holds the whole container. Of a world, other formats take
//! the levels of a baked container, all boxes or one; an input that is not baked yet is baked in
//! memory for both, with default options.

use std::path::Path;

use super::cameras::CameraSource;
use super::common::Common;
use super::field::FieldArguments;
use super::scene::SceneArguments;
use super::stdin;
use crate::bake::{BakeOptions, Baker};
use crate::base::bytes::{SourceFile, hex, sha256};
use crate::base::error::{Error, Result};
use crate::base::limits::{LimitName, Limits};
use crate::container::Container;
use mipvog_inputs::{self, Family, tensor};
use mipvog_outputs::format::{ExportFormat, ExportOptions, ExportSource};

/// What is missing where one box of a world is exported.
fn others_of(number: usize) -> String {
    match number {
        0 => "the world around the innermost of the nested boxes".to_owned(),
        _ => format!("all nested boxes but number {number}"),
    }
}

/// A field as the command line names it.
pub(super) struct FieldRequest<'a> {
    /// A container, an asset, a trained input, or `-`.
    pub(super) path: &'a Path,
    pub(super) which: FieldArguments,
    /// The box of a world to export.
    pub(super) nested_box: Option<usize>,
    pub(super) scene: &'a SceneArguments,
    /// The file of cameras, whose settings a trained input takes too.
    pub(super) cameras: Option<&'a CameraSource>,
}

impl FieldRequest<'_> {
    /// Opens the field, with rules for the cameras that are wanted. The second value lists what is
    /// lost before the export begins.
    pub(super) fn open(
        &self,
        format: &dyn ExportFormat,
        options: &ExportOptions,
        common: &Common,
    ) -> Result<(ExportSource, Vec<String>)> {
        let limits = &options.limits;
        self.which.check(&[self.path])?;
        let path = stdin::resolve(self.path)?;
        let file = SourceFile::open(&mipvog_inputs::file_of(&path))?;
        let scene = self.scene_of_source(limits)?;
        let mut field = scene.open(self.path, self.which, None, self.cameras, common)?;
        let boxes = field.view().boxes.len().max(1);
        if let Some(number) = self.nested_box {
            let expected = format!("a box below {boxes}");
            Error::require_option(number < boxes, "box", number, &expected)?;
            if format.takes_container() {
                return Err(Error::usage(format!("--to {} holds all boxes", format.name())));
            }
        }
        let (mut world, mut lost) = (None, Vec::new());
        if boxes > 1 && !format.takes_container() {
            let baked = self.which.container(self.path, limits)?;
            let is_baked = baked.is_some();
            let container = match baked {
                Some(container) => container,
                None => Container::from_bytes(self.baked(limits)?, limits)?,
            };
            if !is_baked {
                lost.push(
                    "what a bake with default options loses; the PSNR is without it".to_owned(),
                );
            }
            if !format.holds_boxes() || self.nested_box.is_some() {
                let number = self.nested_box.unwrap_or(0);
                field = scene.show(&container.read()?.one_box(number), limits)?;
                lost.push(others_of(number));
            } else {
                if !is_baked {
                    field = scene.show(&container.read()?, limits)?;
                }
                world = Some(container.metadata().clone());
            }
        }
        if self.cameras.is_none() {
            self.scene.see_all(&mut field);
        }
        if let Some(crop) = &options.crop {
            field.crop(crop)?;
        }
        let name = self.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let container = match format.takes_container() {
            true => Some(self.container(limits)?),
            false => None,
        };
        let sha256 = hex(&sha256(&file)?);
        Ok((ExportSource { field, name, sha256, path, world, container }, lost))
    }

    /// The settings that the field is opened with. The resolution is the export's alone, but for
    /// models without nodes, whose nodes it places too.
    fn scene_of_source(&self, limits: &Limits) -> Result<SceneArguments> {
        let mut scene = self.scene.clone();
        if scene.resolution.is_some() {
            let is_baked = self.which.container(self.path, limits)?.is_some();
            let has_nodes = || {
                let file =
                    tensor::open(&mipvog_inputs::file_of(&stdin::resolve(self.path)?), limits)?;
                Result::Ok(!mipvog_inputs::family(&file).is_some_and(Family::is_sampled))
            };
            if is_baked || has_nodes()? {
                scene.resolution = None;
            }
        }
        Ok(scene)
    }

    /// The bytes of the container, which a trained input is baked to first.
    fn container(&self, limits: &Limits) -> Result<Vec<u8>> {
        if let Some(container) = self.which.container(self.path, limits)? {
            let file = container.file();
            return file.read_bounded(
                0,
                file.length(),
                (LimitName::Memory, "bytes of a container"),
                limits.memory,
            );
        }
        self.baked(limits)
    }

    /// A trained input, baked with default options.
    fn baked(&self, limits: &Limits) -> Result<Vec<u8>> {
        let scene = self.scene_of_source(limits)?;
        let options = scene.settings(self.path, self.cameras, limits)?.options;
        let source = mipvog_inputs::open_with(&stdin::resolve(self.path)?, &options, limits)?;
        Baker::new(BakeOptions { limits: limits.clone(), ..BakeOptions::default() }).to_vec(&source)
    }
}
