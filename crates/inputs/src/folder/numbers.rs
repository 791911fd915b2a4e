//! Numbers of `scene_params.json`, each checked.

use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::tensor::{TensorFile, Value};

/// The parameters of a folder.
#[derive(Debug, Clone, Copy)]
pub struct Numbers<'a> {
    root: &'a Value,
    limits: &'a Limits,
}

impl<'a> Numbers<'a> {
    /// Those of a file.
    pub fn of(file: &'a TensorFile, limits: &'a Limits) -> Self {
        Self { root: &file.root, limits }
    }

    /// A finite number.
    ///
    /// # Errors
    /// `Malformed` for anything else.
    pub fn number(&self, key: &str) -> Result<f64> {
        let value = self.root.get(key).unwrap_or(&Value::None).number(key)?;
        let checked = value.is_finite().then_some(value);
        checked.ok_or_else(|| {
            let place = Place::Key(key.to_owned());
            Error::malformed(place, value.to_string(), "a finite number")
        })
    }

    /// A finite number above 0.
    ///
    /// # Errors
    /// `Malformed` for anything else.
    pub fn length(&self, key: &str) -> Result<f64> {
        let value = self.number(key)?;
        match value > 0.0 {
            true => Ok(value),
            false => {
                let place = Place::Key(key.to_owned());
                Err(Error::malformed(place, value.to_string(), "above 0"))
            }
        }
    }

    /// A count from 1 to `most`.
    ///
    /// # Errors
    /// `Malformed` for anything else.
    pub fn count(&self, key: &str, most: u64) -> Result<usize> {
        let value = self.root.get(key).unwrap_or(&Value::None).integer(key)?;
        let fits = usize::try_from(value).ok();
        let fits = fits.filter(|_| (1..=most.cast_signed()).contains(&value));
        fits.ok_or_else(|| {
            let place = Place::Key(key.to_owned());
            Error::malformed(place, value.to_string(), format!("1 to {most}"))
        })
    }

    /// Width, height and depth of something whose keys begin with `prefix`.
    ///
    /// # Errors
    /// Those of [`Self::count`].
    pub fn sizes(&self, prefix: &str) -> Result<[usize; 3]> {
        let most = self.limits.axis_nodes;
        let [x, y, z] = ["width", "height", "depth"].map(|name| format!("{prefix}_{name}"));
        Ok([self.count(&x, most)?, self.count(&y, most)?, self.count(&z, most)?])
    }

    /// Refuses scenes in normalised device coordinates, and pictures of other kinds.
    ///
    /// # Errors
    /// `Unsupported` for these.
    pub fn refuse_other_kinds(&self) -> Result<()> {
        let place = |key: &str| Place::Key(key.to_owned());
        let flag =
            |key: &str| self.root.get(key).is_some_and(|value| value.boolean(key).is_ok_and(|b| b));
        if flag("ndc") {
            let found = "a scene in normalised device coordinates";
            return Err(Error::unsupported(place("ndc"), found, "a scene in a box"));
        }
        if let Some(Value::Text(format)) = self.root.get("format")
            && format != "png"
        {
            return Err(Error::unsupported(place("format"), format, "png"));
        }
        Ok(())
    }
}
