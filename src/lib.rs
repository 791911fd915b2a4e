//! Bakes trained radiance fields into sparse, quantized assets that load from coarse to fine.
//!
//! A trained radiance field is a dense grid of logits: gigabytes, mostly empty, and aliased from
//! afar. A bake filters it into coarser levels, drops every block that no pixel can see, quantizes
//! values within proved errors, and writes one `.mipvog` container. Any prefix of a container that
//! ends at a level renders. The model is that of Mip-VoG
//! (Hu et al., ICCV 2023, arXiv 2304.10075), on grids as DirectVoxGO trains them.
//!
//! # Bake, read, sample, render
//!
//! A field comes from arrays ([`RadianceField::builder`]) or from a checkpoint ([`open()`]). A
//! [`Baker`] writes it to a vector, a writer or a file. A [`Container`] is read back by a
//! [`Renderer`], which gives values at points of the world and pictures.
//!
//! ```
//! use mipvog_bake::{BakeOptions, Baker, Camera, Container, Limits, RadianceField, Renderer};
//!
//! // An opaque red ball in a box of 16^3 nodes: raw density, and three logits of colour.
//! let place = |i: usize| [i / 256, i / 16 % 16, i % 16].map(|at| at as f32 / 7.5 - 1.0);
//! let inside = |at: [f32; 3]| at.iter().map(|x| x * x).sum::<f32>() < 0.5;
//! let density = (0..4096).map(|i| if inside(place(i)) { 10.0 } else { -10.0 }).collect();
//! let diffuse = [vec![4.0; 4096], vec![-4.0; 8192]].concat();
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
//! # Ok::<(), mipvog_bake::Error>(())
//! ```
//!
//! # Units and layout
//!
//! * Arrays are node-centred and in C order: channel slowest, then x, y, and z fastest.
//! * Positions are in world units, the axes of training. Level 0 is the finest.
//! * Density is optical depth per world unit. Opacity is over one *interval*, the length of a step.
//! * Colours are from 0 to 1 and display-referred, as in training.
//!
//! # Features
//!
//! * `cli` (default): the program, and the crates that only it needs.
//! * `parallel` (default): several threads. Results do not depend on it.
//!
//! # Stability
//!
//! The names on this page are the interface. Everything else is under [`unstable`].

#[doc(hidden)]
pub mod app;
#[doc(hidden)]
pub mod bake;
#[doc(hidden)]
pub mod base;
#[doc(hidden)]
pub mod codec;
#[doc(hidden)]
pub mod input;
#[doc(hidden)]
pub mod levels;
#[doc(hidden)]
pub mod model;
#[doc(hidden)]
pub mod output;
#[doc(hidden)]
pub mod view;

pub use bake::{BakeOptions, BakeReport, Baker, MaxErrors, Preset, Quality};
pub use base::error::{Error, ErrorKind, Place, Result};
pub use base::limits::Limits;
pub use base::progress::Progress;
pub use codec::container::Container;
pub use codec::quantize::Bits;
pub use input::{Source, open};
pub use levels::{Filter, FilterDomain, LevelFilter};
pub use model::camera::Camera;
pub use model::field::{FieldBuilder, RadianceField};
pub use view::render::{Frame, Renderer, Sample};

/// Everything inside, for benchmarks, tests and programs that need more than the front door.
///
/// Nothing here is stable: any release may rename, move or remove any of it.
pub mod unstable {
    #[doc(inline)]
    pub use crate::{app, bake, base, codec, input, levels, model, output, view};
}
