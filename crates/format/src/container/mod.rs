//! Reads and writes version 1 of the `.mipvog` container, as specified in `formats/mipvog.md`.
//!
//! ```text
//! header (64 bytes), directory (64 bytes an entry), chunks, each at a multiple of 64
//!   META  metadata, canonical JSON          VMLP  the view network
//!   MASK  free-space mask, where it shows   prov  provenance, canonical JSON
//!   thmb  a small picture, PNG
//!   then for each level, coarse to fine:
//!   TABL  occupancy of blocks     DENS, DIFF, FEAT  atlases, cut into compressed runs of frames
//! ```
//!
//! [`layout`] has the records, [`runs`] the compressed runs of frames, and [`json`] canonical JSON.
//! `open` checks a file's structure, `read` decodes its levels, `prefix` reads a file truncated
//! after a level, and `write` assembles a file.
#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod generated;
mod held;
pub mod json;
pub mod layout;
mod mask;
mod metadata_rules;
mod network;
mod open;
mod prefix;
mod read;
mod rules;
mod runs;
mod table;
mod thumbnail;
mod write;

pub use layout::content_checksum;
pub use metadata_rules::{LARGEST_BLOCK, check_metadata, is_around};
pub use open::{Container, is_container, starts_container};
pub use prefix::Prefix;
pub use runs::{CompressedRun, EncodedAtlas, RUN_BYTES, frames_per_run};
pub use thumbnail::{LARGEST_THUMBNAIL, thumbnail_size};
pub use write::{EncodedLevel, Head, OtherChunk, content_checksum_of, with_thumbnail, write};
