//! Node-centred grids: sizes, element types, and sets of nodes.
//!
//! Node `i` of `N` along an axis lies at `min + i * (max - min) / (N - 1)`: nodes 0 and `N - 1`
//! lie on the box's faces. Values are in C order, channel slowest and z fastest.

mod cells;
mod element;
mod mask;
mod nested;
pub mod row;
mod size;

pub use cells::CellMask;
pub use element::Element;
pub use mask::NodeMask;
pub use nested::BoxFrame;
pub use size::{BlockGrid, Bounds, Nodes};
