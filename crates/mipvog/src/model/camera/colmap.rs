//! Cameras of COLMAP's sparse models: `cameras.bin` and `images.bin`, or the same as `.txt`.
//!
//! An image states the rotation and translation from the world to its camera's axes, which point
//! right, down and forwards:
//!
//! ```text
//! p of the camera = R(q) p of the world + t
//! ```
//!
//! A model becomes the same document as a `transforms.json`, and is read by the same rules. Its
//! world is COLMAP's own. Points, which make up most of `images.bin`, are skipped.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DMat4, DQuat, DVec3};
use serde_json::{Value, json};

use super::document::{Document, Fields};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;

/// Models of cameras by their numbers in binary files, with the names of their parameters.
const MODELS: [(&str, &[&str]); 11] = [
    ("SIMPLE_PINHOLE", &["fl_x", "cx", "cy"]),
    ("PINHOLE", &["fl_x", "fl_y", "cx", "cy"]),
    ("SIMPLE_RADIAL", &["fl_x", "cx", "cy", "k1"]),
    ("RADIAL", &["fl_x", "cx", "cy", "k1", "k2"]),
    ("OPENCV", &["fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2"]),
    ("OPENCV_FISHEYE", &["fl_x", "fl_y", "cx", "cy", "k1", "k2", "k3", "k4"]),
    ("FULL_OPENCV", &["fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]),
    ("FOV", &["fl_x", "fl_y", "cx", "cy", "k1"]),
    ("SIMPLE_RADIAL_FISHEYE", &["fl_x", "cx", "cy", "k1"]),
    ("RADIAL_FISHEYE", &["fl_x", "cx", "cy", "k1", "k2"]),
    (
        "THIN_PRISM_FISHEYE",
        &["fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "s1", "s2"],
    ),
];
/// Bytes of an image before its name: its number, rotation, translation, and its camera's number.
const IMAGE: usize = 4 + 7 * 8 + 4;
/// Bytes of a name with its end, at most.
const LONGEST_NAME: usize = 4096;
/// Bytes of a point of an image.
const POINT: u64 = 24;
/// Folders of pictures, relative to the model's folder.
const PICTURES: [&str; 3] = ["images", "../images", "../../images"];
/// Tolerance of the norm of rotation quaternions.
const ROUNDING: f64 = 1e-2;

/// True for the name of a file of a model.
pub(super) fn is_model(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    matches!(name, "cameras.bin" | "images.bin" | "cameras.txt" | "images.txt")
}

/// Reads the model that a file belongs to, and finds the folder of its pictures.
///
/// # Errors
/// Files that cannot be read, `Malformed` for damaged ones and for images without a camera.
pub(super) fn read(path: &Path, limits: &Limits) -> Result<(Document, PathBuf)> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let is_text = path.extension().is_some_and(|extension| extension == "txt");
    let named = |name: &str| folder.join(name).with_extension(if is_text { "txt" } else { "bin" });
    let (cameras, images) = (named("cameras"), named("images"));
    let in_file = |path: &PathBuf| {
        let path = path.clone();
        move |error: Error| error.in_file(&path)
    };
    let lenses = match is_text {
        true => text_lenses(&text(&cameras, limits)?),
        false => binary_lenses(&cameras, limits),
    };
    let lenses = lenses.map_err(in_file(&cameras))?;
    let found = match is_text {
        true => text_images(&text(&images, limits)?),
        false => binary_images(&images),
    };
    let found = found.map_err(in_file(&images))?;
    let frames = found.into_iter().map(|image| image.frame(&lenses)).collect::<Result<Vec<_>>>();
    let document = Document::of(frames.map_err(in_file(&images))?).map_err(in_file(&images))?;
    let pictures = PICTURES.iter().map(|name| folder.join(name)).find(|path| path.is_dir());
    Ok((document, pictures.unwrap_or_else(|| folder.to_owned())))
}

/// The values of a camera, by their names in a `transforms.json`.
type Lens = Vec<(&'static str, Value)>;
/// By the numbers of cameras.
type Lenses = BTreeMap<u32, Lens>;

fn lens(model: &str, size: [u64; 2], parameters: &[f64], place: &Place) -> Result<Lens> {
    let mut values =
        vec![("camera_model", json!(model)), ("w", json!(size[0])), ("h", json!(size[1]))];
    // Unsupported camera models are refused by name, frame by frame.
    if let Some((_, names)) = MODELS.iter().find(|(name, _)| *name == model) {
        if names.len() != parameters.len() {
            let found = format!("{} parameters of a {model}", parameters.len());
            return Err(Error::malformed(place.clone(), found, names.len().to_string()));
        }
        values.extend(names.iter().copied().zip(parameters.iter().map(|value| json!(value))));
    }
    Ok(values)
}

/// An image of a model.
struct Image {
    rotation: [f64; 4],
    translation: [f64; 3],
    camera: u32,
    name: String,
}

impl Image {
    /// From the numbers of an image: a quaternion, real part first, and a translation.
    fn new(numbers: [f64; 7], camera: u32, name: String) -> Self {
        let [w, x, y, z, right, down, forwards] = numbers;
        Self { rotation: [x, y, z, w], translation: [right, down, forwards], camera, name }
    }

    fn frame(self, lenses: &Lenses) -> Result<Fields> {
        let place = || Place::Key(format!("image {}", self.name));
        let Some(lens) = lenses.get(&self.camera) else {
            let found = format!("camera {}, which is not in the file of cameras", self.camera);
            return Err(Error::malformed(place(), found, "one of its cameras"));
        };
        let rotation = DQuat::from_array(self.rotation);
        if (rotation.length() - 1.0).abs() > ROUNDING || rotation.is_nan() {
            let found = format!("a quaternion of length {}", rotation.length());
            return Err(Error::malformed(place(), found, "a rotation, whose length is 1"));
        }
        let back = rotation.normalize().conjugate();
        let at = -(back * DVec3::from(self.translation));
        let columns = [back * DVec3::X, back * DVec3::NEG_Y, back * DVec3::NEG_Z];
        let [x, y, z] = columns.map(|axis| axis.extend(0.0));
        let rows = DMat4::from_cols(x, y, z, at.extend(1.0)).transpose().to_cols_array_2d();
        let own = [("file_path", json!(self.name)), ("transform_matrix", json!(rows))];
        Ok(Fields::of(lens.iter().cloned().chain(own)))
    }
}

fn text(path: &Path, limits: &Limits) -> Result<String> {
    let file = SourceFile::open(path)?;
    let bytes = file.read(0, file.length(), limits.header_bytes)?;
    String::from_utf8(bytes).map_err(|_| {
        Error::wrong_kind("bytes that are no text", "a sparse model of COLMAP, as text")
            .in_file(path)
    })
}

/// The words of a line, one after the other.
struct Words<'a> {
    words: std::str::SplitWhitespace<'a>,
    place: Place,
}

impl<'a> Words<'a> {
    fn new(number: usize, line: &'a str) -> Self {
        Self { words: line.split_whitespace(), place: Place::Line(number as u64 + 1) }
    }

    fn text(&mut self, what: &str) -> Result<&'a str> {
        let place = &self.place;
        self.words.next().ok_or_else(|| Error::malformed(place.clone(), "the end of it", what))
    }

    fn number<T: std::str::FromStr>(&mut self, what: &str) -> Result<T> {
        let word = self.text(what)?;
        word.parse().map_err(|_| Error::malformed(self.place.clone(), word, what))
    }
}

fn text_lenses(text: &str) -> Result<Lenses> {
    let mut lenses = Lenses::new();
    let lines = text.lines().enumerate();
    for (number, line) in lines.filter(|(_, line)| is_content(line)) {
        let mut words = Words::new(number, line);
        let camera = words.number("the number of a camera")?;
        let model = words.text("a model of cameras")?;
        let size = [words.number("a width in pixels")?, words.number("a height in pixels")?];
        let mut parameters = Vec::new();
        while let Some(word) = words.words.next() {
            let value = word.parse::<f64>().ok().filter(|value| value.is_finite());
            parameters.push(value.ok_or_else(|| {
                Error::malformed(words.place.clone(), word, "a parameter, a finite number")
            })?);
        }
        lenses.insert(camera, lens(model, size, &parameters, &words.place)?);
    }
    Ok(lenses)
}

fn is_content(line: &str) -> bool {
    !line.trim().is_empty() && !line.starts_with('#')
}

fn text_images(text: &str) -> Result<Vec<Image>> {
    let mut images = Vec::new();
    let mut lines = text.lines().enumerate();
    while let Some((number, line)) = lines.next() {
        if !is_content(line) {
            continue;
        }
        let mut words = Words::new(number, line);
        words.number::<u32>("the number of an image")?;
        let mut numbers = [0.0; 7];
        for value in &mut numbers {
            *value = words.number("a number of a rotation or a translation")?;
        }
        let camera = words.number("the number of a camera")?;
        // A name may have spaces.
        let first = words.text("the name of a picture")?;
        let name = [first].into_iter().chain(words.words).collect::<Vec<_>>().join(" ");
        images.push(Image::new(numbers, camera, name));
        // Its points; the list may be empty.
        lines.next();
    }
    Ok(images)
}

/// The numbers of a binary file, from a place on.
struct Numbers<'a> {
    bytes: &'a [u8],
    at: u64,
}

