//! What is trained, and how it is seen: radiance fields, cameras, the march of rays.

pub mod camera;
pub mod field;
pub mod ray_march;
pub mod trained_model;

pub use mipvog_format::model::*;
