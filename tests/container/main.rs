//! Containers: their parts, their limits, and damage to them.

#[path = "../common/mod.rs"]
mod common;

mod damage;
mod limits;
mod metadata;
mod parts;
mod prefix;
mod runs;
mod slices;
mod transcode;
