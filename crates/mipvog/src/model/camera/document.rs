//! The JSON of a camera file: values by name, none of them interpreted.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::{Deserialize, Deserializer, Error as _, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_json::Value;

use crate::base::error::{Error, Place, Result};
use crate::base::text::{is_quoted_number, quoted_numbers};

/// Names of the values that are read, in a file and in its frames. All other values are ignored.
const NAMES: [&str; 47] = [
    "file_path",
    "transform_matrix",
    "transform",
    "camera_model",
    "is_fisheye",
    "fisheye",
    "latlong",
    "equirectangular",
    "orthographic",
    "ftheta_p0",
    "ftheta_p1",
    "ftheta_p2",
    "ftheta_p3",
    "ftheta_p4",
    "fl_x",
    "fl_y",
    "camera_angle_x",
    "camera_angle_y",
    "x_fov",
    "y_fov",
    "cx",
    "cy",
    "w",
    "h",
    "width",
    "height",
    "k1",
    "k2",
    "k3",
    "k4",
    "k5",
    "k6",
    "p1",
    "p2",
    "p3",
    "p4",
    "b1",
    "b2",
    "s1",
    "s2",
    "s3",
    "s4",
    "distortion",
    "distortion_params",
    "camera_path",
    "applied_transform",
    "applied_scale",
];

/// Values of a file or of a frame, by name.
#[derive(Debug, Default)]
pub(super) struct Fields(BTreeMap<&'static str, Value>);

impl Fields {
    /// From values by name; the last one of a name counts.
    pub(super) fn of(values: impl IntoIterator<Item = (&'static str, Value)>) -> Self {
        Self(values.into_iter().collect())
    }

    /// A value that is present and not null.
    pub(super) fn get(&self, name: &str) -> Option<&Value> {
        self.0.get(name).filter(|value| !value.is_null())
    }

    /// A number that is present.
    ///
    /// # Errors
    /// `Malformed` for other values, and for numbers that are not finite.
    pub(super) fn number(&self, name: &str, place: &Place) -> Result<Option<f64>> {
        self.get(name).map(|value| number(value, name, place)).transpose()
    }

    fn add<'de, A: MapAccess<'de>>(
        &mut self,
        name: &str,
        map: &mut A,
    ) -> std::result::Result<(), A::Error> {
        let Some(&known) = NAMES.iter().find(|&&known| known == name) else {
            return map.next_value::<IgnoredAny>().map(|_| ());
        };
        // A camera path of nerfstudio's viewer is recognized by this key alone.
        let value = match known {
            "camera_path" => map.next_value::<IgnoredAny>().map(|_| Value::Bool(true))?,
            _ => map.next_value()?,
        };
        match self.0.insert(known, value) {
            Some(_) => Err(A::Error::custom(format!("{known} twice"))),
            None => Ok(()),
        }
    }
}

/// The number that a value is.
///
/// # Errors
/// `Malformed` for other values, and for numbers that are not finite.
pub(super) fn number(value: &Value, name: &str, place: &Place) -> Result<f64> {
    match value {
        Value::Number(number) if number.as_f64().is_some_and(f64::is_finite) => {
            Ok(number.as_f64().unwrap_or_default())
        }
        Value::String(text) if is_quoted_number(text) => {
            Err(Error::malformed(place.clone(), format!("{name} {text}"), "a finite number"))
        }
        other => {
            let found = format!("{name} that is {}", kind(other));
            Err(Error::malformed(place.clone(), found, "a number"))
        }
    }
}

/// The kind of a value, in a few words.
pub(super) fn kind(value: &Value) -> String {
    match value {
        Value::Null => "null".to_owned(),
        Value::Bool(value) => value.to_string(),
        Value::Number(value) => value.to_string(),
        Value::String(text) => format!("the text {:?}", text.chars().take(40).collect::<String>()),
        Value::Array(items) => format!("a list of {}", items.len()),
        Value::Object(_) => "an object".to_owned(),
    }
}

impl<'de> Deserialize<'de> for Fields {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct Reader;
        impl<'de> Visitor<'de> for Reader {
            type Value = Fields;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a frame: an object with transform_matrix")
            }

            fn visit_map<A: MapAccess<'de>>(
                self,
                mut map: A,
            ) -> std::result::Result<Fields, A::Error> {
                let mut fields = Fields::default();
                while let Some(name) = map.next_key::<String>()? {
                    fields.add(&name, &mut map)?;
                }
                Ok(fields)
            }
        }
        deserializer.deserialize_map(Reader)
    }
}

