//! The nodes of a tree. Each node is reached from the root exactly once.

use crate::base::error::{Error, Result};
use crate::base::limits::{self, Budget, Limits};
use crate::model::grid::Element;
use crate::tensor::Tensor;

/// Levels of a tree, at most: 2^16 cells per side.
const MAX_LEVELS: usize = 16;

/// A tree whose nodes have eight cells each, numbered `8 node + 4 i + 2 j + k`.
#[derive(Debug)]
pub(super) struct Tree {
    /// For each cell, the number of its child, or 0 for a leaf.
    children: Vec<u32>,
    /// Cells along a side of the deepest level are 2 to the power of this.
    levels: usize,
}

/// The leaf at a position.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leaf {
    pub(super) cell: usize,
    /// The position within it, 0 to 1.
    pub(super) at: [f64; 3],
    /// Its edge, in the tree's own unit.
    pub(super) size: f64,
}

impl Tree {
    /// Reads and checks the children of all nodes.
    ///
    /// # Errors
    /// `Unsupported` for nodes of more than eight cells, `Malformed` for invalid children and nodes
    /// with two parents, `OverLimit` for trees that are too deep.
    pub(super) fn load(tensor: &Tensor, limits: &Limits) -> Result<Self> {
        let place = tensor.place();
        let &[nodes, a, b, c] = tensor.shape() else {
            let found = format!("shape {:?}", tensor.shape());
            return Err(Error::malformed(place, found, "[nodes, 2, 2, 2]"));
        };
        if [a, b, c] != [2; 3] {
            let found = format!("nodes of {a} x {b} x {c} cells");
            return Err(Error::unsupported(place, found, "2 x 2 x 2"));
        }
        if tensor.element() != Element::I32 || nodes == 0 {
            let found = format!("{nodes} nodes of {}", tensor.element().name());
            return Err(Error::malformed(place, found, "int32, at least one node"));
        }
        limits::check_fixed("nodes", nodes, u64::from(u32::MAX) / 8 - 1, &place)?;
        let mut budget = Budget::new(limits);
        let storage = tensor.storage(&mut budget)?;
        let count = limits::product(&[nodes, 8], "cells", &place)?;
        let mut children: Vec<u32> = budget.zeroed(count, "bytes of a tree", &place)?;
        let mut bytes: Vec<u8> = budget.zeroed(4 * count, "bytes of a tree", &place)?;
        storage.read_into(0, &mut bytes)?;
        let nodes = count / 8;
        let stored = bytes.as_chunks::<4>().0.iter().map(|bytes| i32::from_le_bytes(*bytes));
        for (cell, (child, stored)) in children.iter_mut().zip(stored).enumerate() {
            if stored == 0 {
                continue;
            }
            let target = (cell as i64 / 8) + i64::from(stored);
            let target = u32::try_from(target).ok().filter(|&node| node > 0);
            let target = target.filter(|&node| (node as usize) < nodes);
            *child = target.ok_or_else(|| {
                let found = format!("child {stored} of cell {cell} in {nodes} nodes");
                Error::malformed(place.clone(), found, "a node below the root")
            })?;
        }
        let levels = levels(&children, nodes).map_err(|found| {
            let expected = format!("a tree of at most {MAX_LEVELS} levels");
            Error::malformed(place, found, expected)
        })?;
        Ok(Self { children, levels })
    }

    /// Cells along a side of the deepest level.
    pub(super) fn side(&self) -> usize {
        1 << self.levels
    }

    /// Cells of all nodes.
    pub(super) fn cells(&self) -> usize {
        self.children.len()
    }

    /// The leaf at a position of the tree, clamped to 0 to 1 along each axis.
    pub(super) fn leaf(&self, position: [f64; 3]) -> Leaf {
        let mut at = position.map(|value| value.clamp(0.0, 1.0 - 1e-10));
        let (mut node, mut size) = (0usize, 0.5);
        loop {
            let mut cell = 8 * node;
            for (value, weight) in at.iter_mut().zip([4, 2, 1]) {
                *value *= 2.0;
                if *value >= 1.0 {
                    *value -= 1.0;
                    cell += weight;
                }
            }
            match self.children.get(cell) {
                Some(&child) if child > 0 => node = child as usize,
                _ => return Leaf { cell, at, size },
            }
            size *= 0.5;
        }
    }

    /// The leaves of a plane of the deepest level's cells, as squares: cell, first y and z, and
    /// side.
    pub(super) fn plane(&self, x: usize, mut visit: impl FnMut(usize, [usize; 2], usize)) {
        let mut waiting = vec![(0usize, [0usize; 3], self.side())];
        while let Some((node, [x0, y0, z0], size)) = waiting.pop() {
            let half = size / 2;
            let i = usize::from(x - x0 >= half);
            for (j, k) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let cell = 8 * node + 4 * i + 2 * j + k;
                let corner = [x0 + i * half, y0 + j * half, z0 + k * half];
                match self.children.get(cell) {
                    Some(&child) if child > 0 => waiting.push((child as usize, corner, half)),
                    _ => visit(cell, [corner[1], corner[2]], half),
                }
            }
        }
    }

    /// True for cells without a child.
    pub(super) fn is_leaf(&self, cell: usize) -> bool {
        self.children.get(cell) == Some(&0)
    }

    /// Bytes in memory.
    pub(super) fn memory_bytes(&self) -> u64 {
        4 * self.children.len() as u64
    }
}

/// Levels from the root down; an error if a node is reached twice.
fn levels(children: &[u32], nodes: usize) -> std::result::Result<usize, String> {
    let mut met = vec![false; nodes];
    let (mut level, mut levels) = (vec![0u32], 0);
    while !level.is_empty() {
        levels += 1;
        if levels > MAX_LEVELS {
            return Err("more levels".to_owned());
        }
        let mut next = Vec::new();
        for node in level {
            let first = 8 * node as usize;
            for &child in children.get(first..first + 8).unwrap_or_default() {
                if child == 0 {
                    continue;
                }
                match met.get_mut(child as usize) {
                    Some(met) if !*met => *met = true,
                    _ => return Err(format!("node {child} twice as a child")),
                }
                next.push(child);
            }
        }
        level = next;
    }
    Ok(levels)
}
