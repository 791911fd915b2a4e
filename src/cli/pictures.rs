//! Writes the pictures of `render` to files: all of a run, or none.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::animation::{Film, FilmFormat, FilmOptions};
use super::destination::Destination;
use super::output::create as create_output;
use super::picture::{contact_sheet, exr, png, rgb8, rgba8};
use crate::base::bytes::Provisional;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::model::camera::Camera;
use crate::view::render::Frame;

/// Default frames per second: a whole number of a GIF's time units.
const DEFAULT_RATE: u8 = 25;

/// The user's options for files.
#[derive(Debug, Clone, Copy)]
pub struct PictureOptions {
    /// The background colour to remove, for pictures with alpha.
    pub without_background: Option<[f32; 3]>,
    /// Float32 pictures too.
    pub exr: bool,
    /// A sheet of all scales for each frame.
    pub sheet: bool,
    /// Frames a second of a film.
    pub rate: Option<u8>,
    /// Existing files are replaced.
    pub force: bool,
}

/// The files of a run.
pub struct Pictures {
    destination: Destination,
    options: PictureOptions,
    scales: usize,
    /// Frames of the current sheet.
    row: Vec<Frame>,
    film: Option<Film>,
    made: Provisional,
}

impl Pictures {
    /// Refuses impossible outputs before rendering, and makes the folder.
    pub fn begin(
        destination: Destination,
        cameras: &[Camera],
        scales: &[usize],
        options: PictureOptions,
    ) -> Result<Self> {
        let mut pictures = Self {
            destination,
            options,
            scales: scales.len(),
            row: Vec::new(),
            film: None,
            made: Provisional::default(),
        };
        pictures.check(cameras.len() * scales.len())?;
        let mut names = BTreeSet::new();
        for camera in cameras {
            let sheet = pictures.sheet(&camera.name).into_iter();
            let files = scales.iter().flat_map(|&scale| pictures.files(&camera.name, scale));
            for file in files.chain(sheet) {
                let taken = !options.force && file.symlink_metadata().is_ok();
                if taken {
                    return Err(Error::new(ErrorKind::Exists, Place::File).in_file(&file));
                }
                // All frames of a film are in one file.
                let is_film = matches!(pictures.destination, Destination::Film(..));
                if !names.insert(file.clone()) && !is_film {
                    let message = "two of the frames have this name: pick one with --frames";
                    return Err(Error::usage(message).in_file(&file));
                }
            }
        }
        let folder = match &pictures.destination {
            Destination::Folder(folder) => Some(folder.as_path()),
            file => file.path().parent().filter(|folder| !folder.as_os_str().is_empty()),
        };
        pictures.made.create_folder(folder.unwrap_or(Path::new(".")))?;
        if let (Destination::Film(path, format), Some(camera)) =
            (&pictures.destination, cameras.first())
        {
            pictures.film = Some(start_film(path, *format, cameras, camera, scales, options)?);
        }
        Ok(pictures)
    }

    /// Refuses options that belong to another kind of output.
    fn check(&self, count: usize) -> Result<()> {
        let refuse = |message: String| Err(Error::usage(message).in_file(self.destination.path()));
        let PictureOptions { without_background, exr, sheet, rate, .. } = self.options;
        let one = matches!(self.destination, Destination::Png(_) | Destination::Exr(_));
        if one && count != 1 {
            return refuse(format!(
                "{count} pictures do not go into one: give a folder, or .gif, .webp or .mp4 for a \
                 film, or pick one with --frames and --scales"
            ));
        }
        if (exr || sheet) && !matches!(self.destination, Destination::Folder(_)) {
            return refuse("--exr and --sheet need a folder as --output".to_owned());
        }
        if without_background.is_some() && matches!(self.destination, Destination::Exr(_)) {
            return refuse("--alpha belongs to 8-bit pictures: an EXR has alpha anyway".to_owned());
        }
        match &self.destination {
            Destination::Film(_, format) if without_background.is_some() && !format.has_alpha() => {
                refuse("--alpha: a video has none: write a .webp, or a folder".to_owned())
            }
            Destination::Film(_, format) if rate.is_some_and(|rate| rate > format.fastest()) => {
                refuse(format!("--fps: at most {} frames per second", format.fastest()))
            }
            Destination::Film(..) => Ok(()),
            _ if rate.is_some() => {
                refuse(format!("--fps belongs to films: .{}", FilmFormat::EXTENSIONS.join(", .")))
            }
            _ => Ok(()),
        }
    }

    /// Adds the frame of a camera at a scale; frames come camera by camera, scale by scale. Returns
    /// its files.
    pub fn add(&mut self, camera: &str, scale: usize, frame: Frame) -> Result<Vec<PathBuf>> {
        let files = self.files(camera, scale);
        let PictureOptions { without_background, force, .. } = self.options;
        match &mut self.film {
            Some(film) => {
                let values = match without_background {
                    Some(background) => rgba8(&frame, background),
                    None => rgb8(&frame),
                };
                film.add(&values)?;
            }
            None => {
                for file in &files {
                    let is_exr = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
                    let bytes =
                        if is_exr { exr(&frame)? } else { png(&frame, without_background)? };
                    self.made.write(file, &bytes, force)?;
                }
            }
        }
        if let Some(sheet) = self.sheet(camera) {
            self.row.push(frame);
            if self.row.len() == self.scales {
                let frames = std::mem::take(&mut self.row);
                self.made.write(&sheet, &contact_sheet(&frames)?, force)?;
            }
        }
        Ok(files)
    }

    /// Finishes all files. Returns their bytes.
    pub fn finish(self) -> Result<u64> {
        let mut bytes = self.made.bytes();
        if let Some(film) = self.film {
            film.finish()?;
            let path = self.destination.path();
            bytes += path.metadata().map_err(|error| Error::io(error, path))?.len();
        }
        self.made.keep();
        Ok(bytes)
    }

    fn files(&self, name: &str, scale: usize) -> Vec<PathBuf> {
        let Destination::Folder(folder) = &self.destination else {
            return vec![self.destination.path().to_owned()];
        };
        let file = |extension: &str| folder.join(format!("{name}.s{scale}.{extension}"));
        let exr = self.options.exr.then(|| file("exr"));
        [file("png")].into_iter().chain(exr).collect()
    }

    fn sheet(&self, name: &str) -> Option<PathBuf> {
        let folder = self.destination.path();
        self.options.sheet.then(|| folder.join(format!("{name}.sheet.png")))
    }
}

fn start_film(
    path: &Path,
    format: FilmFormat,
    cameras: &[Camera],
    first: &Camera,
    scales: &[usize],
    options: PictureOptions,
) -> Result<Film> {
    let refuse = |message: String| Err(Error::usage(message).in_file(path));
    let &[scale] = scales else {
        return refuse("a film has one scale: give one to --scales, or a folder".to_owned());
    };
    let size = |camera: &Camera| {
        let lens = camera.lens.shrunk(scale);
        [lens.width, lens.height]
    };
    let [width, height] = size(first);
    if cameras.iter().any(|camera| size(camera) != [width, height]) {
        return refuse("the frames of a film have one size: give it with --size".to_owned());
    }
    if width.max(height) > format.largest_side() {
        return refuse(format!("a frame has at most {} pixels a side", format.largest_side()));
    }
    let rate = options.rate.unwrap_or(DEFAULT_RATE);
    let alpha = options.without_background.is_some();
    let output = create_output(path, options.force)?;
    Film::start(output, path, FilmOptions { format, size: [width, height], rate, alpha })
}
