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
    /// The sample of the neighbouring ray that the footprint is measured to.
    #[serde(rename = "aside")]
    pub neighbour: FootprintNeighbour,
    /// An upper bound beside the last level, if there is one.
    #[serde(rename = "most", deserialize_with = "nullable")]
    pub bound: Option<f32>,
    /// Where the line bends; left out where it does not.
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
    /// Bits that codes use: 1 to 16, or those of the float.
    pub bits: u32,
    /// Value of the middle code; 0 for floats.
    pub center: f32,
    /// Distance of neighbouring codes' values at the middle; 0 for floats.
    pub step: f32,
    /// Growth of that distance towards the ends; 0 for floats.
    pub curve: f32,
    /// Value of dropped blocks.
    pub empty: f32,
    /// True if code 0 means `empty`.
    pub empty_code: bool,
    /// Meaning of decoded values.
    #[cfg_attr(feature = "schemas", schemars(with = "String"))]
    pub decode: Decode,
    /// Largest distance, at a retained node, between the decoded and the encoded value: in opacity
    /// over one interval for density, in colour (0 to 1) otherwise.
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
    /// Stored blocks, those whose colours are inherited among them.
    pub blocks_stored: usize,
    /// Blocks whose colours are inherited from the next coarser level; left out where there are
    /// none.
    #[serde(default, skip_serializing_if = "is_default")]
    pub blocks_filled: usize,
    /// Density; `None` where every level uses level 0's.
    #[serde(deserialize_with = "nullable")]
    pub density: Option<Encoding>,
    /// Diffuse colour.
    #[serde(deserialize_with = "nullable")]
    pub diffuse: Option<Encoding>,
    /// Specular features; `None` without any.
    #[serde(deserialize_with = "nullable")]
    pub features: Option<Encoding>,
    /// Coefficients of harmonics, band 1 first; left out where there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bands: Vec<Encoding>,
    /// Directional brightness; left out where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub directional: Option<Encoding>,
    /// Anisotropy of density; left out where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub anisotropy: Option<Encoding>,
}

/// All that is not bulk. Levels go fine to coarse.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Metadata {
    /// The box of level 0, and without shells of every level, in training axes.
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
    /// Opacity over one interval up to which blocks were dropped. Not for single samples.
    pub alpha_threshold: f32,
    /// Name of the filter that made the coarser levels.
    pub filter: String,
    /// Fine to coarse.
    pub levels: Vec<LevelMetadata>,
    /// What lies around the box of level 0, from level 1 on; left out where nothing does.
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
