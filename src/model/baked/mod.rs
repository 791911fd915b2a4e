//! A baked field: sparse levels of quantized blocks, and everything a renderer needs to decode
//! them.
//!
//! A level's grid is cut into cubes of nodes. Blocks that can be seen are stored, in the order of
//! their numbers (z fastest), one *frame* each; the others read as the level's empty values. The
//! nodes that a block shares with nobody are all it holds: aprons are copies that a reader makes.

mod encoding;
mod metadata;
mod occupancy;

pub use encoding::{Codes, Decode, Encoding, Group, NumberType};
pub use metadata::{
    Aside, Blend, ColorSpace, LevelMetadata, LevelOfDetail, Metadata, StepRule, ViewMetadata,
};
pub use occupancy::{Occupancy, Table};

use crate::model::field::FreeSpace;
use crate::model::view_mlp::ViewMlp;

/// A container's content, decoded to codes.
#[derive(Debug, Clone, PartialEq)]
pub struct BakedField {
    /// All that is not bulk.
    pub metadata: Metadata,
    /// View-dependent colour, if there is any.
    pub view_mlp: Option<ViewMlp>,
    /// The free-space mask, where dropping it would show.
    pub free_space: Option<FreeSpace>,
    /// Finest first.
    pub levels: Vec<BakedLevel>,
}

/// One level's codes.
#[derive(Debug, Clone, PartialEq)]
pub struct BakedLevel {
    /// Which blocks are stored.
    pub table: Table,
    /// Codes by [`Group`]; `None` where the level has no such values.
    pub atlases: [Option<Codes>; 3],
}
