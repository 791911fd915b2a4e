//! Reference pictures: renderings of another field, or photographs.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::metrics::Picture;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::base::progress::Progress;
use crate::model::camera::{self, Camera};
use crate::picture;
use crate::view::render::{Frame, FrameOptions, Renderer, render};

/// Source of reference pictures.
pub enum Reference {
    /// Rendered from a field.
    Field(Box<Renderer>),
    /// Files in a folder, found by the path or the name of each frame in the camera file.
    Pictures {
        /// The folder.
        folder: PathBuf,
        /// Colour behind transparent pixels.
        background: [f32; 3],
        /// Limits on the size of a picture.
        limits: Limits,
    },
}

impl Reference {
    /// The reference picture at the camera's size, clamped.
    pub fn picture(
        &self,
        camera: &Camera,
        options: &FrameOptions,
        progress: &dyn Progress,
    ) -> Result<Picture> {
        match self {
            Self::Field(field) => Picture::of_field(field, camera, options, progress),
            Self::Pictures { folder, background, limits } => {
                photograph_of_size(folder, camera, *background, limits)
            }
        }
    }
}

impl Picture {
    /// A field's picture: rendered at the supersampled size, clamped, then averaged.
    pub fn of_field(
        field: &Renderer,
        camera: &Camera,
        options: &FrameOptions,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let supersample = options.supersample;
        let lens = camera.lens.supersampled(supersample);
        let fine = Camera { lens, ..camera.clone() };
        let options = FrameOptions { supersample: 1, ..*options };
        let frame = render(field, &fine, &options, progress)?;
        let mut full = Self::of_frame(&frame, field.view().background);
        if !field.separates_diffuse() {
            full.diffuse = None;
        }
        Ok(if supersample == 1 { full } else { full.downsampled(supersample) })
    }

    /// A rendered frame, clamped.
    fn of_frame(frame: &Frame, background: [f32; 3]) -> Self {
        let clamp = |value: f32| value.clamp(0.0, 1.0);
        let diffuse = frame.accumulated.chunks_exact(frame.channels).zip(&frame.transmittance);
        let diffuse = diffuse.map(|(gathered, left)| {
            [0, 1, 2].map(|channel| clamp(gathered[channel] + left * background[channel]))
        });
        Self {
            width: frame.width,
            height: frame.height,
            color: frame.color.iter().map(|pixel| pixel.map(clamp)).collect(),
            diffuse: Some(diffuse.collect()),
            opacity: Some(frame.transmittance.iter().map(|left| clamp(1.0 - left)).collect()),
            level: mean_level(frame),
        }
    }
}

/// The mean level of the samples, weighted by their share of the picture.
fn mean_level(frame: &Frame) -> Option<f64> {
    let pixels = frame.level.iter().zip(&frame.transmittance);
    let sums = pixels.fold([0.0; 2], |[levels, weights], (level, left)| {
        let weight = f64::from(1.0 - left);
        [levels + weight * f64::from(*level), weights + weight]
    });
    let [levels, weights] = sums;
    (weights > 0.0).then(|| levels / weights)
}

/// A camera's photograph, and the camera for its size. The photograph is box-downsampled to the
/// smallest size with at least `longest` pixels along the longer side. Transparent pixels show
/// `background`.
///
/// # Errors A picture that is missing or unreadable, or exceeds the memory of `limits`.
pub fn photograph(
    folder: &Path,
    camera: &Camera,
    longest: usize,
    background: [f32; 3],
    limits: &Limits,
) -> Result<(Camera, Picture)> {
    let full = read_photograph(&photograph_file(folder, camera)?, background, limits)?;
    let (width, height) = (full.width, full.height);
    let most = (width.max(height) / longest.max(1)).max(1);
    let divides = |factor: &usize| width.is_multiple_of(*factor) && height.is_multiple_of(*factor);
    let factor = (1..=most).rev().find(divides).unwrap_or(1);
    let lens = camera.lens.resized(width / factor, height / factor);
    Ok((Camera { lens, ..camera.clone() }, full.downsampled(factor)))
}

