//! A baked field: sparse levels of quantized blocks, and everything a renderer needs to decode
//! them.
//!
//! A level's grid is cut into cubes of nodes. Visible blocks are stored, in the order of their
//! numbers (z fastest), one *frame* each; the others read as the level's empty values. Blocks do
//! not share nodes: aprons are copies that a reader makes.

mod bends;
mod codes;
mod domain;
mod encoding;
mod field;
mod generated;
mod harmonics;
mod level_of_detail;
mod metadata;
mod occupancy;

pub use crate::model::generated::{Blend, ColorSpace, FootprintNeighbour, NumberType, StepRule};
pub use bends::{Bends, MOST_BENDS};
pub use codes::Codes;
pub(crate) use codes::with_codes;
pub use domain::{Decode, DensityDomain};
pub use encoding::{ColorLayout, GROUPS, Group};
pub use field::{BakedField, BakedLevel};
pub use generated::{
    Encoding, LevelMetadata, LevelOfDetail, Metadata, NetworkMetadata, ViewMetadata,
};
pub use harmonics::HarmonicsMetadata;
pub use occupancy::{Occupancy, Table};
