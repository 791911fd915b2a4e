//! The two nouns and their geometry: the trained [`field::RadianceField`] and the quantized
//! [`baked::BakedField`].

pub mod activate;
pub mod anisotropy;
pub mod baked;
pub mod camera;
pub mod directional;
pub mod field;
pub mod generated;
pub mod grid;
pub mod harmonics;
pub mod ray_march;
pub mod snerg;
pub mod trained_model;
pub mod view_dependence;
pub mod view_mlp;
