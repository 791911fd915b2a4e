//! The whole bake, in its one order: visible, encodings, encode, write.
//!
//! 1. **Visible** ([`prepare`]): passes over density find the nodes of every level whose values
//!    must be exact, and the blocks to keep. With `min_weight`, nodes that given cameras do not see
//!    are dropped too.
//! 2. **Fit** ([`fit`]), if requested: coarser levels are fitted to pictures of level 0.
//! 3. **Encodings and encode** ([`pack`]): planes of all levels stream from a source ([`levels`])
//!    into sinks. If an error is requested instead of bits, one pass finds each level's value
//!    ranges ([`ranges`]) and the fewest bits for them. The next pass quantizes planes, cuts blocks
//!    and compresses runs of them as they come ([`encode`]). Last, blocks inherit the colours of
//!    the next coarser level if those are close enough to their own ([`inherit`]).
//! 4. **Write** ([`crate::container`]): metadata, then the levels, coarse to fine.
//!
//! [`run`] does all of it. [`forecast()`] does it for two windows of the field and without writing.
//! [`repack()`] starts at step 3, with the levels of an unpacked container as the source. [`plan`]
//! lays out tables and metadata.
//!
//! A memory bound ([`memory`]) decides where runs wait, and when slabs are encoded. Nothing depends
//! on the number of threads: runs are cut by frame numbers.

mod baker;
mod changes;
mod current;
mod edit;
mod encode;
pub mod fit;
mod forecast;
mod importance;
mod inherit;
mod level_source;
mod levels;
mod max_bytes;
mod max_error;
mod memory;
mod nested;
pub mod option_rules;
mod option_table;
mod options;
mod origin;
mod pack;
mod photographs;
mod plan;
mod prepare;
mod preset;
mod quality;
mod ranges;
mod repack;
mod report;
mod run;
mod run_store;
mod unpacked_levels;

pub use baker::{BakeInput, Baker};
pub use changes::Changes;
pub use current::is_current;
pub use edit::Placement;
pub use encode::{EncodeOptions, ErrorBound, Importance, LevelEncoder};
pub use forecast::{Forecast, forecast};
pub use max_bytes::Chosen;
pub use max_error::MaxErrors;
pub use option_table::{BAKE_OPTIONS, BakeOption};
pub use options::BakeOptions;
pub use origin::Origin;
pub use photographs::Photographs;
pub use preset::Preset;
pub use quality::Quality;
pub use repack::repack;
pub use report::{
    BakeReport, FitReport, GroupReport, IslandReport, LevelReport, PruneReport, StageReport,
    level_reports, shell_reports,
};
pub use run::bake;

pub use crate::levels::{Filter, LevelRule};
