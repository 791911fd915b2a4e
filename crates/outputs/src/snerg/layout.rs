//! Places of blocks in the atlas.

use super::grid::VoxelGrid;
use crate::base::error::{Error, Result};
use mipvog_inputs::snerg::layout::EMPTY;

/// Maximum texels along a side of the atlas, the limit of graphics cards.
const LARGEST_SIDE: usize = 2048;
/// Pictures of coarser levels that Mip-VoG's viewer reads.
pub(super) const MIPS: usize = 3;
/// Planes of the atlas are a multiple of this if there are coarser pictures, because the coarsest
/// ones hold four planes each.
const MIP_DEPTH: usize = 32;

/// The atlas, in blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    /// Blocks along each axis.
    pub(super) blocks: [usize; 3],
    /// Texels along the edge of a block.
    pub(super) edge: usize,
}

impl Layout {
    /// For this many blocks, as cubic as possible.
    ///
    /// # Errors
    /// `InvalidOption` if they do not fit.
    pub(super) fn new(grid: &VoxelGrid, blocks: usize, mips: bool) -> Result<Self> {
        let edge = grid.edge();
        let most = (LARGEST_SIDE / edge).min(usize::from(EMPTY));
        let side = (1..=most).find(|side| side.pow(3) >= blocks).unwrap_or(most);
        let deep = blocks.div_ceil(side * side).max(1);
        let multiple = if mips { MIP_DEPTH.div_ceil(edge) } else { 1 };
        let deep = deep.next_multiple_of(multiple);
        if deep <= most {
            return Ok(Self { blocks: [side, side, deep], edge });
        }
        let longest = grid.counts.into_iter().max().unwrap_or(0);
        Err(Error::usage(format!(
            "{blocks} blocks of a grid of {longest} voxels do not fit in an atlas of {} blocks, \
             {LARGEST_SIDE} texels a side: pass a lower --resolution, or --crop",
            most.pow(3)
        )))
    }

    /// Texels along each axis.
    pub(super) fn texels(&self) -> [usize; 3] {
        self.blocks.map(|count| count * self.edge)
    }

    /// The place of stored block `number`.
    pub(super) fn place(&self, number: usize) -> [usize; 3] {
        let [x, y, _] = self.blocks;
        [number % x, number / x % y, number / (x * y)]
    }

    /// Blocks of a layer: of one place along z.
    pub(super) fn layer(&self) -> usize {
        self.blocks[0] * self.blocks[1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::grid::Bounds;

    #[test]
    fn an_atlas_is_cubic_and_refuses_what_it_cannot_hold() {
        let bounds = Bounds { min: [0.0; 3], max: [1.0; 3] };
        let grid = VoxelGrid::new(&bounds, &bounds, 64, 14);
        let layout = Layout::new(&grid, 100, false).expect("they fit");
        assert_eq!((layout.blocks, layout.texels()), ([5, 5, 4], [80, 80, 64]));
        assert_eq!(layout.place(57), [2, 1, 2]);
        assert_eq!(Layout::new(&grid, 60, true).expect("they fit").blocks, [4, 4, 4]);
        assert_eq!(Layout::new(&grid, 100, true).expect("they fit").blocks, [5, 5, 4]);
        assert_eq!(Layout::new(&grid, 0, false).expect("none").blocks, [1, 1, 1]);
        assert!(Layout::new(&grid, 128usize.pow(3) + 1, false).is_err());
    }
}
