//! Changes to what an unpacked container holds, before it is packed again: parts that become empty
//! (`crop`, `islands`), finest levels that go (`finest`), and another place (`place`).
//!
//! Values of stored nodes stay as they are, except that a rotation converts those that depend on
//! the view direction. Emptied blocks lose their frames, emptied nodes read as the level's empty
//! value.

mod blocks;
mod crop;
mod finest;
mod islands;
mod place;

pub use crop::crop;
pub use finest::{drop_finest, drop_from_metadata};
pub use islands::drop_islands;
pub use place::{Placement, place};
