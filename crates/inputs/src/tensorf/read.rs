//! Settings and arrays by their names.

use crate::base::error::{Error, Place, Result};
use crate::model::grid::Bounds;
use crate::tensor::{Tensor, Value};

/// An array of the model.
pub(super) fn tensor<'a>(state: &'a Value, name: &str) -> Result<&'a Tensor> {
    state.get(name).and_then(Value::tensor).ok_or_else(|| {
        let place = Place::Tensor(format!("state_dict.{name}"));
        Error::malformed(place, "no such array", "an array of a TensoRF model")
    })
}

/// A box, as its two corners.
pub(super) fn corners(value: Option<&Value>, name: &str) -> Result<Bounds> {
    let numbers = value.map(|value| value.numbers(name)).transpose()?.unwrap_or_default();
    let &[x0, y0, z0, x1, y1, z1] = numbers.as_slice() else {
        return Err(malformed(name, format!("{numbers:?}"), "the two corners of a box"));
    };
    #[expect(clippy::cast_possible_truncation, reason = "a field's box is float32")]
    let [min, max] = [[x0, y0, z0], [x1, y1, z1]].map(|at| at.map(|value| value as f32));
    let bounds = Bounds { min, max };
    bounds.check_model(&key(name))?;
    Ok(bounds)
}

/// The place of a setting.
pub(super) fn key(name: &str) -> Place {
    Place::Key(name.to_owned())
}

/// An impossible setting.
pub(super) fn malformed(
    name: &str,
    found: impl Into<String>,
    expected: impl Into<String>,
) -> Error {
    Error::malformed(key(name), found, expected)
}
