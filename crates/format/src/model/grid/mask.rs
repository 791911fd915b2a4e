//! Sets of nodes, a bit each, and the set algebra of pruning.
//!
//! Bits lie in rows along z, 64 to a word; a row ends at a word's end and its unused bits stay
//! zero. [`super::CellMask`] is a set of cells.

use crate::base::error::Result;
use crate::base::parallel;
use crate::model::grid::{BlockGrid, Nodes, row};

/// A set of nodes of a grid.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeMask {
    nodes: Nodes,
    words: usize,
    bits: Vec<u64>,
}

impl NodeMask {
    /// The empty set.
    pub fn empty(nodes: Nodes) -> Self {
        let words = row::words(nodes);
        Self { nodes, words, bits: vec![0; nodes.0[0] * nodes.0[1] * words] }
    }

    /// Bytes of a set of nodes of this grid.
    pub fn bytes(nodes: Nodes) -> u64 {
        8 * (nodes.0[0] * nodes.0[1] * row::words(nodes)) as u64
    }

    /// Every node.
    pub fn full(nodes: Nodes) -> Self {
        let words = row::words(nodes);
        let mut bits = vec![u64::MAX; nodes.0[0] * nodes.0[1] * words];
        bits.chunks_exact_mut(words).for_each(|row| row::clear_from(row, nodes.0[2]));
        Self { nodes, words, bits }
    }

    /// The nodes that are not in the set.
    #[must_use]
    pub fn complement(&self) -> Self {
        let mut rest = Self::full(self.nodes);
        for (word, own) in rest.bits.iter_mut().zip(&self.bits) {
            *word &= !own;
        }
        rest
    }

    /// Adds a node.
    pub fn insert(&mut self, [x, y, z]: [usize; 3]) {
        let start = (x * self.nodes.0[1] + y) * self.words;
        row::set(&mut self.bits[start..start + self.words], z);
    }

    /// A set from `fill(x, rows)`, which fills the empty rows of plane `x`.
    pub fn of_planes(
        nodes: Nodes,
        fill: impl Fn(usize, &mut [u64]) -> Result<()> + Sync + Send,
    ) -> Result<Self> {
        let mut mask = Self::empty(nodes);
        parallel::map_mut(&mut mask.planes_mut(0), |x, rows| {
            // Pages that are read before they are written fault twice, and block all threads.
            rows.fill(0);
            fill(x, rows)
        })?;
        Ok(mask)
    }

    /// The rows of all x planes from `first` on, plane by plane.
    pub fn planes_mut(&mut self, first: usize) -> Vec<&mut [u64]> {
        let length = self.nodes.0[1] * self.words;
        self.bits[first * length..].chunks_exact_mut(length).collect()
    }

    /// The rows of one x plane.
    pub fn plane_mut(&mut self, x: usize) -> &mut [u64] {
        let length = self.nodes.0[1] * self.words;
        &mut self.bits[x * length..][..length]
    }

    /// The grid's size.
    pub fn nodes(&self) -> Nodes {
        self.nodes
    }

    /// Words of a row.
    pub fn row_words(&self) -> usize {
        self.words
    }

    /// The rows of one x plane, one after the other.
    pub fn plane(&self, x: usize) -> &[u64] {
        let length = self.nodes.0[1] * self.words;
        &self.bits[x * length..][..length]
    }

    /// The bits of the row `(x, y)`.
    pub fn row(&self, x: usize, y: usize) -> &[u64] {
        &self.bits[(x * self.nodes.0[1] + y) * self.words..][..self.words]
    }

    /// True if the node is in the set.
    pub fn contains(&self, [x, y, z]: [usize; 3]) -> bool {
        row::get(self.row(x, y), z)
    }

    /// Nodes in the set.
    pub fn count(&self) -> u64 {
        self.bits.iter().map(|word| u64::from(word.count_ones())).sum()
    }

    /// Nodes in both sets.
    pub fn count_common(&self, other: &Self) -> u64 {
        let both = self.bits.iter().zip(&other.bits).map(|(a, b)| (a & b).count_ones());
        both.map(u64::from).sum()
    }

    /// Keeps the nodes that are in both sets.
    pub fn intersect(&mut self, other: &Self) {
        row::and_into(&mut self.bits, &other.bits);
    }

    /// Adds the nodes of the other set.
    pub fn unite(&mut self, other: &Self) {
        row::or_into(&mut self.bits, &other.bits);
    }

    /// For each block, in the order of their numbers, true if it holds a node of the set.
    pub fn blocks(&self, edge: usize) -> Result<Vec<bool>> {
        let counts = BlockGrid { nodes: self.nodes, edge }.counts();
        let [nx, ny, nz] = self.nodes.0;
        let slabs = parallel::map(counts[0], |i| {
            let mut slab = vec![false; counts[1] * counts[2]];
            let mut merged = vec![0; self.words];
            for j in 0..counts[1] {
                merged.fill(0);
                for x in i * edge..nx.min((i + 1) * edge) {
                    for y in j * edge..ny.min((j + 1) * edge) {
                        row::or_into(&mut merged, self.row(x, y));
                    }
                }
                for (k, block) in slab[j * counts[2]..][..counts[2]].iter_mut().enumerate() {
                    *block = row::any_between(&merged, k * edge, nz.min((k + 1) * edge));
                }
            }
            Ok(slab)
        })?;
        Ok(slabs.concat())
    }

