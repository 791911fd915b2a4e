//! Flipbooks: all slices of a volume as tiles of one picture, with a text that describes them, for
//! the volume textures of engines.
//!
//! A `.png` has sRGB colours and the opacity over the length of a step, 8 bits each. An `.exr` has
//! linear light and density, half floats. `docs/verbs/export.md` describes the text.

mod description;
mod read;
mod write;

pub use write::Flipbook;
