//! Coarser levels of a field, and the nodes of each level that can be seen.

pub mod mips;
pub mod prune;
