//! The settings of a training, `config.yaml`, which the model's file lacks.

use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::plain_yaml::Plain;

/// Settings of a training. Those that are missing have SVRaster's defaults.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Config {
    /// Samples of a voxel.
    pub(super) samples: u32,
    /// Colour behind all voxels; none is the mean colour of each picture.
    pub(super) background: Option<f32>,
    /// Supersampling factor of pictures.
    pub(super) supersampling: f64,
    /// Doublings of the inner box.
    pub(super) outside_level: Option<u32>,
}

impl Default for Config {
    fn default() -> Self {
        Self { samples: 1, background: None, supersampling: 1.5, outside_level: None }
    }
}

/// A file of settings.
#[derive(Debug)]
pub(super) struct ConfigFile {
    pub(super) path: PathBuf,
    pub(super) digest: [u8; 32],
    pub(super) config: Config,
}

impl ConfigFile {
    /// Reads `NAME.config.yaml` beside `NAME.pt`, else `config.yaml` there, else the one in the
    /// folder above `checkpoints`. None if none of them exists.
    pub(super) fn beside(input: &Path, limits: &Limits) -> Result<Option<Self>> {
        let folder = input.parent().unwrap_or(Path::new(""));
        let mut paths = vec![input.with_extension("config.yaml"), folder.join("config.yaml")];
        if folder.file_name().is_some_and(|name| name == "checkpoints") {
            paths.extend(folder.parent().map(|run| run.join("config.yaml")));
        }
        let Some(path) = paths.into_iter().find(|path| path.is_file()) else { return Ok(None) };
        let file = SourceFile::open(&path)?;
        let bytes = file.read(0, file.length(), limits.header_bytes)?;
        let text = Plain::read(&String::from_utf8_lossy(&bytes));
        let config = Config::read(&text).map_err(|error| error.in_file(&path))?;
        Ok(Some(Self { path, digest: Sha256::digest(&bytes).into(), config }))
    }
}

impl Config {
    fn read(text: &Plain) -> Result<Self> {
        let mut config = Self::default();
        let refuse = |key: &str, found: String, expected: &str| {
            Err(Error::malformed(Place::Key(key.to_owned()), found, expected))
        };
        if let Some(samples) = number(text, "model.n_samp_per_vox")? {
            #[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
            let count = samples as u32;
            if !(1..=16).contains(&count) || f64::from(count) != samples {
                return refuse("model.n_samp_per_vox", samples.to_string(), "1 to 16 samples");
            }
            config.samples = count;
        }
        // GeoSVR's name for three samples of a voxel.
        if let Some(mode) = text.value("model.vox_geo_mode") {
            match mode.strip_prefix("triinterp").and_then(|count| count.parse().ok()) {
                Some(count @ 1..=16) => config.samples = count,
                _ => return refuse("model.vox_geo_mode", mode.to_owned(), "triinterp1 to 16"),
            }
        }
        let is = |key: &str| boolean(text, key);
        config.background = match (is("model.white_background")?, is("model.black_background")?) {
            (true, _) => Some(1.0),
            (false, true) => Some(0.0),
            (false, false) => None,
        };
        if let Some(times) = number(text, "model.ss")? {
            if !(0.1..=16.0).contains(&times) {
                return refuse("model.ss", times.to_string(), "0.1 to 16");
            }
            config.supersampling = times;
        }
        if let Some(level) = number(text, "bounding.outside_level")? {
            #[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
            let count = level as u32;
            if count > 15 || f64::from(count) != level {
                return refuse("bounding.outside_level", level.to_string(), "0 to 15 doublings");
            }
            config.outside_level = Some(count);
        }
        Ok(config)
    }
}

/// The number of a key; none if there is no such key, or it is null.
fn number(text: &Plain, key: &str) -> Result<Option<f64>> {
    let Some(value) = text.value(key) else { return Ok(None) };
    let number = value.parse::<f64>().ok().filter(|number| number.is_finite());
    number.map(Some).ok_or_else(|| unlike(key, value, "a finite number"))
}

/// The truth value of a key; false if there is no such key.
fn boolean(text: &Plain, key: &str) -> Result<bool> {
    match text.value(key) {
        None | Some("false" | "False") => Ok(false),
        Some("true" | "True") => Ok(true),
        Some(value) => Err(unlike(key, value, "true or false")),
    }
}

fn unlike(key: &str, found: &str, expected: &str) -> Error {
    let found: String = found.chars().take(80).collect();
    Error::malformed(Place::Key(key.to_owned()), found, expected)
}
