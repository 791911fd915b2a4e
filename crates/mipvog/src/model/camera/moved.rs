//! Cameras of a dataset in the training's world, which nerfstudio rotates, translates and scales.
//!
//! ```text
//! p of the training = scale (M A^-1 p of the camera file)
//! ```
//!
//! `M` and `scale` are those of `dataparser_transforms.json`. `A` is the camera file's own
//! `applied_transform`, which is already applied to its poses; `M` applies to the poses before
//! that.

use std::path::Path;

use glam::{DMat4, DVec4};
use serde_json::Value;

use super::Camera;
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;

/// A rotation and a translation, then a scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorldTransform {
    matrix: DMat4,
    scale: f64,
}

/// Tolerance of a rotation's determinant.
const TURN_ERROR: f64 = 1e-3;

impl WorldTransform {
    /// Reads nerfstudio's `dataparser_transforms.json`.
    ///
    /// # Errors
    /// A file that cannot be read, and `Malformed` for a matrix that does more than rotate and
    /// translate, or a scale that is not above 0.
    pub fn read(path: &Path, limits: &Limits) -> Result<Self> {
        let file = SourceFile::open(path)?;
        let bytes = file.read(0, file.length(), limits.header_bytes)?;
        Self::parse(&bytes).map_err(|error| error.in_file(path))
    }

    fn parse(bytes: &[u8]) -> Result<Self> {
        let document: Value = serde_json::from_slice(bytes).map_err(|error| {
            let place = Place::Key(format!("line {}", error.line()));
            let expected = "nerfstudio's dataparser_transforms.json";
            Error::malformed(place, error.to_string(), expected)
        })?;
        let missing = |key: &str| {
            Error::malformed(Place::Key(key.to_owned()), "nothing", "nerfstudio's transform")
        };
        let matrix = document.get("transform").ok_or_else(|| missing("transform"))?;
        let scale = document.get("scale").ok_or_else(|| missing("scale"))?;
        Ok(Self { matrix: turn(matrix, "transform")?, scale: positive(scale, "scale")? })
    }

    /// A camera of a file whose poses were already rotated and scaled.
    pub(super) fn moved(&self, camera: &Camera, before: Self) -> Camera {
        let scale = self.scale / before.scale;
        let mut to_world = self.matrix * before.matrix.inverse() * camera.to_world;
        to_world.w_axis = (scale * to_world.w_axis.truncate()).extend(1.0);
        Camera { to_world, ..camera.clone() }
    }
}

/// The transform that was applied to the poses of a camera file: its `applied_transform` and
/// `applied_scale`.
///
/// # Errors
/// As [`WorldTransform::read`].
pub(super) fn applied(matrix: Option<&Value>, scale: Option<&Value>) -> Result<WorldTransform> {
    Ok(WorldTransform {
        matrix: matrix.map_or(Ok(DMat4::IDENTITY), |matrix| turn(matrix, "applied_transform"))?,
        scale: scale.map_or(Ok(1.0), |scale| positive(scale, "applied_scale"))?,
    })
}

/// A rotation and translation matrix of three or four rows, possibly mirrored.
fn turn(value: &Value, key: &str) -> Result<DMat4> {
    let refuse = |found: &str| {
        let expected = "three or four rows of four numbers, a rotation and a position";
        Error::malformed(Place::Key(key.to_owned()), found, expected)
    };
    let rows = value.as_array().filter(|rows| (3..=4).contains(&rows.len()));
    let rows = rows.ok_or_else(|| refuse("another shape"))?;
    let mut columns = [DVec4::ZERO, DVec4::ZERO, DVec4::ZERO, DVec4::W];
    for (column, row) in columns.iter_mut().zip(rows.iter().take(3)) {
        let numbers: Vec<f64> =
            row.as_array().into_iter().flatten().filter_map(Value::as_f64).collect();
        let numbers = <[f64; 4]>::try_from(numbers).map_err(|_| refuse("another shape"))?;
        *column = DVec4::from_array(numbers);
    }
    let matrix = DMat4::from_cols_array_2d(&columns.map(|column| column.to_array())).transpose();
    let is_turn = (matrix.determinant().abs() - 1.0).abs() < TURN_ERROR;
    if is_turn { Ok(matrix) } else { Err(refuse("a matrix that scales")) }
}

fn positive(value: &Value, key: &str) -> Result<f64> {
    value.as_f64().filter(|scale| *scale > 0.0).ok_or_else(|| {
        Error::malformed(Place::Key(key.to_owned()), value.to_string(), "a number above 0")
    })
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use glam::DVec3;

    use super::super::parse;
    use super::*;

    const QUARTER: &[u8] =
        br#"{"transform": [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3]], "scale": 0.5}"#;

    fn place(applied: &str) -> DVec3 {
        let text = format!(
            r#"{{"camera_angle_x": 0.7, {applied} "frames": [{{"file_path": "a", "transform_matrix":
               [[1, 0, 0, 4], [0, 1, 0, 5], [0, 0, 1, 6], [0, 0, 0, 1]]}}]}}"#
        );
        let file = parse(&text, PathBuf::new(), Some([4, 4])).expect("a camera file");
        let moved = file.moved(&WorldTransform::parse(QUARTER).expect("a transform"));
        let cameras = moved.pick(&[]).expect("a camera").cameras;
        cameras[0].to_world.w_axis.truncate()
    }

    #[test]
    fn cameras_are_turned_moved_and_scaled() {
        assert_eq!(place(""), DVec3::new(-2.0, 3.0, 4.5));
        // The file's poses are already rotated, and scaled by two.
        let applied = r#""applied_transform": [[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0]],
                         "applied_scale": 2,"#;
        assert_eq!(place(applied), DVec3::new(-1.25, 1.75, 1.75));
    }

    #[test]
    fn other_transforms_are_refused() {
        for text in [
            "",
            "[]",
            r#"{"scale": 1}"#,
            r#"{"transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}"#,
            r#"{"transform": [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "scale": 1}"#,
            r#"{"transform": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "scale": 1}"#,
            r#"{"transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "scale": 0}"#,
        ] {
            assert!(WorldTransform::parse(text.as_bytes()).is_err(), "{text}");
        }
    }
}
