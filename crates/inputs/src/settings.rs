//! Settings of a scene from files beside its input.
//!
//! Training codes keep step length, near, far and background in a configuration, not in the
//! checkpoint. Two files may hold them for this program: `scene.toml` or `scene.json` beside the
//! input, and the camera file. Both are read for these keys alone:
//!
//! | key | value |
//! |---|---|
//! | `stepsize` | voxels |
//! | `near`, `far` | distance along the axis of the camera |
//! | `background` | one number or three, 0 to 1 |
//! | `color_threshold` | a weight, 0 to below 1 |

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::options::SourceOptions;
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::Limits;
use crate::base::text;

/// Names of files beside an input. The first existing one counts.
const NAMES: [&str; 2] = ["scene.toml", "scene.json"];

/// The settings of one file.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneSettings {
    /// The file.
    pub path: PathBuf,
    /// The settings it states; the others are `None`.
    pub options: SourceOptions,
}

impl SceneSettings {
    /// Reads the settings beside an input, or inside a folder. `None` if there is no such file.
    ///
    /// # Errors
    ///
    /// A file that cannot be read or is not TOML or JSON; a setting of the wrong type or out of
    /// range.
    pub fn beside(input: &Path, limits: &Limits) -> Result<Option<Self>> {
        let folder = if input.is_dir() { Some(input) } else { input.parent() };
        let folder = folder.unwrap_or(Path::new(""));
        let mut paths = NAMES.iter().map(|name| folder.join(name));
        let found = paths.find(|path| path.is_file() && path != input);
        found.map(|path| Self::read(&path, limits)).transpose()
    }

    /// Reads the settings that a file of JSON or, by its name, of TOML states.
    ///
    /// # Errors
    ///
    /// As [`Self::beside`].
    pub fn read(path: &Path, limits: &Limits) -> Result<Self> {
        let file = SourceFile::open(path)?;
        Self::parse(&file.read(0, file.length(), limits.header_bytes)?, path)
    }

    /// The settings that the bytes of the file `path` state.
    ///
    /// # Errors
    ///
    /// Bytes that are not TOML or JSON; a setting of the wrong type or out of range.
    pub fn parse(bytes: &[u8], path: &Path) -> Result<Self> {
        let is_toml = path.extension().is_some_and(|extension| extension == "toml");
        let options = match is_toml {
            true => parse_toml(bytes),
            false => parse_json(bytes),
        };
        let options = options.and_then(|document| settings(&document));
        let options = options.map_err(|error| error.in_file(path))?;
        Ok(Self { path: path.to_owned(), options })
    }

    /// Sets those of `options` that are not set yet. Returns their names.
    pub fn complete(&self, options: &mut SourceOptions) -> Vec<&'static str> {
        let mut names = Vec::new();
        fn set<T: Copy>(
            name: &'static str,
            stated: Option<T>,
            open: &mut Option<T>,
            names: &mut Vec<&'static str>,
        ) {
            if open.is_none() && stated.is_some() {
                *open = stated;
                names.push(name);
            }
        }
        let stated = &self.options;
        set("stepsize", stated.stepsize, &mut options.stepsize, &mut names);
        set("near", stated.near, &mut options.near, &mut names);
        set("far", stated.far, &mut options.far, &mut names);
        set("background", stated.background, &mut options.background, &mut names);
        set("color_threshold", stated.color_threshold, &mut options.color_threshold, &mut names);
        names
    }
}

fn parse_json(bytes: &[u8]) -> Result<Value> {
    let json = String::from_utf8_lossy(text::without_mark(bytes));
    serde_json::from_str(&text::quoted_numbers(&json)).map_err(|error| {
        let place = Place::Key(format!("line {}", error.line()));
        Error::malformed(place, error.to_string(), "settings of a scene, in JSON")
    })
}

fn parse_toml(bytes: &[u8]) -> Result<Value> {
    let malformed =
        |found: String| Error::malformed(Place::File, found, "settings of a scene, in TOML");
    let text = str::from_utf8(bytes).map_err(|error| malformed(error.to_string()))?;
    let document: toml::Table =
        toml::from_str(text).map_err(|error| malformed(error.message().to_owned()))?;
    // JSON has no such numbers; they would count as missing settings.
    if let Some(key) = not_finite(&document) {
        let place = Place::Key(key.to_owned());
        return Err(Error::malformed(place, "a number that is not finite", "a finite number"));
    }
    serde_json::to_value(&document).map_err(|error| malformed(error.to_string()))
}

