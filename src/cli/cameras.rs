//! Options that choose cameras.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use clap::Args;

use super::common::Common;
use super::folders::camera_path;
use super::outcome::{assumed, warn};
use super::progress::Bar;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::model::camera::{self, Camera, CameraFile, PickedCameras, WorldTransform};
use crate::model::grid::Bounds;
use crate::view::panorama;
use crate::view::render::Renderer;

/// Picture size of cameras that no file tells the size of.
pub const DEFAULT_SIZE: [usize; 2] = [800; 2];
/// Default number of cameras around a scene.
const AROUND: usize = 8;
/// Pixels along a side of their pictures, at least.
const AROUND_SIZE: usize = 400;
/// Pixels of such a picture for each voxel along the longest axis, so that level 0 is read.
const PIXELS_PER_VOXEL: usize = 3;
/// The remedy for LLFF's cameras.
const OF_LLFF: &str = "LLFF's poses are not read, for every training moves and scales them in its own way: \
                       pass the transforms.json or the COLMAP model that they were made from";
/// Memory per pixel during rendering: its sums and the picture's channels.
const BYTES_A_PIXEL: u64 = 160;

/// The cameras to render from.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Cameras")]
pub struct CameraArguments {
    /// Camera file: NeRF-synthetic's transforms.json or nerfstudio's, or images.bin or images.txt
    /// of a COLMAP model; or the folder with it
    #[arg(long, value_name = "FILE", value_parser = camera_path())]
    cameras: Option<PathBuf>,
    /// nerfstudio's dataparser_transforms.json, which leads from the camera file's world to that of
    /// the training: for models of nerfstudio, and their bakes
    #[arg(long, value_name = "FILE", requires = "cameras")]
    camera_transform: Option<PathBuf>,
    /// N cameras on a circle around the box; instead of a camera file
    #[arg(long, value_name = "N", conflicts_with = "cameras",
          value_parser = clap::value_parser!(u16).range(1..))]
    turntable: Option<u16>,
    /// Picture size in pixels, or one number for a square [default: the camera file's; else its
    /// pictures'; else 800x800]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<Size>,
    /// Frames, by name, path or number [default: all]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    frames: Vec<String>,
    /// Set once the warnings of the file are told: a verb may ask for the cameras again.
    #[arg(skip)]
    told: OnceLock<()>,
}

/// A camera file, and the transform of its cameras.
#[derive(Debug, Clone)]
pub struct CameraSource {
    /// The file.
    pub path: PathBuf,
    /// nerfstudio's `dataparser_transforms.json`, if the cameras are moved by it.
    pub transform: Option<PathBuf>,
}

impl CameraSource {
    /// Reads the cameras; see [`camera::read`].
    pub fn read(&self, size: Option<[usize; 2]>, limits: &Limits) -> Result<CameraFile> {
        let file = camera::read(&self.path, size, limits)?;
        Ok(match &self.transform {
            Some(path) => file.moved(&WorldTransform::read(path, limits)?),
            None => file,
        })
    }

    /// The files that are read.
    pub fn paths(self) -> impl Iterator<Item = PathBuf> {
        [self.path].into_iter().chain(self.transform)
    }
}

/// Pixels along a row, and rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Size([usize; 2]);

impl CameraArguments {
    /// True if there is a camera file or a turntable.
    pub fn given(&self) -> bool {
        self.cameras.is_some() || self.turntable.is_some()
    }

    /// True if a size or frames are given.
    pub fn selects(&self) -> bool {
        self.size.is_some() || !self.frames.is_empty()
    }

    /// The camera file, if there is one.
    pub fn file(&self) -> Option<CameraSource> {
        let path = self.cameras.clone()?;
        Some(CameraSource { path, transform: self.camera_transform.clone() })
    }

    /// Cameras of a turntable, if requested.
    pub fn turntable(&self) -> Option<usize> {
        self.turntable.map(usize::from)
    }

    /// The picture size, if it is given.
    pub fn size(&self) -> Option<[usize; 2]> {
        self.size.map(|Size(size)| size)
    }

    /// Picture size of cameras that no file tells the size of.
    pub fn made_size(&self) -> [usize; 2] {
        self.size.map_or(DEFAULT_SIZE, |Size(size)| size)
    }

    /// Reads or makes the cameras; an error without a file or a turntable.
    pub fn cameras(&self, bounds: &Bounds, common: &Common) -> Result<Vec<Camera>> {
        match (self.of_file(common)?, self.turntable()) {
            (Some(cameras), _) => Ok(cameras),
            (None, Some(count)) => self.pick(camera::turntable(bounds, count, self.made_size())),
            (None, None) => {
                Err(Error::usage("there are no cameras: pass --cameras FILE or --turntable N"))
            }
        }
    }

    /// Warns of a turntable around a world, which is made to be seen from inside.
    pub fn warn_of_world(&self, field: &Renderer, common: &Common) {
        if self.turntable.is_some() && !field.view().boxes.is_empty() {
            let message = "--turntable looks at the innermost box of this world from outside it; \
                           without cameras, pictures are taken from inside";
            warn(message, common);
        }
    }

