//! Trained models. [`tensor`] reads file syntax and knows no names. Each other folder reads one
//! family of models, and [`families`] tells them apart by content.
//!
//! A family makes a [`Source`]: a field of nodes for the bake, and, where its own renderer follows
//! other rules, a model that shows the unbaked input by these.

pub mod checkpoint;
pub mod dvgo;
pub mod factors;
mod families;
mod folder;
mod inspect;
mod lazy;
pub mod merf;
pub mod network;
pub mod ngp;
mod open;
mod options;
mod other_models;
pub mod plenoctree;
pub mod plenoxels;
pub mod sampled;
mod scale;
mod settings;
pub mod snerg;
mod source;
pub mod sparse;
pub mod tensor;
pub mod tensorf;
pub mod vdb;

pub use families::{UNPACKED, family, open_tensors};
pub use inspect::{Inspection, ListedValue, SceneContent, inspect, inspect_tensors};
pub use open::{file_of, open, open_with};
pub use options::{MlpChoice, SourceOptions, ViewChoice};
pub use settings::SceneSettings;
pub use source::{Assumption, Family, SideFile, Source};
