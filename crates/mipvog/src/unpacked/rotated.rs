//! Levels that are rotated as they are read.

use super::levels::{LevelValues, UnpackedLevel};
use super::rotation::Rotation;
use crate::base::error::Result;
use crate::model::baked::{Occupancy, Table};
use crate::model::grid::{BlockGrid, NodeMask, Nodes, row};

impl UnpackedLevel {
    /// The level, rotated about the origin. Its values are read in place, and coefficients of
    /// functions of the direction are converted.
    ///
    /// Blocks are cut anew: a block is stored if it holds a node of an old stored block. Blocks
    /// with nodes of an inherited block may inherit.
    ///
    /// # Errors
    ///
    /// None of its own.
    pub fn rotated(self, rotation: Rotation) -> Result<Self> {
        let BlockGrid { nodes, edge } = self.table.grid();
        let grid = BlockGrid { nodes: Nodes(rotation.lengths(nodes.0)), edge };
        let blocks = |of: &dyn Fn(Occupancy) -> bool| {
            rotated_mask(&nodes_of(&self.table, of), rotation)?.blocks(edge)
        };
        let stored = blocks(&|block| block != Occupancy::Empty)?;
        let inherited = blocks(&|block| block == Occupancy::Inherited)?;
        let occupancy = stored.into_iter().zip(inherited).map(|block| match block {
            (false, _) => Occupancy::Empty,
            (true, false) => Occupancy::Stored,
            (true, true) => Occupancy::Inherited,
        });
        let table = Table::new(grid, occupancy.collect())?;
        Ok(Self::new(table, LevelValues::Rotated(Box::new((self, rotation)))))
    }

    /// The nodes whose values count: those of stored blocks.
    ///
    /// # Errors
    ///
    /// None of its own.
    pub fn counted_nodes(&self) -> Result<NodeMask> {
        match &self.values {
            LevelValues::Rotated(rotated) => {
                let (level, rotation) = &**rotated;
                rotated_mask(&level.counted_nodes()?, *rotation)
            }
            _ => Ok(nodes_of(&self.table, &|block| block != Occupancy::Empty)),
        }
    }
}

/// Every node of the table's blocks for which `of` returns true.
fn nodes_of(table: &Table, of: &dyn Fn(Occupancy) -> bool) -> NodeMask {
    let BlockGrid { nodes, edge } = table.grid();
    let [nx, _, nz] = nodes.0;
    let [_, rows, length] = table.grid().counts();
    let words = row::words(nodes);
    let mut stored = NodeMask::empty(nodes);
    let mut planes = stored.planes_mut(0);
    for (block, _) in table.occupancy().iter().enumerate().filter(|&(_, &block)| of(block)) {
        let [i, j, k] = [block / length / rows, block / length % rows, block % length];
        for plane in &mut planes[i * edge..nx.min((i + 1) * edge)] {
            for row in plane.chunks_exact_mut(words).take((j + 1) * edge).skip(j * edge) {
                row::set_between(row, k * edge, nz.min((k + 1) * edge));
            }
        }
    }
    stored
}

fn rotated_mask(mask: &NodeMask, rotation: Rotation) -> Result<NodeMask> {
    let sizes = rotation.lengths(mask.nodes().0);
    let nodes = Nodes(sizes);
    NodeMask::of_planes(nodes, |x, plane| {
        for (y, row) in plane.chunks_exact_mut(row::words(nodes)).enumerate() {
            for z in (0..sizes[2]).filter(|&z| mask.contains(rotation.source(sizes, [x, y, z]))) {
                row::set(row, z);
            }
        }
        Ok(())
    })
}
