//! Radiance fields, cameras and ray marching.

pub mod camera;
pub mod field;
pub mod ray_march;
pub mod trained_model;

pub use mipvog_format::model::*;