    /// Default cameras: all around a field, or inside its world.
    pub fn around(&self, field: &Renderer, bar: &Bar) -> Result<Vec<Camera>> {
        let size = self.size.map_or_else(|| wide_enough(field), |Size(size)| size);
        let view = field.view();
        match view.boxes.is_empty() {
            true => self.pick(camera::turntable(&view.bounds, AROUND, size)),
            false => self.pick(panorama(field, AROUND, size, bar)?),
        }
    }

    /// The selected cameras of the file, if there is one.
    pub fn of_file(&self, common: &Common) -> Result<Option<Vec<Camera>>> {
        let Some(file) = self.file() else { return Ok(None) };
        let read = file.read(self.size.map(|Size(size)| size), &common.limits());
        let is_of_llff = file.path.file_name().is_some_and(|name| name == "poses_bounds.npy");
        let read = read.map_err(|error| match is_of_llff {
            true => error.advise(OF_LLFF),
            false => error,
        })?;
        let picked = read.pick(&self.frames)?;
        self.told.get_or_init(|| warn_of_cameras(&file.path, &picked, common));
        Ok(Some(picked.cameras))
    }

    /// The user's selected frames.
    pub fn pick(&self, cameras: Vec<Camera>) -> Result<Vec<Camera>> {
        camera::pick(cameras, &self.frames)
    }
}

/// A square size at which a scene that fills the picture reads level 0.
fn wide_enough(field: &Renderer) -> [usize; 2] {
    let longest = field.view().nodes.0.into_iter().max().unwrap_or(0);
    [(PIXELS_PER_VOXEL * longest).clamp(AROUND_SIZE, DEFAULT_SIZE[0]); 2]
}

/// Prints what is ignored or assumed about the cameras of a file.
pub fn warn_of_cameras(file: &Path, picked: &PickedCameras, common: &Common) {
    for warning in &picked.warnings {
        warn(&format!("{}: {}", file.display(), assumed(warning)), common);
    }
}

/// Refuses pictures that do not fit into memory, with `supersample` rays along each side of a
/// pixel.
pub fn check_memory(cameras: &[Camera], supersample: u8, limits: &Limits) -> Result<()> {
    let pixels = |camera: &Camera| {
        let rays = [camera.lens.width, camera.lens.height].map(|side| side as u64);
        rays[0] * rays[1] * u64::from(supersample).pow(2)
    };
    let Some(largest) = cameras.iter().max_by_key(|camera| pixels(camera)) else { return Ok(()) };
    limits::check(
        LimitName::Memory,
        "bytes of a picture",
        pixels(largest) * BYTES_A_PIXEL,
        limits.memory,
        &Place::Key(format!("frame {}", largest.name)),
    )
}

fn parse_size(text: &str) -> std::result::Result<Size, String> {
    let side = |text: &str| text.trim().parse::<usize>().ok();
    let sides = match text.split_once(['x', 'X']) {
        Some((width, height)) => side(width).zip(side(height)),
        None => side(text).map(|side| (side, side)),
    };
    let (width, height) = sides.ok_or(
        "expected WxH in pixels, such as 640x480, or one number for a square, such as 400",
    )?;
    let largest = camera::LARGEST_SIDE;
    match [width, height].iter().all(|side| (1..=largest).contains(side)) {
        true => Ok(Size([width, height])),
        false => Err(format!("expected 1 to {largest} pixels along each side")),
    }
}

/// Scales at which every picture has at least one pixel, without duplicates.
pub fn checked_scales(asked: &[u16], cameras: &[Camera]) -> Result<Vec<usize>> {
    let mut scales: Vec<usize> = Vec::new();
    for scale in asked.iter().copied().map(usize::from) {
        if !scales.contains(&scale) {
            scales.push(scale);
        }
    }
    let smallest = cameras.iter().flat_map(|camera| [camera.lens.width, camera.lens.height]).min();
    if let Some(side) = smallest
        && let Some(scale) = scales.iter().find(|&&scale| scale > side)
    {
        return Err(Error::usage(format!(
            "--scales {scale} leaves no pixel of a picture that is {side} pixels wide or high"
        )));
    }
    Ok(scales)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_pairs_or_squares_within_the_limit() {
        assert_eq!(parse_size("400"), Ok(Size([400, 400])));
        assert_eq!(parse_size("640x480"), Ok(Size([640, 480])));
        assert_eq!(parse_size("8X9"), Ok(Size([8, 9])));
        for bad in ["", "x", "4x", "4x4x4", "-1", "4.5", "a"] {
            assert!(parse_size(bad).expect_err(bad).contains("WxH"), "{bad}");
        }
        for large in ["99999x99999", "0", "1x0", "32769"] {
            assert!(parse_size(large).expect_err(large).contains("1 to 32768"), "{large}");
        }
    }
}