/// A parsed camera file.
#[derive(Debug, Default)]
pub(super) struct Document {
    /// Values for all frames.
    pub(super) all: Fields,
    /// The frames, where there are any.
    pub(super) frames: Option<Vec<Fields>>,
    /// True for a bare list of frames, as `ns-export cameras` writes it.
    pub(super) is_list: bool,
}

impl<'de> Deserialize<'de> for Document {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct Reader;
        impl<'de> Visitor<'de> for Reader {
            type Value = Document;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object with frames")
            }

            fn visit_map<A: MapAccess<'de>>(
                self,
                mut map: A,
            ) -> std::result::Result<Document, A::Error> {
                let mut document = Document::default();
                while let Some(name) = map.next_key::<String>()? {
                    if name != "frames" {
                        document.all.add(&name, &mut map)?;
                    } else if document.frames.replace(map.next_value()?).is_some() {
                        return Err(A::Error::custom("frames twice"));
                    }
                }
                Ok(document)
            }

            fn visit_seq<A: SeqAccess<'de>>(
                self,
                mut list: A,
            ) -> std::result::Result<Document, A::Error> {
                let mut frames = Vec::new();
                while let Some(frame) = list.next_element()? {
                    frames.push(frame);
                }
                Ok(Document { frames: Some(frames), is_list: true, ..Document::default() })
            }
        }
        deserializer.deserialize_any(Reader)
    }
}

impl Document {
    /// From frames that state all of their values.
    ///
    /// # Errors
    /// `Malformed` for no frames.
    pub(super) fn of(frames: Vec<Fields>) -> Result<Self> {
        Self { frames: Some(frames), ..Self::default() }.checked()
    }

    /// Reads a file's text.
    ///
    /// # Errors
    /// `WrongKind` for other texts, `Malformed` with its line for damaged JSON.
    pub(super) fn read(text: &str) -> Result<Self> {
        let document: Self = serde_json::from_str(&quoted_numbers(text)).map_err(|error| {
            match text.trim_start().chars().next() {
                // Comments, which JSON does not have, are a mistake in a file of the right kind.
                Some('{' | '/' | '#') => {}
                Some('[') if !error.is_data() => {}
                _ => return other_kind("another file"),
            }
            let place = Place::Line(error.line() as u64);
            let expected = "frames with transform_matrix, and camera_angle_x or fl_x, in JSON";
            Error::malformed(place, error.to_string(), expected)
        })?;
        document.checked()
    }

    fn checked(self) -> Result<Self> {
        let document = self;
        let is_path = document.all.get("camera_path").is_some();
        match &document.frames {
            None if is_path => Err(other_kind("a camera path of nerfstudio's viewer").advise(
                "give a transforms.json: a camera path has no frames and names no lens of its \
                 pictures; nerfstudio itself renders it (ns-render camera-path)",
            )),
            None => Err(other_kind("JSON without frames")),
            Some(frames) if frames.is_empty() => {
                let place = Place::Key("frames".to_owned());
                Err(Error::malformed(place, "no frames", "at least one"))
            }
            Some(_) => Ok(document),
        }
    }
}

/// The error for a valid file that is not a camera file.
fn other_kind(found: &str) -> Error {
    Error::wrong_kind(found, "a camera file: JSON with frames")
        .advise("name a camera file: NeRF-synthetic's transforms.json, or nerfstudio's")
}
