//! Tools that every program has: errors, limits, progress, threads, bytes, findings, pictures,
//! colours, texts, parts of lists.

pub mod bytes;
pub mod error;
pub mod error_class;
pub mod file_kind;
pub mod finding;
mod limit_table;
pub mod limits;
pub mod lock;
pub mod parallel;
mod place;
pub mod progress;
pub mod shard;
pub mod srgb;
pub mod text;
