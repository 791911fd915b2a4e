//! Chunk types, required features, and ranges of the metadata's values.
//!
//! Written by `cargo xtask generate` from `formats/container.toml`.

use super::held::Rules;
use crate::base::error::Result;
use crate::model::baked::{GROUPS, Metadata, ViewMetadata};

/// Version of the format: readers refuse another major one, and ignore a higher minor one.
pub const VERSION: [u16; 2] = [1, 3];
/// Required feature, since 1.1: some blocks inherit their colours from the next coarser level.
pub const INHERITED_BLOCKS: u64 = 1;
/// Required feature, since 1.2: colours are linear or coefficients of harmonics, density is not
/// softplus, or samples have their own box or voxel.
pub const LINEAR_VALUES: u64 = 2;
/// Required feature, since 1.2: the rule that picks levels has bends.
pub const BENT_RULE: u64 = 4;
/// Required feature, since 1.2: levels have directional brightness.
pub const DIRECTIONAL: u64 = 8;
/// Required feature, since 1.2: levels have anisotropy.
pub const ANISOTROPY: u64 = 16;
/// Required feature, since 1.3: coarser levels span larger boxes than level 0.
pub const NESTED_BOXES: u64 = 32;
/// Features that a reader must know.
pub const KNOWN_FEATURES: u64 = 63;
/// The same for messages.
pub const KNOWN_FEATURE_BITS: &str = "bits 0 (inherited blocks), 1 (linear values), 2 (bent rule), 3 (directional brightness), 4 (anisotropy), 5 (nested boxes)";
/// The minor version that added each feature.
pub const FEATURES_SINCE: [u16; 6] = [1, 2, 2, 2, 2, 3];
/// Type of a chunk. The first letter is lower case in ancillary chunks, which readers may skip.
pub type ChunkKind = [u8; 4];
/// Metadata, canonical JSON.
pub const META: ChunkKind = *b"META";
/// Layers of the view network.
pub const VMLP: ChunkKind = *b"VMLP";
/// The free-space mask.
pub const MASK: ChunkKind = *b"MASK";
/// Provenance, canonical JSON; ancillary.
pub const PROVENANCE: ChunkKind = *b"prov";
/// A small picture of the scene, PNG; ancillary.
pub const THUMBNAIL: ChunkKind = *b"thmb";
/// Occupancy of a level's blocks.
pub const TABLE: ChunkKind = *b"TABL";
/// Every chunk type but those of atlases.
pub const CHUNKS: [ChunkKind; 6] = [META, VMLP, MASK, PROVENANCE, THUMBNAIL, TABLE];
/// Atlases of a level, in the order of [`crate::model::baked::Group::ALL`].
pub const ATLASES: [ChunkKind; GROUPS] =
    [*b"DENS", *b"DIFF", *b"FEAT", *b"BNDA", *b"BNDB", *b"BNDC", *b"DIRB", *b"ANIS"];

/// Holds values to their ranges.
///
/// # Errors
/// The first of a strict reader.
pub(super) fn ranges(metadata: &Metadata, rules: &mut Rules) -> Result<()> {
    rules.require(
        metadata.activation.shift.is_finite(),
        "activation.shift",
        metadata.activation.shift,
        "a finite number",
    )?;
    rules.require(
        metadata.activation.interval > 0.0 && metadata.activation.interval.is_finite(),
        "activation.interval",
        metadata.activation.interval,
        "a positive number",
    )?;
    rules.require(
        metadata.march.stepsize > 0.0 && metadata.march.stepsize.is_finite(),
        "march.stepsize",
        metadata.march.stepsize,
        "a positive number",
    )?;
    rules.require(
        metadata.march.voxel_size > 0.0 && metadata.march.voxel_size.is_finite(),
        "march.voxel_size",
        metadata.march.voxel_size,
        "a positive number",
    )?;
    rules.require(
        metadata.march.voxel.iter().flatten().all(|&value| value > 0.0 && value.is_finite()),
        "march.voxel",
        format!("{:?}", metadata.march.voxel),
        "each a positive number",
    )?;
    rules.require(
        metadata.march.near >= 0.0 && metadata.march.near.is_finite(),
        "march.near",
        metadata.march.near,
        "a number from 0",
    )?;
    rules.require(
        metadata.march.far.is_none_or(|value| value.is_finite()),
        "march.far",
        metadata.march.far.unwrap_or_default(),
        "a finite number, or null",
    )?;
    rules.require(
        (0.0..1.0).contains(&metadata.march.color_threshold),
        "march.color_threshold",
        metadata.march.color_threshold,
        "0 to below 1",
    )?;
    rules.require(
        (0.0..1.0).contains(&metadata.march.alpha_threshold),
        "march.alpha_threshold",
        metadata.march.alpha_threshold,
        "0 to below 1",
    )?;
    rules.require(
        metadata.background.iter().all(|&value| value.is_finite()),
        "background",
        format!("{:?}", metadata.background),
        "each a finite number",
    )?;
    if let Some(ViewMetadata::Network(view)) = &metadata.view {
        rules.require(
            (2..=32).contains(&view.widths.len()),
            "view.widths",
            view.widths.len(),
            "2 to 32 of them",
        )?;
        rules.require(
            view.widths.iter().all(|&value| (1..=4096).contains(&value)),
            "view.widths",
            format!("{:?}", view.widths),
            "each 1 to 4096",
        )?;
        rules.require(
            (0..=32).contains(&view.frequencies),
            "view.frequencies",
            view.frequencies,
            "0 to 32",
        )?;
    }
    rules.require(
        (0.0..1.0).contains(&metadata.alpha_threshold),
        "alpha_threshold",
        metadata.alpha_threshold,
        "0 to below 1",
    )?;
    rules.require(
        (1..=32).contains(&metadata.levels.len()),
        "levels",
        metadata.levels.len(),
        "1 to 32 of them",
    )?;
    rules.require(
        (0..=31).contains(&metadata.shells.len()),
        "shells",
        metadata.shells.len(),
        "1 to 31 of them",
    )?;
    Ok(())
}
