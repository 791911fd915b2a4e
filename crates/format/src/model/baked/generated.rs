//! Objects of a container's metadata.
//!
//! Written by `cargo xtask generate` from `formats/container.toml`.

use serde::{Deserialize, Serialize};

use super::bends::Bends;
use super::domain::Decode;
use super::harmonics::HarmonicsMetadata;
use crate::model::generated::{
    Activation, Blend, ColorSpace, FootprintNeighbour, March, NumberType, StepRule, ViewInput,
    is_default, nullable,
};
use crate::model::grid::Bounds;

/// `lambda = clamp(line + sum of by * max(0, x - at), 0, min(last level, most))`, where `x =
/// log2(rho)`, `line = factor * x + bias`, the sum is over the `bends`, and `rho` is the footprint
/// of half a pixel in voxels of size `(max - min) / N`, doubled.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LevelOfDetail {
    /// 1/3 in the paper, 1/2 in the research code, 1 for mipmaps.
    pub factor: f32,
    /// Added after the factor.
    pub bias: f32,
    /// The point of the neighbouring ray to which the footprint is measured.
    #[serde(rename = "aside")]
    pub neighbour: FootprintNeighbour,
    /// An upper bound in addition to the last level, if any.
    #[serde(rename = "most", deserialize_with = "nullable")]
    pub bound: Option<f32>,
    /// Bends of the line; absent if there are none.
    #[cfg_attr(feature = "schemas", schemars(with = "Vec<[f32; 2]>"))]
    #[serde(default, skip_serializing_if = "is_default")]
    pub bends: Bends,
}

/// The network of chunk `VMLP`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct NetworkMetadata {
    /// Widths from input to output.
    pub widths: Vec<usize>,
    /// Octaves of the direction embedding.
    pub frequencies: usize,
    /// The rest of the first layer's input, after the embedding.
    pub input: ViewInput,
}

/// The encoding of one group of one level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Encoding {
    /// Number type of codes.
    pub number: NumberType,
    /// Bits per code: 1 to 16, or those of the float.
    pub bits: u32,
    /// Value of the middle code; 0 for floats.
    pub center: f32,
    /// Difference between the values of neighbouring codes at the middle; 0 for floats.
    pub step: f32,
    /// Growth of that difference towards the ends; 0 for floats.
    pub curve: f32,
    /// Value of nodes in blocks that are not stored.
    pub empty: f32,
    /// True if code 0 means `empty`.
    pub empty_code: bool,
    /// Meaning of decoded values.
    #[cfg_attr(feature = "schemas", schemars(with = "String"))]
    pub decode: Decode,
    /// Largest error of a decoded value at a retained node: in opacity over one interval for
    /// density, in colour (0 to 1) otherwise.
    pub max_error: f32,
}

/// One level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LevelMetadata {
    /// Nodes along x, y and z.
    pub dimensions: [usize; 3],
    /// Nodes along a block's edge.
    pub block_size: usize,
    /// The box of a shell; left out of levels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<Bounds>,
    /// Stored blocks, including those that inherit their colours.
    pub blocks_stored: usize,
    /// Blocks that inherit their colours from the next coarser level; absent if there are none.
    #[serde(default, skip_serializing_if = "is_default")]
    pub blocks_filled: usize,
    /// Density; `None` if the level uses that of level 0.
    #[serde(deserialize_with = "nullable")]
    pub density: Option<Encoding>,
    /// Diffuse colour.
    #[serde(deserialize_with = "nullable")]
    pub diffuse: Option<Encoding>,
    /// Specular features; `None` if there are none.
    #[serde(deserialize_with = "nullable")]
    pub features: Option<Encoding>,
    /// Coefficients of harmonics, band 1 first; absent if there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bands: Vec<Encoding>,
    /// Directional brightness; absent if there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub directional: Option<Encoding>,
    /// Anisotropy of density; absent if there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub anisotropy: Option<Encoding>,
}

/// Everything except bulk data. Levels are ordered fine to coarse.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Metadata {
    /// The box of level 0, in training axes; without shells, that of every level.
    pub bounds: Bounds,
    /// Raw density to opacity.
    pub activation: Activation,
    /// Steps along a ray.
    pub march: March,
    /// The rule for a step's length at each level.
    pub step_rule: StepRule,
    /// The rule for the level that a sample reads.
    pub level_of_detail: LevelOfDetail,
    /// Mixing of two levels.
    pub blend: Blend,
    /// Colour behind the field.
    pub background: [f32; 3],
    /// Color space of colours.
    pub color_space: ColorSpace,
    /// Colour channels of a node beyond three: specular features, or coefficients of harmonics
    /// beyond band 0.
    pub features: usize,
    /// View-dependent colour; `None` for a diffuse field.
    #[serde(deserialize_with = "nullable")]
    pub view: Option<ViewMetadata>,
    /// True if samples outside the free-space mask in chunk `MASK` are dropped.
    pub free_space: bool,
    /// Blocks up to this opacity over one interval were dropped. Renderers do not apply it to
    /// samples.
    pub alpha_threshold: f32,
    /// Name of the filter that made the coarser levels.
    pub filter: String,
    /// Fine to coarse.
    pub levels: Vec<LevelMetadata>,
    /// Shells of levels 1, 2, ...: what they show around smaller boxes; absent without nested
    /// boxes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub shells: Vec<LevelMetadata>,
}

/// View-dependent colour.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(untagged)]
pub enum ViewMetadata {
    /// Harmonics.
    Harmonics(HarmonicsMetadata),
    /// Network.
    Network(NetworkMetadata),
}
