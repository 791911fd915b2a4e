//! Canonical JSON: keys sorted by their bytes, no spaces, numbers in the shortest form that parses
//! to the same double. Equal values have equal bytes.

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::base::error::{Error, Place, Result};

/// Writes a value as canonical JSON.
pub fn to_canonical(value: &impl Serialize) -> Result<String> {
    let value = serde_json::to_value(value).map_err(|error| not_json(&error, &Place::File))?;
    Ok(sorted(value).to_string())
}

/// Reads canonical JSON. Refuses any other form of a value: writing the value again must give the
/// same bytes.
pub fn from_canonical<T: DeserializeOwned + Serialize>(text: &[u8], place: &Place) -> Result<T> {
    let value: T = serde_json::from_slice(text).map_err(|error| not_json(&error, place))?;
    if to_canonical(&value)?.as_bytes() == text {
        return Ok(value);
    }
    Err(Error::malformed(
        place.clone(),
        "JSON in another form",
        "canonical JSON: sorted keys, no spaces, shortest numbers",
    ))
}

fn sorted(value: Value) -> Value {
    match value {
        Value::Object(map) => {
            let mut entries: Vec<_> = map.into_iter().collect();
            entries.sort_by(|(a, _), (b, _)| a.cmp(b));
            Value::Object(entries.into_iter().map(|(key, value)| (key, sorted(value))).collect())
        }
        Value::Array(items) => Value::Array(items.into_iter().map(sorted).collect()),
        other => other,
    }
}

fn not_json(error: &serde_json::Error, place: &Place) -> Error {
    Error::malformed(place.clone(), format!("JSON that does not fit: {error}"), "the stated keys")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_sorted_and_numbers_exact() {
        let value: Value =
            serde_json::from_str(r#"{ "b": 0.1, "a": [1, {"z": null, "y": 2.50}] }"#)
                .expect("valid JSON");
        let text = to_canonical(&value).expect("finite");
        assert_eq!(text, r#"{"a":[1,{"y":2.5,"z":null}],"b":0.1}"#);
        let back: Value = from_canonical(text.as_bytes(), &Place::File).expect("canonical");
        assert_eq!(back["b"], 0.1);
        assert!(from_canonical::<Value>(br#"{"b":1,"a":2}"#, &Place::File).is_err());
        assert!(from_canonical::<Value>(br#"{"a":1,"a":1}"#, &Place::File).is_err());
        assert!(from_canonical::<Value>(br#"{"a":1.0e0}"#, &Place::File).is_err());
    }
}