/// A camera's photograph at the camera's size.
fn photograph_of_size(
    folder: &Path,
    camera: &Camera,
    background: [f32; 3],
    limits: &Limits,
) -> Result<Picture> {
    let path = photograph_file(folder, camera)?;
    let [full_width, full_height] = picture::size(&path)?;
    let (width, height) = (camera.lens.width, camera.lens.height);
    let factor = full_width / width.max(1);
    if factor == 0 || full_width != factor * width || full_height != factor * height {
        let expected = format!("a whole part of the picture's {full_width} x {full_height} pixels");
        let found = format!("{width} x {height}");
        return Err(Error::invalid_option("size", found, expected).in_file(&path));
    }
    Ok(read_photograph(&path, background, limits)?.downsampled(factor))
}

/// A photograph at its own size.
fn read_photograph(path: &Path, background: [f32; 3], limits: &Limits) -> Result<Picture> {
    let pixels: u64 = picture::size(path)?.into_iter().map(|side| side as u64).product();
    // As decoded, as colours, and opacity.
    let bytes = pixels.saturating_mul(4 + 12 + 4);
    limits::check(LimitName::Memory, "bytes of a picture", bytes, limits.memory, &Place::File)
        .map_err(|error| error.in_file(path))?;
    let file = picture::read(path, limits.memory)?;
    let pixels = file.bytes.as_chunks::<4>().0;
    let share = |byte: u8| f32::from(byte) / 255.0;
    let color = |&[red, green, blue, alpha]: &[u8; 4]| {
        let opacity = share(alpha);
        let over = |byte: u8, behind: f32| share(byte) * opacity + behind * (1.0 - opacity);
        [over(red, background[0]), over(green, background[1]), over(blue, background[2])]
    };
    let transparent = pixels.iter().any(|pixel| pixel[3] < 255);
    let opacity = || pixels.iter().map(|pixel| share(pixel[3])).collect();
    Ok(Picture {
        width: file.width,
        height: file.height,
        color: pixels.iter().map(color).collect(),
        diffuse: None,
        opacity: transparent.then(opacity),
        level: None,
    })
}

/// The file of a camera's photograph: at the path in the camera file, or by name in the folder.
///
/// # Errors
/// A missing picture.
pub fn photograph_file(folder: &Path, camera: &Camera) -> Result<PathBuf> {
    let found = camera::photograph_path(folder, camera.picture.as_deref(), &camera.name);
    found.ok_or_else(|| {
        let missing = std::io::ErrorKind::NotFound.into();
        let stated = camera.picture.clone().unwrap_or_else(|| camera.name.clone());
        let has_extension = Path::new(&stated).extension().is_some();
        let stated = if has_extension { stated } else { stated + ".png" };
        let name = Path::new(&stated).file_name().map_or(Path::new(&stated), Path::new);
        Error::io(missing, &folder.join(name)).advise(format!(
            "put the picture of frame {} there, or choose frames with option frames",
            camera.name
        ))
    })
}

/// Finds a photograph that two different cameras share, as in a folder with the pictures of only
/// one of two rigs.
pub fn shared_photograph(folder: &Path, cameras: &[Camera]) -> Option<String> {
    let mut taken: BTreeMap<PathBuf, &Camera> = BTreeMap::new();
    for camera in cameras {
        let path = photograph_file(folder, camera).ok()?;
        match taken.get(&path) {
            Some(other) if other.picture != camera.picture => {
                return Some(format!(
                    "{} is taken for the picture of two frames, {} and {}: name the folder that \
                     all paths of the camera file start from, or choose frames with --frames",
                    path.display(),
                    other.name,
                    camera.name
                ));
            }
            Some(_) => {}
            None => {
                taken.insert(path, camera);
            }
        }
    }
    None
}
