//! Bakes trained radiance fields into sparse, quantized assets that load from coarse to fine.
//!
//! A trained radiance field is a dense grid of logits: gigabytes, mostly empty, and aliased at a
//! distance. A bake filters the grid into coarser levels, drops every block that no pixel can see,
//! quantizes values within proved error bounds, and writes one `.mipvog` container. Any prefix of a
//! container that ends after a level can be rendered. The model is that of Mip-VoG (Hu et al., ICCV
//! 2023, arXiv 2304.10075), on grids as DirectVoxGO trains them.
//!
//! # Bake, read, sample, render
//!
//! A field comes from arrays ([`RadianceField::builder`]), or from a checkpoint that the crate
//! `mipvog-inputs` reads. A [`Baker`] writes a field as a container: to a vector, a writer or a
//! file. A [`Renderer`] reads a [`Container`], samples it at points of the world and renders
//! pictures.
//!
//! ```
//! use mipvog::{BakeOptions, Baker, Camera, Container, Limits, RadianceField, Renderer};
//!
//! // An opaque red ball in a box of 16^3 nodes.
//! let place = |i: usize| [i / 256, i / 16 % 16, i % 16].map(|at| at as f32 / 7.5 - 1.0);
//! let inside = |at: [f32; 3]| at.iter().map(|x| x * x).sum::<f32>() < 0.5;
//! let density = (0..4096).map(|i| if inside(place(i)) { 10.0 } else { -10.0 }).collect();
//! let diffuse = [vec![4.0; 4096], vec![-4.0; 8192]].concat();
//! // 16^3 raw densities, and three times as many logits of colour
//! let field = RadianceField::builder([16; 3], density, diffuse).build()?;
//!
//! let bytes = Baker::new(BakeOptions::default()).to_vec(&field)?;
//! let container = Container::from_bytes(bytes, &Limits::default())?;
//! let renderer = Renderer::of_container(&container)?;
//!
//! let center = renderer.sample([0.0; 3], 0)?;
//! assert!(center.opacity > 0.9 && center.color[0] > 0.9);
//!
//! let camera = Camera::look_at([0.0, -4.0, 0.0], [0.0; 3], 40.0, [32, 32])?;
//! let picture = renderer.picture(&camera)?;
//! assert!(picture.color[16 * 32 + 16][1] < 0.1, "red in the middle");
//! assert!(picture.color[0][1] > 0.9, "white around it");
//! # Ok::<(), mipvog::Error>(())
//! ```
//!
//! # Units and layout
//!
//! * Arrays are node-centred and in C order: channel slowest, then x, y, and z fastest.
//! * Positions are in world units, the axes of training. Level 0 is the finest.
//! * Density is optical depth per world unit. Opacity refers to one *interval*, the step length.
//! * Colours are from 0 to 1 and display-referred, as in training.
//!
//! # Features
//!
//! * `parallel` (default): several threads. Results do not depend on it.
//! * `pictures`: picture files, such as photographs to fit coarser levels to.
//! * `network`: inputs from https addresses.
//! * `schemas`: JSON schemas for reports.
//!
//! # Stability
//!
//! The names on this page are the interface. Modules are hidden: they serve the other crates of the
//! workspace, and may change in any release.

#[doc(hidden)]
pub mod bake;
#[doc(hidden)]
pub mod levels;
#[doc(hidden)]
pub mod model;
#[doc(hidden)]
pub mod picture;
#[doc(hidden)]
pub mod unpacked;
#[doc(hidden)]
pub mod view;

#[doc(hidden)]
pub use mipvog_format::{base, container, quantize};

/// The crate of the container, whose types appear in this crate's signatures.
pub use mipvog_format;

pub use bake::fit::FittedLevel;
pub use bake::{
    BakeInput, BakeOptions, BakeReport, Baker, Chosen, FitReport, GroupReport, IslandReport,
    LevelReport, LevelRule, MaxErrors, Origin, Photographs, Preset, PruneReport, Quality,
    StageReport,
};
pub use base::bytes::Storage;
pub use levels::{Filter, FilterDomain, Kernel, LevelFilter, SharedFilter};
pub use mipvog_format::{
    CancelToken, Container, Error, ErrorClass, ErrorKind, LimitName, Limits, Place, Progress,
    Result, Sample, Step,
};
pub use model::camera::{Camera, Lens, Ray};
pub use model::field::{
    FieldBuilder, Grid, Lattice, NodeValues, Nonfinite, RadianceField, Scene, Shell, Volume,
};
pub use model::grid::Element;
pub use model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};
pub use quantize::Bits;
pub use view::render::{Frame, Renderer, Statistics, TrainedLevels};