impl Numbers<'_> {
    fn next<const N: usize>(&mut self) -> Result<[u8; N]> {
        let place = Place::Offset(self.at);
        let Some((found, rest)) = self.bytes.split_first_chunk::<N>() else {
            return Err(Error::malformed(place, "the end of the file", format!("{N} bytes more")));
        };
        (self.bytes, self.at) = (rest, self.at + N as u64);
        Ok(*found)
    }
}

fn binary_lenses(path: &Path, limits: &Limits) -> Result<Lenses> {
    let file = SourceFile::open(path)?;
    let bytes = file.read(0, file.length(), limits.header_bytes)?;
    let mut numbers = Numbers { bytes: &bytes, at: 0 };
    let count = u64::from_le_bytes(numbers.next()?);
    let mut lenses = Lenses::new();
    for _ in 0..count {
        let place = Place::Offset(numbers.at);
        let camera = u32::from_le_bytes(numbers.next()?);
        let model = i32::from_le_bytes(numbers.next()?);
        let size = [u64::from_le_bytes(numbers.next()?), u64::from_le_bytes(numbers.next()?)];
        let known = usize::try_from(model).ok().and_then(|model| MODELS.get(model));
        let Some((name, names)) = known else {
            let expected = format!("0 to {}", MODELS.len() - 1);
            return Err(Error::unsupported(place, format!("model {model} of cameras"), expected));
        };
        let mut parameters = Vec::with_capacity(names.len());
        for _ in *names {
            parameters.push(f64::from_le_bytes(numbers.next()?));
        }
        if let Some(value) = parameters.iter().find(|value| !value.is_finite()) {
            let found = format!("a parameter that is {value}");
            return Err(Error::malformed(place, found, "finite numbers"));
        }
        lenses.insert(camera, lens(name, size, &parameters, &place)?);
    }
    Ok(lenses)
}

