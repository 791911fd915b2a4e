//! Files of named tensors: PyTorch's zip files, safetensors, NumPy's npz, MessagePack;
//! the start of OpenVDB files; and texts
//! that describe a folder of pictures.
//!
//! This module knows syntax only; [`crate::checkpoint`] knows the meaning of names. A file's kind
//! is detected from its content. Opening reads directories, headers and the pickle, never a tensor:
//! each [`Tensor`] states the place of its bytes, checked against the file, and is read by position
//! on request. No code in a file can run: `pickle` interprets only the instructions that state
//! dictionaries use.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::cast_possible_truncation))]

mod array;
mod digest;
mod file;
mod kind;
mod load;
mod msgpack;
mod npz;
mod nvdb;
mod open;
mod parameters;
mod pickle;
mod ply;
mod positioned;
mod read;
mod safetensors;
mod storage;
mod syntaxes;
mod table;
mod torch;
mod unread;
mod value;
mod vdb;
mod zip;

pub use array::Tensor;
pub use file::{FileKind, TensorFile};
pub use kind::{describe, is_tensors};
pub use mipvog::unpacked::{Row, safetensors_digest, safetensors_header};
pub use open::{open, open_file};
pub use parameters::is_parameters;
pub use syntaxes::{expected, extensions};
pub use value::Value;
pub use vdb::{GRIDS, VdbValue, read_metadata, read_text};
pub use zip::{Archive, Data, Entry};
