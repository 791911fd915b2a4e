//! Input and output of bytes: slices with absolute offsets, positioned reads from files, atomic
//! outputs.

mod address;
mod digest;
#[cfg(feature = "network")]
mod fetch;
mod file;
mod guard;
mod linked;
mod output;
mod pause;
mod provisional;
mod read_at;
mod reader;
#[cfg(feature = "network")]
mod remote;
mod sink;
mod spill;
mod stale;
mod storage;
mod unfinished;

#[cfg(feature = "network")]
pub use address::address;
pub use address::shown;
pub use digest::{Digest, hex, sha256};
pub use file::SourceFile;
pub use guard::{Guard, is_guarded};
pub use linked::LinkedFolder;
pub use output::Output;
pub use provisional::Provisional;
pub use read_at::ReadAt;
pub use reader::ByteReader;
#[cfg(feature = "network")]
pub use remote::NetworkPermit;
pub use sink::{ByteSink, WriterSink};
pub use spill::Spill;
pub use stale::remove as remove_stale;
pub use storage::Storage;
pub use unfinished::{Unfinished, remove_all as remove_unfinished};
