//! Fuzz targets of `mipvog-bake`; how to run them: `README.md`.

pub mod archive;
pub mod targets;
