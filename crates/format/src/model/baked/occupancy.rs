//! The indirection table: the stored blocks of a level and their frames.

use crate::base::error::{Error, Place, Result};
use crate::model::grid::BlockGrid;

/// The source of a block's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Occupancy {
    /// The level's empty values.
    Empty = 0,
    /// From the block's frame.
    Stored = 1,
    /// Density from the block's frame, colours from the next coarser level.
    Inherited = 2,
}

impl Occupancy {
    /// Its byte in a file.
    pub const fn id(self) -> u8 {
        self as u8
    }

    /// From its byte in a file.
    pub const fn from_id(id: u8) -> Option<Self> {
        match id {
            0 => Some(Self::Empty),
            1 => Some(Self::Stored),
            2 => Some(Self::Inherited),
            _ => None,
        }
    }
}

/// Each block's occupancy, and its frame in the atlases. Frames are numbered in the order of the
/// blocks, so occupancy alone determines the table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Table {
    grid: BlockGrid,
    occupancy: Vec<Occupancy>,
    /// Frame of the first block of each row of blocks along z.
    row_frames: Vec<u32>,
    frames: usize,
    inherited: usize,
}

impl Table {
    /// From each block's occupancy, z fastest.
    ///
    /// # Errors
    /// `Malformed` if their number differs from the grid's blocks.
    pub fn new(grid: BlockGrid, occupancy: Vec<Occupancy>) -> Result<Self> {
        if occupancy.len() != grid.total() {
            let found = format!("{} occupancies", occupancy.len());
            let expected = format!("one for each of {} blocks", grid.total());
            return Err(Error::malformed(Place::File, found, expected));
        }
        let mut row_frames = Vec::new();
        let mut frames = 0;
        for row in occupancy.chunks(grid.counts()[2]) {
            row_frames.push(frames as u32);
            frames += row.iter().filter(|&&block| block != Occupancy::Empty).count();
        }
        let inherited = occupancy.iter().filter(|&&block| block == Occupancy::Inherited).count();
        Ok(Self { grid, occupancy, row_frames, frames, inherited })
    }

    /// The level's cut into blocks.
    pub fn grid(&self) -> BlockGrid {
        self.grid
    }

    /// Each block's occupancy, z fastest.
    pub fn occupancy(&self) -> &[Occupancy] {
        &self.occupancy
    }

    /// Number of blocks with a frame: stored ones, and those with inherited colours.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Blocks whose colours are inherited.
    pub fn inherited(&self) -> usize {
        self.inherited
    }

    /// True if a block's colours are inherited, by its place along each axis.
    pub fn is_inherited(&self, [i, j, k]: [usize; 3]) -> bool {
        let [_, rows, length] = self.grid.counts();
        self.occupancy[(i * rows + j) * length + k] == Occupancy::Inherited
    }

    /// The same blocks, all with stored colours.
    pub fn without_inheritance(&self) -> Result<Self> {
        let stored = |&block: &Occupancy| match block {
            Occupancy::Inherited => Occupancy::Stored,
            block => block,
        };
        Self::new(self.grid, self.occupancy.iter().map(stored).collect())
    }

    /// Frame of a block by its place along each axis, if it has one.
    pub fn frame(&self, [i, j, k]: [usize; 3]) -> Option<usize> {
        let [_, rows, length] = self.grid.counts();
        let row = i * rows + j;
        let blocks = &self.occupancy[row * length..][..length];
        let before = blocks[..k].iter().filter(|&&block| block != Occupancy::Empty).count();
        (blocks[k] != Occupancy::Empty).then(|| self.row_frames[row] as usize + before)
    }

    /// Places of the blocks that have a frame, in the order of their frames.
    pub fn stored(&self) -> impl Iterator<Item = [usize; 3]> {
        let [_, rows, length] = self.grid.counts();
        let places = (0..self.occupancy.len())
            .map(move |block| [block / length / rows, block / length % rows, block % length]);
        let stored = places.zip(&self.occupancy);
        stored.filter(|&(_, &block)| block != Occupancy::Empty).map(|(place, _)| place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::grid::Nodes;

    #[test]
    fn frames_count_the_stored_blocks_in_order() {
        let grid = BlockGrid { nodes: Nodes([5, 4, 9]), edge: 4 };
        let occupancy = [1, 0, 2, 1, 0, 0].map(|id| Occupancy::from_id(id).expect("known"));
        let table = Table::new(grid, occupancy.to_vec()).expect("as many as blocks");
        assert_eq!((table.frames(), table.inherited()), (3, 1));
        assert!(table.is_inherited([0, 0, 2]) && !table.is_inherited([1, 0, 0]));
        let stored: Vec<_> = table.stored().collect();
        assert_eq!(stored, [[0, 0, 0], [0, 0, 2], [1, 0, 0]]);
        for (frame, place) in stored.into_iter().enumerate() {
            assert_eq!(table.frame(place), Some(frame));
        }
        assert_eq!(table.frame([1, 0, 2]), None);
        assert_eq!(Occupancy::from_id(7), None);
    }
}
