//! The renderer's settings beside the bulk: the JSON of a container's `META` chunk.

use serde::{Deserialize, Serialize};

use super::{DensityDomain, Encoding, Group};
use crate::model::field::{Activation, March, nullable};
use crate::model::grid::{BlockGrid, Bounds, Nodes};
use crate::model::view_mlp::ViewInput;

/// All that is not bulk. Levels go fine to coarse.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Metadata {
    /// The box that every level spans, in training axes.
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
    /// Specular features of a node.
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
}

/// One level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LevelMetadata {
    /// Nodes along x, y and z.
    pub dimensions: [usize; 3],
    /// Nodes along a block's edge.
    pub block_size: usize,
    /// Stored blocks, those whose colours are inherited among them.
    pub blocks_stored: usize,
    /// Blocks whose colours are inherited from the next coarser level; left out where there are
    /// none.
    #[serde(default, skip_serializing_if = "is_none")]
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
}

fn is_none(count: &usize) -> bool {
    *count == 0
}

impl LevelMetadata {
    /// The cut into blocks.
    pub fn grid(&self) -> BlockGrid {
        BlockGrid { nodes: Nodes(self.dimensions), edge: self.block_size }
    }

    /// The domain of the level's density; raw where it has none, as every file's level 0 may be.
    pub fn density_domain(&self) -> DensityDomain {
        let stated = self.density.as_ref().and_then(|density| density.decode.density());
        stated.unwrap_or(DensityDomain::Raw)
    }

    /// True if colours are stored in integer codes, as inherited blocks require.
    pub fn has_integer_colors(&self) -> bool {
        let mut colors = [&self.diffuse, &self.features].into_iter().flatten();
        colors.all(|encoding| !encoding.number.is_float())
    }

    /// The encoding of a group, to be changed.
    pub fn encoding_mut(&mut self, group: Group) -> Option<&mut Encoding> {
        match group {
            Group::Density => self.density.as_mut(),
            Group::Diffuse => self.diffuse.as_mut(),
            Group::Features => self.features.as_mut(),
        }
    }

    /// The encoding of a group.
    pub fn encoding(&self, group: Group) -> Option<&Encoding> {
        match group {
            Group::Density => self.density.as_ref(),
            Group::Diffuse => self.diffuse.as_ref(),
            Group::Features => self.features.as_ref(),
        }
    }
}

/// Rules for a step's length at each level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepRule {
    /// `stepsize * voxel_size` at every level, as trained.
    Constant,
    /// `stepsize * voxel_size * 2^lambda` from a sample of level of detail `lambda` to the next.
    LevelOfDetail,
}

/// Mixing of two levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Blend {
    /// Decoded values are mixed, then activated once, as trained.
    BeforeActivation,
    /// Optical depths and activated colours of the levels are mixed.
    AfterActivation,
}

/// Color spaces of colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColorSpace {
    /// Display-referred sRGB, as the training pictures.
    SrgbDisplay,
}

/// The sample of the neighbouring ray that a sample's footprint is measured to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FootprintNeighbour {
    /// The one at the same distance: the pixel's size there.
    SameDistance,
    /// The one of the same index, as in the paper and the research code. If the box is entered
    /// through an oblique face, the entries differ, and samples behind it are blurred.
    SameIndex,
}

/// `lambda = clamp(factor * log2(rho) + bias, 0, min(last level, most))`, where `rho` is the
/// footprint of half a pixel in voxels of size `(max - min) / N`, doubled.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
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
}

/// The network of chunk `VMLP`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewMetadata {
    /// Widths from input to output.
    pub widths: Vec<usize>,
    /// Octaves of the direction embedding.
    pub frequencies: usize,
    /// The rest of the first layer's input, after the embedding.
    pub input: ViewInput,
}
