//! Reads and writes `.mipvog` containers of radiance fields, and samples them at points.
//!
//! This is the smallest crate of `mipvog-bake`. Game engines, viewers and converters need only this
//! crate; it does not bake. `formats/mipvog.md` specifies the format.
//!
//! ```no_run
//! use mipvog_format::{Container, Limits, Sampler};
//!
//! let container = Container::from_bytes(std::fs::read("scene.mipvog")?, &Limits::default())?;
//! println!("{} levels", container.metadata().levels.len());
//! let sampler = Sampler::of_container(&container)?;
//! let sample = sampler.sample([0.0, 0.0, 0.5], 0)?;
//! println!("opacity {}, colour {:?}", sample.opacity, sample.color);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Stability
//!
//! The names on this page are the interface. Modules are hidden: they serve the other crates of the
//! workspace, and may change in any release.

#[doc(hidden)]
pub mod base;
#[doc(hidden)]
pub mod container;
#[doc(hidden)]
pub mod model;
#[doc(hidden)]
pub mod quantize;
#[doc(hidden)]
pub mod sample;

pub use base::bytes::{ReadAt, SourceFile};
pub use base::error::{Error, ErrorKind, Place, Result};
pub use base::error_class::ErrorClass;
pub use base::limits::{LimitName, Limits};
pub use base::progress::{CancelToken, Progress, Step};
pub use container::layout::{ChunkKind, Entry, Header};
pub use container::{Container, OtherChunk, Prefix};
pub use model::baked::{
    BakedField, BakedLevel, Bends, Blend, Codes, ColorLayout, ColorSpace, Decode, DensityDomain,
    Encoding, FootprintNeighbour, Group, HarmonicsMetadata, LevelMetadata, LevelOfDetail, Metadata,
    NetworkMetadata, NumberType, Occupancy, StepRule, Table, ViewMetadata,
};
pub use model::grid::{BlockGrid, Bounds, BoxFrame, Nodes};
pub use model::harmonics::{Basis, Clamp, Evaluation, Harmonics};
pub use model::scene::{
    Activation, ActivationOrder, ColorDomain, DensityFunction, FreeSpace, Lookup, March,
};
pub use model::view_dependence::ViewDependence;
pub use model::view_mlp::{Layer, ViewInput, ViewMlp};
pub use sample::{Sample, Sampler, View};
