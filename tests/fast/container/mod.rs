//! Containers: their parts, their limits, and damage to them.

mod damage;
mod limits;
mod metadata;
mod parts;
mod place;
mod prefix;
mod runs;
mod slices;
mod transcode;
