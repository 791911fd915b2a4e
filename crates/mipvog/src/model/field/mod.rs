//! A radiance field as trained: dense node-centred grids, a view-dependent network, and the rules
//! of ray marching. Grids stay in their file and are read by position.

mod builder;
mod grid;
mod merge;
mod planes;
mod radiance_field;
mod shell;
mod volume;

pub use builder::FieldBuilder;
pub use grid::{Grid, NodeValues};
pub use mipvog_format::model::scene::{
    Activation, ActivationOrder, ColorDomain, DensityFunction, EMPTY_LOGIT, FreeSpace,
    INVISIBLE_OPACITY, Lookup, March, Scene,
};
pub use planes::{Nonfinite, NonfiniteCount, PlaneRead, Planes, verify_crc32};
pub use radiance_field::RadianceField;
pub use shell::{Lattice, Shell};
pub use volume::Volume;
