//! A baked field: sparse levels of quantized blocks, and everything a renderer needs to decode
//! them.
//!
//! A level's grid is cut into cubes of nodes. Visible blocks are stored, in the order of their
//! numbers (z fastest), one *frame* each; the others read as the level's empty values. A block
//! holds only the nodes that no other block holds: aprons are copies that a reader makes.

mod codes;
mod domain;
mod encoding;
mod field;
mod level_of_detail;
mod metadata;
mod occupancy;

pub use codes::Codes;
pub(crate) use codes::with_codes;
pub use domain::{Decode, DensityDomain};
pub use encoding::{ColorLayout, Encoding, GROUPS, Group, NumberType};
pub use field::{BakedField, BakedLevel};
pub use level_of_detail::{Bends, FootprintNeighbour, LevelOfDetail, MOST_BENDS};
pub use metadata::{
    Blend, ColorSpace, HarmonicsMetadata, LevelMetadata, Metadata, NetworkMetadata, StepRule,
    ViewMetadata,
};
pub use occupancy::{Occupancy, Table};
