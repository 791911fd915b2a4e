//! Sets of cells.

use super::{NodeMask, Nodes, row};
use crate::base::error::Result;

/// A set of the cells of a grid. A cell is indexed by its lowest node, so no cell lies in the last
/// plane, row or column of nodes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CellMask {
    lowest: NodeMask,
}

impl CellMask {
    /// The empty set, of a grid of `nodes` nodes.
    pub fn empty(nodes: Nodes) -> Self {
        Self { lowest: NodeMask::empty(nodes) }
    }

    /// The cells with these lowest nodes.
    pub fn of_lowest_nodes(lowest: NodeMask) -> Self {
        Self { lowest }
    }

    /// The lowest nodes of the cells.
    pub fn lowest_nodes(&self) -> &NodeMask {
        &self.lowest
    }

    /// Adds a cell.
    pub fn insert(&mut self, cell: [usize; 3]) {
        self.lowest.insert(cell);
    }

    /// True if the cell is in the set.
    pub fn contains(&self, cell: [usize; 3]) -> bool {
        self.lowest.contains(cell)
    }

    /// Cells in the set.
    pub fn count(&self) -> u64 {
        self.lowest.count()
    }

    /// Keeps the cells that are in both sets.
    pub fn intersect(&mut self, other: &Self) {
        self.lowest.intersect(&other.lowest);
    }

    /// Adds the cells of the other set.
    pub fn unite(&mut self, other: &Self) {
        self.lowest.unite(&other.lowest);
    }

    /// The nodes that are a corner of a cell in the set.
    pub fn corners(&self) -> Result<NodeMask> {
        let (lowest, words) = (&self.lowest, self.lowest.row_words());
        NodeMask::of_planes(lowest.nodes(), |x, plane| {
            for (y, row) in plane.chunks_exact_mut(words).enumerate() {
                for i in x.saturating_sub(1)..=x {
                    for j in y.saturating_sub(1)..=y {
                        row::or_into(row, lowest.row(i, j));
                    }
                }
                row::or_shifted_up(row);
            }
            Ok(())
        })
    }
}

impl NodeMask {
    /// The cells that have a corner in this set.
    pub fn cells_with_a_corner(&self) -> Result<CellMask> {
        let ([nx, ny, nz], words) = (self.nodes().0, self.row_words());
        let lowest = NodeMask::of_planes(self.nodes(), |x, plane| {
            if x + 1 == nx {
                return Ok(());
            }
            for y in 0..ny - 1 {
                let row = &mut plane[y * words..][..words];
                for (i, j) in [(x, y), (x, y + 1), (x + 1, y), (x + 1, y + 1)] {
                    row::or_into(row, self.row(i, j));
                }
                row::or_shifted_down(row);
                row::clear_from(row, nz - 1);
            }
            Ok(())
        });
        lowest.map(CellMask::of_lowest_nodes)
    }
}
