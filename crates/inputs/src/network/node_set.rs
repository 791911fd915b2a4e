//! Nodes of a grid, numbered plane by plane and row by row.

use super::planes::visit;
use crate::model::grid::{Nodes, row};

/// A set of nodes.
#[derive(Debug)]
pub(super) struct NodeSet {
    nodes: Nodes,
    /// A bit for each node of each plane, rows of bits along z.
    planes: Vec<Vec<u64>>,
    /// The number of the first node of each row, and one more.
    starts: Vec<u32>,
}

impl NodeSet {
    /// The nodes of these planes.
    pub(super) fn new(nodes: Nodes, planes: Vec<Vec<u64>>) -> Self {
        let mut starts = vec![0];
        let mut count = 0;
        for bits in planes.iter().flat_map(|plane| plane.chunks_exact(row::words(nodes))) {
            count += bits.iter().map(|word| word.count_ones()).sum::<u32>();
            starts.push(count);
        }
        Self { nodes, planes, starts }
    }

    /// The number of nodes.
    pub(super) fn count(&self) -> usize {
        self.starts.last().map_or(0, |&count| count as usize)
    }

    /// The number of the first node of plane `x`, or of all if there is none.
    pub(super) fn start(&self, x: usize) -> usize {
        let Nodes([_, ny, _]) = self.nodes;
        self.starts.get(x * ny).map_or(self.count(), |&start| start as usize)
    }

    /// The number of a node, if it is in the set.
    pub(super) fn number(&self, [x, y, z]: [usize; 3]) -> Option<usize> {
        let (Nodes([_, ny, nz]), words) = (self.nodes, row::words(self.nodes));
        if y >= ny || z >= nz {
            return None;
        }
        let bits = self.planes.get(x)?.get(y * words..(y + 1) * words)?;
        let (before, word) = (bits.get(..z / 64)?, *bits.get(z / 64)?);
        if word >> (z % 64) & 1 == 0 {
            return None;
        }
        let below = (word & !(u64::MAX << (z % 64))).count_ones();
        let before: u32 = before.iter().map(|word| word.count_ones()).sum();
        Some((*self.starts.get(x * ny + y)? + before + below) as usize)
    }

    /// The nodes of plane `x`.
    pub(super) fn plane(&self, x: usize) -> &[u64] {
        self.planes.get(x).map_or(&[], Vec::as_slice)
    }

    /// The cells between planes `x` and `x + 1` all of whose corners are in the set, as the bits of
    /// their lowest nodes.
    pub(super) fn cells(&self, x: usize) -> Vec<u64> {
        let words = row::words(self.nodes);
        let both = self.plane(x).iter().zip(self.plane(x + 1)).map(|(low, high)| low & high);
        let mut along_z: Vec<u64> = both.collect();
        for row in along_z.chunks_exact_mut(words) {
            let next = row.iter().skip(1).chain([&0]).map(|word| word << 63);
            let above: Vec<u64> =
                row.iter().zip(next).map(|(word, next)| word >> 1 | next).collect();
            row::and_into(row, &above);
        }
        let above = along_z.get(words..).unwrap_or_default().to_vec();
        let mut cells = along_z;
        let last = cells.len().saturating_sub(words);
        cells.iter_mut().zip(&above).for_each(|(word, above)| *word &= above);
        cells.iter_mut().skip(last).for_each(|word| *word = 0);
        cells
    }

    /// Visits the nodes of plane `x` in the order of their numbers.
    pub(super) fn visit(&self, x: usize, on_node: impl FnMut([usize; 2])) {
        visit(self.nodes, self.plane(x), on_node);
    }
}

/// The shares of a cell's corners in a point of it, by its place in edges of the cell. The bits of a
/// corner's number are its x, y and z, from the highest one.
pub(super) fn corner_shares(at: [f64; 3]) -> [f64; 8] {
    let mut shares = [1.0; 8];
    for (corner, share) in shares.iter_mut().enumerate() {
        for (axis, at) in at.into_iter().enumerate() {
            *share *= if corner >> (2 - axis) & 1 == 1 { at } else { 1.0 - at };
        }
    }
    shares
}

/// The corners of cells in either of their planes, both as rows of bits.
pub(super) fn corners(nodes: Nodes, cells: &[u64]) -> Vec<u64> {
    let words = row::words(nodes);
    let mut all = cells.to_vec();
    all.chunks_exact_mut(words).for_each(row::or_shifted_up);
    let below = all.clone();
    all.iter_mut().skip(words).zip(&below).for_each(|(word, below)| *word |= below);
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_numbered_in_order_and_cells_have_all_corners() {
        for counts in [[2, 2, 2], [3, 5, 70], [4, 3, 64], [2, 7, 129]] {
            let [nx, ny, nz] = counts;
            let (nodes, words) = (Nodes(counts), row::words(Nodes(counts)));
            let is_in = |x: usize, y: usize, z: usize| (x * 31 + y * 17 + z * 5) % 7 > 1;
            let plane = |x: usize| {
                let mut bits = vec![0; ny * words];
                for (y, row) in bits.chunks_exact_mut(words).enumerate() {
                    (0..nz).filter(|&z| is_in(x, y, z)).for_each(|z| row::set(row, z));
                }
                bits
            };
            let set = NodeSet::new(nodes, (0..nx).map(plane).collect());
            let mut next = 0;
            for x in 0..nx {
                assert_eq!(set.start(x), next);
                let cells = set.cells(x);
                for y in 0..ny {
                    for z in 0..nz {
                        let found = set.number([x, y, z]);
                        assert_eq!(found, is_in(x, y, z).then_some(next));
                        next += usize::from(found.is_some());
                        let all = (0..8).all(|corner| {
                            let [x, y, z] =
                                [x + (corner >> 2 & 1), y + (corner >> 1 & 1), z + (corner & 1)];
                            x < nx && y < ny && z < nz && is_in(x, y, z)
                        });
                        let bits = cells.get(y * words..).unwrap_or_default();
                        assert_eq!(!bits.is_empty() && row::get(bits, z), all, "{counts:?}");
                    }
                }
            }
            assert_eq!((set.count(), set.number([nx, 0, 0])), (next, None));
        }
    }
}
