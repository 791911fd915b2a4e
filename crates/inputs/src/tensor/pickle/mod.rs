//! Python pickles of state dictionaries, read without running anything.
//!
//! A pickle is a program for a small stack machine that can name any function and call it. This
//! interpreter supports the instructions of protocols 2 to 5 for plain values and objects, and a
//! fixed list of names ([`global`]) whose calls it emulates: dictionaries and sets, tensors over
//! storages, NumPy arrays and numbers. Objects of other names are not built, and no code of them
//! runs; an error names an object if it is needed. Any other instruction is an error with its name
//! and place.
//!
//! Objects are nodes of an arena and refer to each other by number, so that a list that contains
//! itself is harmless. The result is copied to a tree of [`super::Value`]s of limited depth. A
//! budget bounds the memory of the arena and the tree, so that a few bytes cannot expand without
//! limit.

mod convert;
mod global;
mod machine;
mod node;
mod numpy;
mod read;
mod reduce;
mod storages;
mod whole;

pub(super) use read::read;
pub(super) use storages::Storages;
