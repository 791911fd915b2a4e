//! Python pickles of state dictionaries, read without running anything.
//!
//! A pickle is a program for a small stack machine that can name any function and call it. This
//! interpreter has the instructions of protocols 2 to 5 that plain values and objects are made of,
//! and a fixed list of names ([`global`]) whose calls it carries out itself: dictionaries and sets,
//! tensors over storages, NumPy arrays and numbers. Things of every other name stay closed: nothing
//! of them is run, and whoever needs one learns its name. Every other instruction is an error that
//! says which one, and where.
//!
//! Objects are nodes of an arena and refer to each other by number, so that a list that holds
//! itself is no danger while the pickle runs. The result is then copied out as a tree of
//! [`super::Value`]s, to a limited depth. The memory of the arena and the tree is spent from a
//! budget, so that a few bytes cannot be expanded without end.

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