fn binary_images(path: &Path) -> Result<Vec<Image>> {
    let file = SourceFile::open(path)?;
    let piece = |at: u64, most: usize| {
        let count = file.length().saturating_sub(at).min(most as u64);
        file.read(at, count, most as u64)
    };
    let start = piece(0, 8)?;
    let count = u64::from_le_bytes(Numbers { bytes: &start, at: 0 }.next()?);
    let (mut at, mut images) = (8, Vec::new());
    for _ in 0..count {
        let bytes = piece(at, IMAGE + LONGEST_NAME)?;
        let mut numbers = Numbers { bytes: &bytes, at };
        numbers.next::<4>()?;
        let mut pose = [0.0; 7];
        for value in &mut pose {
            *value = f64::from_le_bytes(numbers.next()?);
        }
        let camera = u32::from_le_bytes(numbers.next()?);
        let place = Place::Offset(numbers.at);
        let Some(length) = numbers.bytes.iter().position(|byte| *byte == 0) else {
            let found = "a name without an end";
            let expected = format!("one of at most {LONGEST_NAME} bytes");
            return Err(Error::malformed(place, found, expected));
        };
        let name = numbers.bytes.get(..length).unwrap_or_default();
        let name = String::from_utf8_lossy(name).into_owned();
        images.push(Image::new(pose, camera, name));
        at = numbers.at + length as u64 + 1;
        let points = u64::from_le_bytes(Numbers { bytes: &piece(at, 8)?, at }.next()?);
        let skipped = points.checked_mul(POINT).and_then(|bytes| bytes.checked_add(8));
        let next = skipped.and_then(|bytes| at.checked_add(bytes));
        let Some(next) = next.filter(|next| *next <= file.length()) else {
            let found = format!("{points} points of an image");
            let expected = format!("as many as {} bytes hold", file.length() - at);
            return Err(Error::malformed(Place::Offset(at), found, expected));
        };
        at = next;
    }
    Ok(images)
}

#[cfg(test)]
mod tests;
