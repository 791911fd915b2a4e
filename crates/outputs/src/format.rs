//! The interface of all formats of `export`: the trait, the field and the options.

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
/// A format names the files of an export, writes them, reads them back by its own rules, and lists
/// the content that it cannot represent.
pub trait ExportFormat: Sync {
    /// The name of the format, as in `--to`.
    fn name(&self) -> &'static str;

    /// The format's own command-line options, with underscores.
    fn options(&self) -> &'static [&'static str];

    /// True if the format embeds a container, which the source must then have.
    fn takes_container(&self) -> bool {
        false
    }

    /// True if the format can represent all boxes of a world.
    fn holds_boxes(&self) -> bool {
        self.takes_container()
    }

    /// Without cameras, pictures of this many pixels per side measure the loss. A tenth of the
    /// pixels of 400 x 400 gives the loss to 0.1 dB.
    fn side(&self) -> usize {
        128
    }

    /// Refuses invalid output names and unsupported content, before any work.
    ///
    /// # Errors
    ///
    /// `Usage` for invalid names, `InvalidOption` for sizes, `Unsupported` for fields.
    fn check(&self, source: &ExportSource, options: &ExportOptions, output: &Path) -> Result<()>;

    /// Writes the files, beside `output` or in it.
    ///
    /// # Errors
    ///
    /// Errors of writing, sizes that the format cannot represent, and `Cancelled`.
    fn write(
        &self,
        source: &ExportSource,
        options: &ExportOptions,
        files: &mut ExportFiles,
        progress: &dyn Progress,
    ) -> Result<Exported>;

    /// Reads the written files back, with the rendering rules of the programs that read the format.
    /// Background, near and far come from the source.
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

/// An export that was read back, with the rendering rules of the programs that read its format.
pub trait Shown {
    /// The colours of a camera's picture over the background, row by row, one ray per pixel.
    /// [`Step::Render`] advances by tiles.
    ///
    /// # Errors
    ///
    /// Errors of rendering, and `Cancelled`.
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
    /// The field to export.
    pub field: Renderer,
    /// File name of the input, without folders.
    pub name: String,
    /// SHA-256 of the input, in hexadecimal digits: of the bytes of a file, or the digest of a
    /// folder.
    pub sha256: String,
    /// Path of the input.
    pub path: PathBuf,
    /// The metadata of the container, if it has nested boxes and the field has all of them.
    pub world: Option<Metadata>,
    /// The field as a container, for formats that embed one.
    pub container: Option<Vec<u8>>,
}

/// Options of an export.
#[derive(Debug, Clone)]
pub struct ExportOptions {
    /// The level to export, 0 being the finest. Default: 0
    pub level: usize,
    /// Sample points per node along each axis. Default: chosen by the format
    pub supersample: Option<usize>,
    /// Number of cubic cells along the longest axis, instead of nodes. Default: nodes
    pub resolution: Option<usize>,
    /// The part of the box to export. Default: all
    pub crop: Option<Bounds>,
    /// Also writes coarser levels, for Mip-VoG's viewer. Default: false
    pub mips: bool,
    /// The up axis of the written file. Default: z
    pub up: UpAxis,
    /// Writes values as float32 instead of half floats. Default: false
    pub float32: bool,
    /// Divides densities by the largest one. Default: false
    pub normalize_density: bool,
    /// Also writes the features of a view network or the coefficients of harmonics. Default: false
    pub features: bool,
    /// Maximum number of Gaussian splats. Default: 100,000
    pub splats: Option<usize>,
    /// Maximum number of triangles of a mesh. Default: 100,000
    pub triangles: Option<usize>,
    /// Cameras for fitting the export. Default: none, the format makes its own
    pub cameras: Vec<Camera>,
    /// Limits on sizes and memory.
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

/// The up axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UpAxis {
    /// z is up, as in training.
    Z,
    /// y is up: positions map from `(x, y, z)` to `(x, z, -y)`.
    Y,
}

/// The result of writing a format.
#[derive(Debug, Default)]
pub struct Exported {
    /// Contents of the source that the files lack.
    pub lost: Vec<String>,
    /// Figures that only this format has, for reports.
    pub details: Map<String, Value>,
}