/// The first key whose value has numbers that are not finite.
fn not_finite(document: &toml::Table) -> Option<&str> {
    fn is_odd(value: &toml::Value) -> bool {
        match value {
            toml::Value::Float(number) => !number.is_finite(),
            toml::Value::Array(values) => values.iter().any(is_odd),
            _ => false,
        }
    }
    document.iter().find(|(_, value)| is_odd(value)).map(|(key, _)| key.as_str())
}

fn settings(document: &Value) -> Result<SourceOptions> {
    let number = |key: &str| -> Result<Option<f32>> {
        let Some(value) = document.get(key).filter(|value| !value.is_null()) else {
            return Ok(None);
        };
        #[expect(clippy::cast_possible_truncation, reason = "the range is checked below")]
        let number = value.as_f64().map(|number| number as f32);
        number.map(Some).ok_or_else(|| unexpected(key, value, "a number"))
    };
    let background = match document.get("background") {
        None | Some(Value::Null) => None,
        Some(value) => Some(color(value).ok_or_else(|| {
            unexpected("background", value, "one number or a list of three, 0 to 1")
        })?),
    };
    let options = SourceOptions {
        stepsize: number("stepsize")?,
        near: number("near")?,
        far: number("far")?,
        background,
        color_threshold: number("color_threshold")?,
        ..SourceOptions::default()
    };
    match options.check() {
        Ok(()) => Ok(options),
        // The option has the key's name.
        Err(error) => Err(match error.kind() {
            ErrorKind::InvalidOption { option, found, expected } => {
                let place = Place::Key((*option).to_owned());
                Error::malformed(place, found.clone(), expected.clone())
            }
            _ => error,
        }),
    }
}

fn color(value: &Value) -> Option<[f32; 3]> {
    #[expect(clippy::cast_possible_truncation, reason = "the range is checked by the caller")]
    let number = |value: &Value| value.as_f64().map(|number| number as f32);
    match value.as_array().map(Vec::as_slice) {
        Some([red, green, blue]) => Some([number(red)?, number(green)?, number(blue)?]),
        Some(_) => None,
        None => number(value).map(|grey| [grey; 3]),
    }
}

fn unexpected(key: &str, found: &Value, expected: &str) -> Error {
    Error::malformed(Place::Key(key.to_owned()), found.to_string(), expected)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_read_from_either_syntax() {
        let json = parse_json(br#"{"stepsize": 0.25, "near": 2, "background": [0, 0.5, 1]}"#);
        let toml = parse_toml(b"stepsize = 0.25\nnear = 2\nbackground = [0, 0.5, 1]\n");
        let [json, toml] = [json, toml].map(|text| settings(&text.expect("text")).expect("read"));
        assert_eq!(json, toml);
        assert_eq!(json.stepsize, Some(0.25));
        assert_eq!(json.background, Some([0.0, 0.5, 1.0]));
        assert_eq!(json.far, None);
    }

    #[test]
    fn wrong_types_and_ranges_are_refused() {
        for text in [
            r#"{"stepsize": "a half"}"#,
            r#"{"stepsize": -1}"#,
            r#"{"near": [1]}"#,
            r#"{"background": {"type": "sky"}}"#,
            r#"{"background": [1, 2, 3]}"#,
            "{",
        ] {
            let read = parse_json(text.as_bytes()).and_then(|document| settings(&document));
            assert!(read.is_err(), "{text}");
        }
        for text in ["stepsize = ", "stepsize = nan", "far = inf", "background = [0, -inf, 0]"] {
            assert!(parse_toml(text.as_bytes()).is_err(), "{text}");
        }
    }

    #[test]
    fn stated_settings_complete_open_ones_only() {
        let options = SourceOptions { near: Some(2.0), far: Some(6.0), ..Default::default() };
        let stated = SceneSettings { path: "scene.json".into(), options };
        let mut open = SourceOptions { far: Some(9.0), ..SourceOptions::default() };
        assert_eq!(stated.complete(&mut open), ["near"]);
        assert_eq!((open.near, open.far), (Some(2.0), Some(9.0)));
    }
}
