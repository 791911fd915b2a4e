//! Reads trained models. [`tensor`] parses file syntax, independent of names. Each other folder
//! reads one family of models, and [`families`] recognizes the family by content.
//!
//! A family makes a [`Source`]: a field of nodes for the bake and, if its own renderer follows
//! other rules, a model that renders the unbaked input by these rules.
//!
//! ```no_run
//! use mipvog::{BakeOptions, Baker};
//!
//! let source = mipvog_inputs::open("fine_last.tar")?;
//! Baker::new(BakeOptions::default()).to_file(&source, "scene.mipvog", false)?;
//! # Ok::<(), mipvog::Error>(())
//! ```

use mipvog::{base, container, model, picture, view};

#[doc(hidden)]
pub mod checkpoint;
#[doc(hidden)]
pub mod dvgo;
#[doc(hidden)]
pub mod factors;
mod families;
mod folder;
mod inspect;
mod lazy;
#[doc(hidden)]
pub mod merf;
#[doc(hidden)]
pub mod nerfacto;
mod nerfstudio;
#[doc(hidden)]
pub mod nested;
#[doc(hidden)]
pub mod network;
#[doc(hidden)]
pub mod ngp;
mod open;
mod options;
mod other_models;
#[doc(hidden)]
pub mod packets;
mod plain_yaml;
#[doc(hidden)]
pub mod plenoctree;
#[doc(hidden)]
pub mod plenoxels;
mod resample;
#[doc(hidden)]
pub mod sampled;
mod scale;
mod settings;
#[doc(hidden)]
pub mod snerg;
mod source;
mod source_use;
#[doc(hidden)]
pub mod sparse;
#[doc(hidden)]
pub mod svraster;
#[doc(hidden)]
pub mod tensor;
#[doc(hidden)]
pub mod tensorf;
#[doc(hidden)]
pub mod unpacked;
#[doc(hidden)]
pub mod vdb;

/// The crate of the bake, whose types appear in this crate's signatures.
pub use mipvog;

#[doc(hidden)]
pub use families::{Registered, registered};
#[doc(hidden)]
pub use families::{UNPACKED, family, open_tensors};
#[doc(hidden)]
pub use inspect::inspect_tensors;
pub use inspect::{Inspection, ListedValue, SceneContent, inspect};
#[doc(hidden)]
pub use open::file_of;
pub use open::{open, open_with};
pub use options::{AppearanceChoice, MlpChoice, SourceOptions, ViewChoice};
pub use settings::SceneSettings;
pub use source::{Assumption, Family, SideFile, Source};
pub use tensor::FileKind;
