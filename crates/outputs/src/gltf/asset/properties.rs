//! The objects of `MIPVOG_radiance_field`: everything that a viewer must know before it fetches the
//! container. Rules have the names of the container's metadata, so that readers need no mapping.

use serde::{Deserialize, Serialize};

use crate::base::bytes::{hex, sha256};
use crate::base::error::{Error, Place, Result};
use crate::container::Container;
use crate::model::baked::{ColorSpace, DensityDomain, ViewMetadata};
use crate::model::field::{ActivationOrder, DensityFunction};
use crate::model::harmonics::Harmonics;
use crate::model::view_mlp::ViewInput;

/// Media type of the container.
pub const MIME_TYPE: &str = "model/vnd.mipvog";

/// A radiance field of a document. Keys that are not here are left alone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct RadianceField {
    /// URI of the container outside the asset; or `buffer_view`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uri: Option<String>,
    /// Number of the buffer view that holds the container.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub buffer_view: Option<usize>,
    /// [`MIME_TYPE`].
    pub mime_type: String,
    /// SHA-256 of the container, in hexadecimal.
    pub sha256: String,
    /// Lowest corner of the box, training axes.
    pub min: [f32; 3],
    /// Highest corner of the box, training axes.
    pub max: [f32; 3],
    /// Nodes of the finest level.
    pub dimensions: [usize; 3],
    /// Nodes along a block's edge, of the finest level.
    pub block_size: usize,
    /// Coarse to fine.
    pub levels: Vec<Level>,
    /// The rules that turn stored density into opacity.
    pub opacity: Opacity,
    /// Color space of colours.
    pub color_space: ColorSpace,
    /// Specular features.
    pub feature_count: usize,
    /// The deferred network; none for a diffuse field.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mlp: Option<Mlp>,
    /// The rules of harmonics; none if colours are no coefficients.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub harmonics: Option<Harmonics>,
}

/// A level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Level {
    /// Lowest corner of the level's box, of nested boxes; left out where all levels span one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<[f32; 3]>,
    /// Highest corner of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<[f32; 3]>,
    /// Nodes along x, y and z.
    pub dimensions: [usize; 3],
    /// Nodes along a block's edge.
    pub block_size: usize,
    /// Bytes from the container's start after which the level renders.
    pub byte_length: u64,
    /// Meaning of the level's densities; none if it uses the finest level's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub density: Option<DensityDomain>,
}

/// `softplus(raw + shift) * interval`, or `max(raw, 0) * interval`, is the optical depth of raw
/// density over one interval.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Opacity {
    /// The values that are interpolated between nodes.
    pub order: ActivationOrder,
    /// Added to raw density before softplus.
    pub shift: f32,
    /// Step length over base voxel size.
    pub interval: f32,
    /// Raw density to density; left out where it is softplus.
    #[serde(default, skip_serializing_if = "is_softplus")]
    pub function: DensityFunction,
}

fn is_softplus(function: &DensityFunction) -> bool {
    *function == DensityFunction::Softplus
}

/// The deferred network's shape.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Mlp {
    /// Widths from input to output.
    pub widths: Vec<usize>,
    /// Octaves of the direction's embedding.
    pub frequencies: usize,
    /// The rest of the first layer's input, after the embedding.
    pub input: ViewInput,
}

impl RadianceField {
    /// The properties of a container, without its digest and where it lies.
    pub fn of_container(container: &Container) -> Result<Self> {
        let metadata = container.metadata();
        let no_levels = || Error::malformed(Place::File, "no levels", "one or more");
        let finest = metadata.levels.first().ok_or_else(no_levels)?;
        let mut levels = Vec::new();
        for (number, level) in metadata.levels.iter().enumerate().rev() {
            let own = |entry_level: Option<u32>| entry_level == u32::try_from(number).ok();
            let entries = container.entries().iter().filter(|entry| own(entry.level));
            let own = Some(metadata.level_bounds(number)).filter(|_| !metadata.shells.is_empty());
            levels.push(Level {
                min: own.map(|own| own.min),
                max: own.map(|own| own.max),
                dimensions: level.dimensions,
                block_size: level.block_size,
                byte_length: entries.map(|entry| entry.prefix).max().unwrap_or(0),
                density: level.density.as_ref().map(|_| level.density_domain()),
            });
        }
        Ok(Self {
            uri: None,
            buffer_view: None,
            mime_type: MIME_TYPE.to_owned(),
            sha256: String::new(),
            min: metadata.outer_bounds().min,
            max: metadata.outer_bounds().max,
            dimensions: finest.dimensions,
            block_size: finest.block_size,
            levels,
            opacity: Opacity {
                order: metadata.activation.order,
                shift: metadata.activation.shift,
                interval: metadata.activation.interval,
                function: metadata.activation.function,
            },
            color_space: metadata.color_space,
            feature_count: metadata.features,
            mlp: metadata.view.as_ref().and_then(ViewMetadata::network).map(|view| Mlp {
                widths: view.widths.clone(),
                frequencies: view.frequencies,
                input: view.input,
            }),
            harmonics: metadata.view.as_ref().and_then(ViewMetadata::harmonics).copied(),
        })
    }

    /// The same with the digest of all bytes of the container.
    pub fn with_digest(container: &Container) -> Result<Self> {
        let sha256 = hex(&sha256(container.file())?);
        Ok(Self { sha256, ..Self::of_container(container)? })
    }
}
