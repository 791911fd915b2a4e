//! Values of a snapshot by the path of their keys.

use crate::base::error::{Error, Place, Result};
use crate::tensor::{Tensor, Value};

/// A document, whose values are found by paths: keys with dots between them.
pub(super) struct Keys<'a>(pub(super) &'a Value);

impl<'a> Keys<'a> {
    pub(super) fn find(&self, path: &str) -> Option<&'a Value> {
        let mut value = self.0;
        for key in path.split('.') {
            value = value.get(key)?;
        }
        (!value.is_none()).then_some(value)
    }

    pub(super) fn integer(&self, path: &str, default: Option<i64>, most: i64) -> Result<i64> {
        let found = match (self.find(path), default) {
            (None, Some(default)) => default,
            (found, _) => found.unwrap_or(&Value::None).integer(path)?,
        };
        if (0..=most).contains(&found) {
            return Ok(found);
        }
        let place = Place::Key(path.to_owned());
        Err(Error::malformed(place, found.to_string(), format!("0 to {most}")))
    }

    pub(super) fn number(&self, path: &str, default: f64) -> Result<f64> {
        self.find(path).map_or(Ok(default), |value| value.number(path))
    }

    /// Refuses unexpected texts. A missing one counts as the first.
    pub(super) fn text(&self, path: &str, expected: &[&str]) -> Result<()> {
        let found = match self.find(path) {
            None => return Ok(()),
            Some(Value::Text(text)) => text.clone(),
            Some(other) => other.describe(),
        };
        let known = expected.iter().any(|known| known.eq_ignore_ascii_case(&found));
        let refuse = || {
            let place = Place::Key(path.to_owned());
            Error::unsupported(place, format!("{found:?}"), expected.join(" or "))
        };
        known.then_some(()).ok_or_else(refuse)
    }

    pub(super) fn tensor(&self, path: &str) -> Result<&'a Tensor> {
        let found = self.find(path).unwrap_or(&Value::None);
        found.tensor().ok_or_else(|| {
            let place = Place::Key(path.to_owned());
            Error::malformed(place, found.describe(), "a binary value")
        })
    }
}
