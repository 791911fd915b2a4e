//! Changes to the content of an unpacked container before it is repacked: parts that become empty
//! (`crop`, `crop_world`, `islands`), dropped levels, finest (`finest`) or those of a world's
//! outermost boxes (`outermost`), and another place (`place`).
//!
//! Values of stored nodes stay as they are, except that a rotation converts those that depend on
//! the view direction. Emptied blocks lose their frames, emptied nodes read as the level's empty
//! value.

mod blocks;
mod crop;
mod crop_world;
mod finest;
mod islands;
mod outermost;
mod place;

pub use crop::crop;
pub use crop_world::crop_world;
pub use finest::{drop_finest, drop_from_metadata};
pub use islands::drop_islands;
pub use outermost::drop_outermost;
pub use place::{Placement, place};
