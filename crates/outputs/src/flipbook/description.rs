//! The text beside a sheet.

use serde::{Deserialize, Serialize};

/// Describes a sheet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// `mipvog-flipbook/1`.
    pub schema: String,
    /// Name of the picture beside this text.
    pub sheet: String,
    /// Tiles along a row of the sheet, and rows. Tiles are numbered row by row from the top left.
    pub columns: usize,
    /// Rows of tiles; the last one may have empty tiles.
    pub rows: usize,
    /// Points along x, y and z. Tile `k` holds the points of `z = k`: x to the right, y down.
    pub dims: [usize; 3],
    /// The world's box that texture coordinates from 0 to 1 span: half a step around the points.
    #[serde(rename = "box")]
    pub bounds: [[f64; 3]; 2],
    /// Distance of points along each axis, in world units.
    pub spacing: [f64; 3],
    /// World units over which alpha of a `.png` is opacity. Null in an `.exr`, where it is density.
    pub step: Option<f64>,
    /// The level of the field.
    pub level: usize,
    /// Meaning of red, green and blue: `srgb` or `linear`.
    pub color: String,
    /// The corner of a tile that has the lowest x and y: `top_left`.
    pub origin: String,
    /// Meaning of alpha: `opacity` or `density`, optical depth per world unit.
    pub alpha: String,
    /// The largest density.
    pub largest_density: f32,
    /// Name and SHA-256 of the input.
    pub source: DescribedSource,
}

/// The input.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DescribedSource {
    /// Name of its file.
    pub name: String,
    /// SHA-256 in hexadecimal digits.
    pub sha256: String,
}

/// The corner of a tile with the lowest x and y.
pub const ORIGIN: &str = "top_left";

/// The schema of the text.
pub const SCHEMA: &str = "mipvog-flipbook/1";