    /// Every node of the blocks that hold a node of the set.
    pub fn whole_blocks(&self, edge: usize) -> Result<Self> {
        let counts = BlockGrid { nodes: self.nodes, edge }.counts();
        let blocks = self.blocks(edge)?;
        let nz = self.nodes.0[2];
        self.per_plane(|x, plane| {
            for (y, row) in plane.chunks_exact_mut(self.words).enumerate() {
                let first = (x / edge * counts[1] + y / edge) * counts[2];
                let kept = (0..counts[2]).filter(|k| blocks[first + k]);
                kept.for_each(|k| row::set_between(row, k * edge, nz.min((k + 1) * edge)));
            }
        })
    }

    fn per_plane(&self, fill: impl Fn(usize, &mut [u64]) + Sync + Send) -> Result<Self> {
        Self::of_planes(self.nodes, |x, plane| {
            fill(x, plane);
            Ok(())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(nodes: Nodes, seed: u64) -> NodeMask {
        let mut mask = NodeMask::empty(nodes);
        let mut state = seed;
        for x in 0..nodes.0[0] {
            for y in 0..nodes.0[1] {
                for z in 0..nodes.0[2] {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    if state >> 59 == 0 {
                        let at = (x * nodes.0[1] + y) * mask.words;
                        row::set(&mut mask.bits[at..][..mask.words], z);
                    }
                }
            }
        }
        mask
    }

    /// All nodes within one step of `at` along each axis, below it if `down`, above it if `up`.
    fn around(nodes: Nodes, at: [usize; 3], down: usize, up: usize) -> Vec<[usize; 3]> {
        let range =
            |axis: usize| at[axis].saturating_sub(down)..(at[axis] + up + 1).min(nodes.0[axis]);
        let mut all = Vec::new();
        for x in range(0) {
            for y in range(1) {
                all.extend(range(2).map(|z| [x, y, z]));
            }
        }
        all
    }

    #[test]
    fn cells_and_corners_agree_with_their_definition() {
        for (seed, sizes) in
            [[2, 2, 2], [3, 5, 63], [4, 3, 64], [2, 7, 65], [5, 4, 130]].iter().enumerate()
        {
            let nodes = Nodes(*sizes);
            let visible = mask(nodes, seed as u64);
            let cells = visible.cells_with_a_corner().expect("no error");
            let retained = cells.corners().expect("no error");
            for at in around(nodes, [0; 3], 0, 1000) {
                let is_cell = (0..3).all(|axis| at[axis] + 1 < sizes[axis]);
                let cell = is_cell && around(nodes, at, 0, 1).iter().any(|&n| visible.contains(n));
                assert_eq!(cells.contains(at), cell, "{sizes:?} {at:?}");
                let near = around(nodes, at, 1, 1).iter().any(|&n| visible.contains(n));
                assert_eq!(retained.contains(at), near, "{sizes:?} {at:?}");
            }
        }
    }

    #[test]
    fn blocks_and_runs_agree_with_their_definition() {
        let nodes = Nodes([5, 9, 130]);
        let mask = mask(nodes, 3);
        let grid = BlockGrid { nodes, edge: 4 };
        let blocks = mask.blocks(4).expect("no error");
        let mut held = vec![false; grid.total()];
        let [_, by, bz] = grid.counts();
        for [x, y, z] in around(nodes, [0; 3], 0, 1000) {
            held[((x / 4) * by + y / 4) * bz + z / 4] |= mask.contains([x, y, z]);
        }
        assert_eq!(blocks, held);
        for x in 0..5 {
            for y in 0..9 {
                let mut rebuilt = vec![0; mask.row_words()];
                let (mut last, mut first) = (None, None);
                for (start, end) in row::runs(mask.row(x, y)) {
                    assert!(last.is_none_or(|last| last < start) && start < end);
                    row::set_between(&mut rebuilt, start, end);
                    first = first.or(Some(start));
                    last = Some(end);
                }
                assert_eq!(rebuilt, mask.row(x, y));
                assert_eq!(row::span(mask.row(x, y)), first.zip(last));
                let mut unset = vec![0; mask.row_words()];
                for (start, end) in row::gaps(mask.row(x, y), nodes.0[2]) {
                    assert!(start < end);
                    row::set_between(&mut unset, start, end);
                }
                assert_eq!(unset, mask.complement().row(x, y));
                let values: Vec<f32> =
                    (0..nodes.0[2]).map(|z| f32::from(row::get(mask.row(x, y), z))).collect();
                row::pack_above(&values, 0.5, &mut rebuilt);
                assert_eq!(rebuilt, mask.row(x, y));
                for start in [0, 1, 63, 64, nodes.0[2] - 1] {
                    let mut flags = vec![false; nodes.0[2].saturating_sub(start)];
                    row::unpack(mask.row(x, y), start, &mut flags);
                    for (z, flag) in (start..).zip(flags) {
                        assert_eq!(flag, row::get(mask.row(x, y), z), "{start} {z}");
                    }
                }
            }
        }
    }
}
