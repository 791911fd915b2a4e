//! Camera files: NeRF-synthetic's `transforms*.json` (one `camera_angle_x`) and nerfstudio's
//! (`fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`, for all frames or for each).

use std::path::{Path, PathBuf};

use glam::{DMat4, DVec4};
use serde::Deserialize;

use super::{Camera, Lens};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, Limits};
use crate::base::text::without_mark;

/// Picture size where neither the file nor its pictures say one.
const DEFAULT_SIDE: usize = 800;
/// The start of a parser's message.
const NO_FRAMES: &str = "missing field `frames`";
/// Names of frames that an error lists, at most.
const NAMES_SHOWN: usize = 5;

/// The cameras of a file.
#[derive(Debug, Clone)]
pub struct CameraFile {
    /// In the order of the file.
    pub cameras: Vec<Camera>,
    /// The folder that pictures are relative to.
    pub folder: PathBuf,
}

#[derive(Deserialize)]
struct Document {
    #[serde(flatten)]
    lens: LensFields,
    frames: Vec<Frame>,
}

#[derive(Deserialize)]
struct Frame {
    file_path: Option<String>,
    transform_matrix: [[f64; 4]; 4],
    #[serde(flatten)]
    lens: LensFields,
}

#[derive(Deserialize, Clone, Copy)]
struct LensFields {
    camera_angle_x: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
}

impl LensFields {
    /// Own fields, else those of the whole file.
    fn or(self, all: Self) -> Self {
        // A frame's angle must not hide behind the file's focal length, nor the other way round.
        let own_focal = self.fl_x.is_some() || self.camera_angle_x.is_some();
        Self {
            camera_angle_x: if own_focal { self.camera_angle_x } else { all.camera_angle_x },
            fl_x: if own_focal { self.fl_x } else { all.fl_x },
            fl_y: if own_focal { self.fl_y } else { all.fl_y },
            cx: self.cx.or(all.cx),
            cy: self.cy.or(all.cy),
            w: self.w.or(all.w),
            h: self.h.or(all.h),
        }
    }
}

/// Reads a camera file. The pictures' size is `size`, else the file's, else that of the first
/// picture that is there, else 800 x 800.
pub fn read(path: &Path, size: Option<[usize; 2]>, limits: &Limits) -> Result<CameraFile> {
    let text = read_text(path, limits)?;
    let folder = path.parent().map(Path::to_owned).unwrap_or_default();
    parse(&text, folder, size).map_err(|error| error.in_file(path))
}

/// The cameras of a file's text, whose pictures are relative to `folder`.
pub fn parse(text: &str, folder: PathBuf, size: Option<[usize; 2]>) -> Result<CameraFile> {
    let document: Document = serde_json::from_str(text).map_err(|error| {
        // Another file was named by mistake: nothing is wrong with it.
        let is_object = text.trim_start().starts_with('{');
        if !is_object || error.is_data() && error.to_string().starts_with(NO_FRAMES) {
            let found = if is_object { "JSON without frames" } else { "another file" };
            return Error::wrong_kind(found, "a camera file: JSON with frames");
        }
        let place = Place::Key(format!("line {}", error.line()));
        let expected = "frames with transform_matrix, and camera_angle_x or fl_x";
        Error::malformed(place, error.to_string(), expected)
    })?;
    if document.frames.is_empty() {
        let place = Place::Key("frames".to_owned());
        return Err(Error::malformed(place, "no frames", "at least one"));
    }
    let mut cameras = Vec::with_capacity(document.frames.len());
    for (number, frame) in document.frames.iter().enumerate() {
        cameras.push(camera(number, frame, document.lens, &folder, size)?);
    }
    Ok(CameraFile { cameras, folder })
}

fn read_text(path: &Path, limits: &Limits) -> Result<String> {
    let file = crate::base::bytes::SourceFile::open(path)?;
    let bytes = file.read(0, file.length(), limits.header_bytes)?;
    String::from_utf8(without_mark(&bytes).to_vec()).map_err(|_| {
        let expected = "a camera file: JSON with frames";
        Error::wrong_kind("bytes that are no text", expected).in_file(path)
    })
}

