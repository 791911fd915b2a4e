//! The common interface of all formats of `export`: the trait, the field and the options.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::export_files::{ExportFiles, WrittenFiles};
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::Progress;
#[cfg(doc)]
use crate::base::progress::Step;
use crate::model::baked::Metadata;
use crate::model::camera::Camera;
use crate::model::grid::Bounds;
use crate::view::render::{FrameOptions, LevelChoice, Renderer, render};

/// A format that `export` writes.
///
/// A format names the files of an export to a path, writes them, reads them back by its own rules,
/// and describes what it cannot represent.
pub trait ExportFormat: Sync {
    /// The value of `--to`.
    fn name(&self) -> &'static str;

    /// Options of the command line, beside those of all formats, that it takes: names with
    /// underscores.
    fn options(&self) -> &'static [&'static str];

    /// True if it embeds a container, so that the source must have one.
    fn takes_container(&self) -> bool {
        false
    }

    /// True if it holds all boxes of a world.
    fn holds_boxes(&self) -> bool {
        self.takes_container()
    }

    /// Pixels along a side of the pictures for measuring its loss, if no camera is given. A tenth
    /// of the pixels of 400 x 400 gives the loss to 0.1 dB.
    fn side(&self) -> usize {
        128
    }

    /// Refuses invalid output names and unsupported content, before any work.
    ///
    /// # Errors
    ///
    /// `Usage` for a name, `InvalidOption` for sizes, `Unsupported` for fields.
    fn check(&self, source: &ExportSource, options: &ExportOptions, output: &Path) -> Result<()>;

    /// Writes the files, under names beside `output` or in it.
    ///
    /// # Errors
    ///
    /// Errors of writing and of sizes, and a request to stop.
    fn write(
        &self,
        source: &ExportSource,
        options: &ExportOptions,
        files: &mut ExportFiles,
        progress: &dyn Progress,
    ) -> Result<Exported>;

    /// Reads the written bytes back, with the rendering rules of the format's programs. Background,
    /// near and far are the source's.
    ///
    /// # Errors
    ///
    /// Errors of reading.
    fn read_back(
        &self,
        source: &ExportSource,
        files: &WrittenFiles,
        limits: &Limits,
    ) -> Result<Box<dyn Shown>>;
}

/// An export after reading back, with the rendering rules of its format's programs.
pub trait Shown {
    /// The colours of a camera's picture over the background, row by row, one ray per pixel.
    /// [`Step::Render`] advances by tiles.
    ///
    /// # Errors
    ///
    /// Errors of rendering, and a request to stop.
    fn picture(&self, camera: &Camera, progress: &dyn Progress) -> Result<Vec<[f32; 3]>>;
}

impl Shown for Renderer {
    fn picture(&self, camera: &Camera, progress: &dyn Progress) -> Result<Vec<[f32; 3]>> {
        let options = FrameOptions { levels: LevelChoice::Fixed(0), supersample: 1 };
        Ok(render(self, camera, &options, progress)?.color)
    }
}

/// The source field of an export.
#[derive(Debug)]
pub struct ExportSource {
    /// The field.
    pub field: Renderer,
    /// Name of its file, without folders.
    pub name: String,
    /// SHA-256 of the input, in hexadecimal digits: of the bytes of a file, or the digest of a
    /// folder.
    pub sha256: String,
    /// Path of the input.
    pub path: PathBuf,
    /// The metadata of the container, if it has nested boxes and the field has all of them.
    pub world: Option<Metadata>,
    /// The bytes of a container of the field, for formats that take one.
    pub container: Option<Vec<u8>>,
}

/// Options of an export.
#[derive(Debug, Clone)]
pub struct ExportOptions {
    /// The level to export, 0 being the finest. Default: 0
    pub level: usize,
    /// Points for each node along an axis. Default: as the format says
    pub supersample: Option<usize>,
    /// Cubic cells along the longest axis, instead of nodes. Default: nodes
    pub resolution: Option<usize>,
    /// The part of the box to export. Default: all
    pub crop: Option<Bounds>,
    /// Pictures of coarser levels. Default: false
    pub mips: bool,
    /// The world's axis that is up in the written file. Default: z
    pub up: UpAxis,
    /// Values as float32 instead of half floats. Default: false
    pub float32: bool,
    /// Divides densities by the largest one. Default: false
    pub normalize_density: bool,
    /// Writes the features of a view network, or coefficients of harmonics. Default: false
    pub features: bool,
    /// Gaussian splats, at most. Default: 100,000
    pub splats: Option<usize>,
    /// Triangles of a mesh, at most. Default: 100,000
    pub triangles: Option<usize>,
    /// Cameras for fitting the export. Default: none, so the format makes its own
    pub cameras: Vec<Camera>,
    /// Bounds on sizes and memory.
    pub limits: Limits,
}

impl Default for ExportOptions {
    fn default() -> Self {
        Self {
            level: 0,
            supersample: None,
            resolution: None,
            crop: None,
            mips: false,
            up: UpAxis::Z,
            float32: false,
            normalize_density: false,
            features: false,
            splats: None,
            triangles: None,
            cameras: Vec::new(),
            limits: Limits::default(),
        }
    }
}

/// An axis that is up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UpAxis {
    /// As in training.
    Z,
    /// Positions are mapped from `(x, y, z)` to `(x, z, -y)`.
    Y,
}

/// The result of a format.
#[derive(Debug, Default)]
pub struct Exported {
    /// Descriptions of content that the source has and the files lack.
    pub lost: Vec<String>,
    /// Figures of the format's own, for reports.
    pub details: Map<String, Value>,
}
