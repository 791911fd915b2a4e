//! A radiance field as trained: dense node-centred grids, a view-dependent network, and how a ray
//! is marched through them. Grids stay in their file and are read by position.

mod builder;
mod free_space;
mod grid;
mod planes;
mod radiance_field;
mod scene;
mod volume;

pub use builder::FieldBuilder;
pub use free_space::{FreeSpace, Lookup};
pub use grid::{Grid, NodeValues};
pub use planes::{Nonfinite, NonfiniteCount, PlaneRead, Planes, verify_crc32};
pub use radiance_field::RadianceField;
pub use scene::{
    Activation, ActivationOrder, ColorDomain, DensityFunction, EMPTY_LOGIT, INVISIBLE_OPACITY,
    March, Scene,
};
pub use volume::Volume;
