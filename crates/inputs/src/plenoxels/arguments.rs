//! The settings of a training run, `args.json`, which the model's file lacks.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use sha2::{Digest, Sha256};

use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::base::text::{quoted_numbers, without_mark};
use crate::options::SourceOptions;

/// The rendering settings. Missing ones have svox2's defaults.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default)]
pub(super) struct RunArguments {
    pub(super) step_size: f64,
    pub(super) sigma_thresh: f64,
    pub(super) stop_thresh: f64,
    pub(super) background_brightness: f64,
    pub(super) near_clip: f64,
    pub(super) last_sample_opaque: bool,
    pub(super) use_spheric_clip: bool,
    pub(super) renderer_backend: String,
    pub(super) dataset_type: String,
    /// Factor on the cameras' positions; null if the data set's own factor applies.
    pub(super) scene_scale: Option<f64>,
}

impl Default for RunArguments {
    fn default() -> Self {
        Self {
            step_size: 0.5,
            sigma_thresh: 1e-8,
            stop_thresh: 1e-7,
            background_brightness: 1.0,
            near_clip: 0.0,
            last_sample_opaque: false,
            use_spheric_clip: false,
            renderer_backend: "cuvol".to_owned(),
            dataset_type: "auto".to_owned(),
            scene_scale: None,
        }
    }
}

/// A file of settings.
#[derive(Debug)]
pub(super) struct ArgumentsFile {
    pub(super) path: PathBuf,
    pub(super) digest: [u8; 32],
    pub(super) arguments: RunArguments,
}

impl ArgumentsFile {
    /// Reads `NAME.args.json` beside `NAME.npz`, else `args.json`. None if there is neither.
    pub(super) fn beside(input: &Path, limits: &Limits) -> Result<Option<Self>> {
        let folder = input.parent().unwrap_or(Path::new(""));
        let paths = [input.with_extension("args.json"), folder.join("args.json")];
        let Some(path) = paths.into_iter().find(|path| path.is_file()) else { return Ok(None) };
        let file = SourceFile::open(&path)?;
        let bytes = file.read(0, file.length(), limits.header_bytes)?;
        let arguments = parse(&bytes).map_err(|error| error.in_file(&path))?;
        let digest = Sha256::digest(&bytes).into();
        Ok(Some(Self { path, digest, arguments }))
    }
}

fn parse(bytes: &[u8]) -> Result<RunArguments> {
    let malformed = |error: serde_json::Error| {
        let place = Place::Key(format!("line {}", error.line()));
        Error::malformed(place, error.to_string(), "the settings of a svox2 training run")
    };
    // A list would parse as settings without names.
    let text = String::from_utf8_lossy(without_mark(bytes));
    let settings: serde_json::Map<String, serde_json::Value> =
        serde_json::from_str(&quoted_numbers(&text)).map_err(malformed)?;
    let arguments: RunArguments = serde_json::from_value(settings.into()).map_err(malformed)?;
    arguments.check()?;
    Ok(arguments)
}

impl RunArguments {
    /// Refuses settings out of range, and renderers other than straight rays through cells.
    fn check(&self) -> Result<()> {
        let key = |name: &str| Place::Key(name.to_owned());
        let require = |name: &str, value: f64, holds: bool, expected: &str| match holds {
            true => Ok(()),
            false => Err(Error::malformed(key(name), value.to_string(), expected)),
        };
        let step = self.step_size;
        require("step_size", step, step > 0.0 && step <= 64.0, "a length above 0, up to 64 cells")?;
        let share = |value: f64| (0.0..1.0).contains(&value);
        require("stop_thresh", self.stop_thresh, share(self.stop_thresh), "0 to below 1")?;
        let least = self.sigma_thresh;
        require("sigma_thresh", least, least >= 0.0 && least.is_finite(), "a density from 0")?;
        let grey = self.background_brightness;
        let expected = "a brightness from 0 to 1";
        require("background_brightness", grey, (0.0..=1.0).contains(&grey), expected)?;
        let near = self.near_clip;
        require("near_clip", near, near >= 0.0 && near.is_finite(), "a distance of 0 or more")?;
        let scale = self.scene_scale.unwrap_or(1.0);
        #[expect(clippy::cast_possible_truncation, reason = "used in float32")]
        let holds = SourceOptions::SCALES.contains(&(scale as f32));
        require("scene_scale", scale, holds, "a number from 1e-9 to 1e9")?;
        let refuse = |name: &str, found: String, expected: &str| {
            Err(Error::unsupported(key(name), found, expected))
        };
        match self.renderer_backend.as_str() {
            "cuvol" => {}
            "nvol" => {
                let found = "the renderer nvol, which accumulates opacity differently";
                return refuse("renderer_backend", found.to_owned(), "cuvol");
            }
            "svox1" => {
                let found = "the renderer svox1, which does not interpolate between cells";
                return refuse("renderer_backend", found.to_owned(), "cuvol");
            }
            other => return refuse("renderer_backend", format!("the renderer {other}"), "cuvol"),
        }
        if self.dataset_type == "llff" {
            let found = "a scene in normalised device coordinates (llff), whose rays are not \
                         straight in the world";
            return refuse("dataset_type", found.to_owned(), "a scene in world coordinates");
        }
        if self.use_spheric_clip {
            let found = "rays that start at a sphere".to_owned();
            return refuse("use_spheric_clip", found, "rays that start at the box");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_of_a_run_are_read_and_foreign_renderers_refused() {
        let read = parse(br#"{"step_size": 0.25, "scene_scale": null, "lr_sigma": 30.0}"#);
        let read = read.expect("settings");
        assert_eq!((read.step_size, read.scene_scale), (0.25, None));
        assert_eq!(read.stop_thresh, 1e-7, "svox2's own");
        for refused in [
            r#"{"renderer_backend": "nvol"}"#,
            r#"{"renderer_backend": "svox1"}"#,
            r#"{"dataset_type": "llff"}"#,
            r#"{"use_spheric_clip": true}"#,
            r#"{"step_size": 0}"#,
            r#"{"background_brightness": 2}"#,
            r#"{"scene_scale": -1}"#,
            "[]",
        ] {
            assert!(parse(refused.as_bytes()).is_err(), "{refused}");
        }
    }
}