fn camera(
    number: usize,
    frame: &Frame,
    all: LensFields,
    folder: &Path,
    size: Option<[usize; 2]>,
) -> Result<Camera> {
    let name = frame.file_path.as_deref().and_then(|path| Path::new(path).file_stem());
    let name = name.map_or_else(|| format!("frame_{number}"), |n| n.to_string_lossy().into_owned());
    let fields = frame.lens.or(all);
    let place = Place::Key(format!("frames[{number}]"));
    let stated = match (fields.w, fields.h) {
        (Some(width), Some(height)) => Some([side(width, &place)?, side(height, &place)?]),
        _ => None,
    };
    let picture = || frame.file_path.as_deref().and_then(|path| picture_size(folder, path));
    let own = stated.or_else(picture);
    let [width, height] = own.or(size).unwrap_or([DEFAULT_SIDE; 2]);
    let (w, h) = (width as f64, height as f64);
    let fx = match (fields.fl_x, fields.camera_angle_x) {
        (Some(focal), _) => focal,
        (None, Some(angle)) if angle > 0.0 && angle < std::f64::consts::PI => {
            0.5 * w / libm::tan(0.5 * angle)
        }
        (None, Some(angle)) => {
            let found = format!("camera_angle_x {angle}");
            return Err(Error::malformed(place, found, "an angle above 0 and below pi"));
        }
        (None, None) => {
            return Err(Error::malformed(place, "no focal length", "fl_x or camera_angle_x"));
        }
    };
    let lens = Lens {
        width,
        height,
        focal: [fx, fields.fl_y.unwrap_or(fx)],
        center: [fields.cx.unwrap_or(0.5 * w), fields.cy.unwrap_or(0.5 * h)],
    };
    let lens = match size {
        Some([width, height]) => lens.reframed(width, height),
        None => lens,
    };
    let rows = frame.transform_matrix.map(DVec4::from_array);
    let to_world = DMat4::from_cols(rows[0], rows[1], rows[2], rows[3]).transpose();
    let camera = Camera { name, to_world, lens, picture: frame.file_path.clone() };
    camera.check()?;
    Ok(camera)
}

fn side(pixels: f64, place: &Place) -> Result<usize> {
    if pixels.fract() != 0.0 || !(1.0..=1e9).contains(&pixels) {
        let found = format!("a picture side of {pixels} pixels");
        return Err(Error::malformed(place.clone(), found, "a whole number from 1"));
    }
    limits::check("pixels along a side", pixels as u64, super::LARGEST_SIDE as u64, place)?;
    Ok(pixels as usize)
}

/// Size of a frame's picture, if it is there.
fn picture_size(folder: &Path, name: &str) -> Option<[usize; 2]> {
    let path = picture_path(folder, name)?;
    crate::base::picture::size(&path).ok()
}

/// Path of a frame's picture: as named, or with the extension that NeRF-synthetic files leave out.
pub fn picture_path(folder: &Path, name: &str) -> Option<PathBuf> {
    let plain = folder.join(name);
    let candidates = [plain.clone(), PathBuf::from(format!("{}.png", plain.display()))];
    candidates.into_iter().find(|path| path.is_file())
}

/// The frames that a list of names or indices picks, in its order; all if there is no list.
pub fn pick(cameras: Vec<Camera>, frames: &[String]) -> Result<Vec<Camera>> {
    if frames.is_empty() {
        return Ok(cameras);
    }
    let find = |wanted: &String| {
        let by_name = cameras.iter().find(|camera| camera.name == *wanted);
        let by_index = || wanted.parse().ok().and_then(|index: usize| cameras.get(index));
        by_name
            .or_else(by_index)
            .cloned()
            .ok_or_else(|| Error::invalid_option("frames", wanted, choices(&cameras)))
    };
    frames.iter().map(find).collect()
}

/// The names and indices that frames can be picked by.
fn choices(cameras: &[Camera]) -> String {
    let names: Vec<&str> =
        cameras.iter().take(NAMES_SHOWN).map(|camera| camera.name.as_str()).collect();
    let more = if cameras.len() > names.len() { ", ..." } else { "" };
    let last = cameras.len().saturating_sub(1);
    format!("a name ({}{more}) or an index from 0 to {last}", names.join(", "))
}
