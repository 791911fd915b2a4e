//! Objects of a container's metadata that trained fields have too, and enums.
//!
//! Written by `cargo xtask generate` from `formats/container.toml`.

use serde::{Deserialize, Deserializer, Serialize};

use crate::model::grid::Bounds;

/// Rules for a step's length at each level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum StepRule {
    /// `stepsize * voxel_size` at every level, as trained.
    Constant,
    /// `stepsize * voxel_size * 2^lambda` from a sample of level of detail `lambda` to the next.
    LevelOfDetail,
}

/// Mixing of two levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Blend {
    /// Decoded values are mixed, then activated once, as trained.
    BeforeActivation,
    /// Optical depths and activated colours of the levels are mixed.
    AfterActivation,
}

/// Color spaces of colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum ColorSpace {
    /// Display-referred sRGB, as in the training pictures.
    SrgbDisplay,
}

/// The values that are interpolated between nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum ActivationOrder {
    /// Raw density; softplus and opacity come after ("post-activation").
    Raw,
    /// Density after softplus (`in_act_density`).
    Density,
    /// Opacity (`pre_act_density`).
    Opacity,
}

/// The function from raw density to density.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum DensityFunction {
    /// `softplus(raw + shift)`: raw densities are logits.
    #[default]
    Softplus,
    /// `max(raw, 0)`: raw densities are densities, and may be negative.
    Relu,
}

/// The point of the neighbouring ray to which a footprint is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum FootprintNeighbour {
    /// The point at the same distance: the pixel's size there.
    SameDistance,
    /// The sample of the same index, as in the paper and the research code. If the rays enter the
    /// box at different distances, samples are blurred.
    SameIndex,
}

/// The rest of the first layer's input, after the embedding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum ViewInput {
    /// Accumulated diffuse colour, then the accumulated features.
    DiffuseAndFeatures,
    /// The accumulated features alone.
    Features,
}

/// Where colours are clamped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Evaluation {
    /// Once per ray, after the weighted sum.
    Ray,
    /// At each sample.
    Sample,
}

/// Limits of a colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Clamp {
    /// No colour is below 0.
    Zero,
    /// No limits.
    None,
    /// The sum is a logit: colours are `sigmoid(sum)`. At samples only.
    Sigmoid,
}

/// Number types of codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum NumberType {
    /// One byte.
    U8,
    /// Two bytes.
    U16,
    /// IEEE binary16.
    F16,
    /// IEEE binary32.
    F32,
}

/// `sigma = softplus(raw + shift)` or `max(raw, 0)`, `alpha = 1 - exp(-sigma * interval)`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Activation {
    /// Added to raw density before softplus; 0 with `relu`.
    pub shift: f32,
    /// Step length divided by the base voxel size.
    pub interval: f32,
    /// The values that are interpolated between nodes.
    pub order: ActivationOrder,
    /// Raw density to density; absent for softplus.
    #[serde(default, skip_serializing_if = "is_default")]
    pub function: DensityFunction,
}

/// Steps along a ray.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct March {
    /// Step length in voxels.
    pub stepsize: f32,
    /// Edge, in world units, of a cube with the volume of a trained voxel. `stepsize * voxel_size`
    /// is the interval over which opacities are stated.
    pub voxel_size: f32,
    /// Edges, in world units, of the voxels that are the unit of steps; absent for cubes of
    /// `voxel_size`. Along a unit direction `d`, a step is `stepsize / |d / voxel|` long.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voxel: Option<[f32; 3]>,
    /// Nearest start of rays, as distance along the axis of the camera.
    pub near: f32,
    /// Farthest start of rays in the box, in the same units; `None` is unlimited.
    #[serde(deserialize_with = "nullable")]
    pub far: Option<f32>,
    /// Samples of at most this weight add no colour.
    pub color_threshold: f32,
    /// Samples of at most this opacity are dropped.
    pub alpha_threshold: f32,
    /// The part of the box in which rays are sampled; absent for all of it. There are no samples
    /// outside it, though there may be nodes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sampled: Option<Bounds>,
}

/// True for a value that says nothing, whose key is left out.
pub(super) fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// A key that must be there, though its value may be null.
pub(super) fn nullable<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    from: D,
) -> std::result::Result<Option<T>, D::Error> {
    Option::deserialize(from)
}
