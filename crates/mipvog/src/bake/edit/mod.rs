//! Changes to what an unpacked container holds, before it is packed again: parts that become empty
//! (`crop`, `islands`), and finest levels that go (`finest`).
//!
//! Values of stored nodes stay as they are. Emptied blocks lose their frames, emptied nodes read as
//! the level's empty value.

mod blocks;
mod crop;
mod finest;
mod islands;

pub use crop::crop;
pub use finest::{drop_finest, drop_from_metadata};
pub use islands::drop_islands;
