//! The world and the unit cube of a model.

use crate::model::grid::Bounds;

/// A position `p` of the world maps to `p scale + offset`, with permuted axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    pub(super) scale: f64,
    /// Along the world's axes.
    pub(super) offset: [f64; 3],
}

impl Frame {
    /// The cube's axes in terms of the world's: y, z, x.
    pub(super) fn turned<T>([x, y, z]: [T; 3]) -> [T; 3] {
        [y, z, x]
    }

    /// A position of the world in the cube, which spans 0 to 1.
    pub(super) fn to_cube(self, world: [f64; 3]) -> [f64; 3] {
        let mut at = world;
        let axes = at.iter_mut().zip(self.offset);
        axes.for_each(|(at, offset)| *at = *at * self.scale + offset);
        Self::turned(at)
    }

    /// The cube as a box of the world.
    #[expect(clippy::cast_possible_truncation, reason = "a field's box is float32")]
    pub(super) fn bounds(self) -> Bounds {
        let corner = |at: f64| self.offset.map(|offset| ((at - offset) / self.scale) as f32);
        Bounds { min: corner(0.0), max: corner(1.0) }
    }
}
