//! A container's content, decoded to codes.

use super::{Codes, Metadata, Table};
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
