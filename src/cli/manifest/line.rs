//! A line of a manifest.

use std::fmt::Formatter;
use std::path::Path;

use serde::de::{Deserialize, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value};

use super::super::output::STANDARD_STREAM;
use super::options::{OptionKind, is_value, of_scenes};
use crate::base::error::{Error, Place, Result};

/// A scene to bake.
#[derive(Debug)]
pub struct SceneLine {
    /// The input's path.
    pub input: String,
    /// The output's path.
    pub output: String,
    /// Options of `bake`, with underscores or dashes.
    pub options: Map<String, Value>,
}

impl SceneLine {
    /// Of paths on the command line.
    ///
    /// # Errors
    /// `Usage` for paths other than UTF-8, because results are JSON.
    pub fn of(input: &Path, output: &Path) -> Result<Self> {
        let text = |path: &Path| {
            let text = path.to_str().map(str::to_owned);
            text.ok_or_else(|| Error::usage("several inputs need names in UTF-8").in_file(path))
        };
        Ok(Self { input: text(input)?, output: text(output)?, options: Map::new() })
    }

    /// Of the text of line `number`, counted from 1. Options are checked against the names in
    /// `known`; the parser of the command line checks their values.
    ///
    /// # Errors
    /// [`Malformed`](crate::base::error::ErrorKind::Malformed) with the line.
    pub fn parse(text: &str, number: u64, known: &[OptionKind]) -> Result<Self> {
        let wrong =
            |found: String, expected: &str| Error::malformed(Place::Line(number), found, expected);
        let form = "an object {\"input\": PATH, \"output\": PATH, \"options\": {...}}";
        let UniqueKeys(value) =
            serde_json::from_str(text).map_err(|error| match error.classify() {
                serde_json::error::Category::Data => {
                    let found = error.to_string();
                    wrong(
                        found.split(" at line").next().unwrap_or_default().to_owned(),
                        "each key once",
                    )
                }
                _ => wrong(format!("no JSON at column {}", error.column()), form),
            })?;
        let Value::Object(mut members) = value else {
            return Err(wrong(kind(&value).to_owned(), form));
        };
        let mut path = |key: &str| match members.swap_remove(key) {
            Some(Value::String(path)) if !path.is_empty() && path != STANDARD_STREAM => Ok(path),
            Some(Value::String(path)) => Err(wrong(format!("{key} \"{path}\""), "a path")),
            Some(value) => Err(wrong(format!("{key}: {}", kind(&value)), "a path, a string")),
            None => Err(wrong(format!("no {key}"), form)),
        };
        let (input, output) = (path("input")?, path("output")?);
        let options = match members.swap_remove("options") {
            None => Map::new(),
            Some(Value::Object(options)) => options,
            Some(value) => {
                let expected = "an object of options of bake";
                return Err(wrong(format!("options: {}", kind(&value)), expected));
            }
        };
        if let Some((key, _)) = members.iter().next() {
            return Err(wrong(format!("key {key}"), "input, output and options"));
        }
        for (name, value) in &options {
            let spelled = |other: &&String| other.replace('_', "-") == name.replace('_', "-");
            if options.keys().filter(spelled).count() > 1 {
                return Err(wrong(format!("option {name} in two spellings"), "one of them"));
            }
            if !of_scenes(known).any(|option| option.is_named(name)) {
                return Err(wrong(format!("option {name}"), "an option of bake for one scene"));
            }
            if !is_value(value) {
                let expected = "a string, a number, true, false, null or a list of such";
                return Err(wrong(format!("option {name}: {}", kind(value)), expected));
            }
        }
        Ok(Self { input, output, options })
    }
}

/// A JSON value without duplicate keys, of which the parser would keep the last.
struct UniqueKeys(Value);

impl<'de> Deserialize<'de> for UniqueKeys {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        deserializer.deserialize_any(UniqueKeysVisitor).map(Self)
    }
}

struct UniqueKeysVisitor;

impl<'de> Visitor<'de> for UniqueKeysVisitor {
    type Value = Value;

    fn expecting(&self, f: &mut Formatter) -> std::fmt::Result {
        f.write_str("a JSON value")
    }

    fn visit_unit<E>(self) -> std::result::Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E>(self, value: bool) -> std::result::Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E>(self, value: i64) -> std::result::Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E>(self, value: u64) -> std::result::Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E>(self, value: f64) -> std::result::Result<Value, E> {
        Ok(value.into())
    }

    fn visit_str<E>(self, value: &str) -> std::result::Result<Value, E> {
        Ok(value.into())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> std::result::Result<Value, A::Error> {
        let mut values = Vec::new();
        while let Some(UniqueKeys(value)) = seq.next_element()? {
            values.push(value);
        }
        Ok(values.into())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<Value, A::Error> {
        let mut members = Map::new();
        while let Some((key, UniqueKeys(value))) = map.next_entry::<String, _>()? {
            if members.contains_key(&key) {
                return Err(A::Error::custom(format!("key {key} twice")));
            }
            members.insert(key, value);
        }
        Ok(members.into())
    }
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "true or false",
        Value::Number(_) => "a number",
        Value::String(_) => "a string",
        Value::Array(_) => "a list",
        Value::Object(_) => "an object",
    }
}
