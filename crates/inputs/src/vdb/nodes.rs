//! Values at the nodes of a field, from the leaves and tiles of a grid.

use std::collections::HashMap;

use super::grid::VdbGrid;
use super::placed::Placed;
use super::tree::{LEAF_VOXELS, is_on};
use crate::base::error::{Place, Result};
use crate::base::limits::{self, Budget, LimitName, Limits};
use crate::base::progress::Progress;
use crate::base::srgb::display;
use crate::model::field::NodeValues;
use crate::model::grid::{Nodes, row};

/// Voxels along a leaf's edge.
const SIDE: i32 = 8;
/// Empty nodes beyond the outermost voxels.
const BORDER: i32 = 1;

/// The box of active voxels, as numbers along the axes of the world, and nodes around it.
#[derive(Debug, Clone, Copy)]
pub(super) struct NodeBox {
    /// Numbers of node 0.
    pub low: [i32; 3],
    /// Nodes along each axis.
    pub nodes: Nodes,
}

impl NodeBox {
    /// Around the active voxels of a grid; none if there are none.
    ///
    /// # Errors
    /// More nodes than the limits allow.
    pub fn of(grid: &VdbGrid, limits: &Limits, place: &Place) -> Result<Option<Self>> {
        let mut corners: Option<[[i32; 3]; 2]> = None;
        let mut meet = |voxel: [i32; 3]| {
            let at = grid.placed.turned(voxel);
            let [low, high] = corners.get_or_insert([at, at]);
            for ((low, high), at) in low.iter_mut().zip(high).zip(at) {
                (*low, *high) = ((*low).min(at), (*high).max(at));
            }
        };
        for tile in &grid.tree.tiles {
            let last = i32::try_from(tile.side).unwrap_or(i32::MAX) - 1;
            meet(tile.origin);
            meet(tile.origin.map(|at| at.saturating_add(last)));
        }
        for leaf in &grid.tree.leaves {
            for voxel in (0..LEAF_VOXELS).filter(|&voxel| is_on(&leaf.active, voxel)) {
                meet(voxel_at(leaf.origin, voxel));
            }
        }
        let Some([low, high]) = corners else { return Ok(None) };
        let mut counts = [0; 3];
        for ((count, low), high) in counts.iter_mut().zip(low).zip(high) {
            let nodes = i64::from(high) - i64::from(low) + 1 + 2 * i64::from(BORDER);
            *count = nodes.cast_unsigned();
        }
        let nodes = Nodes::checked(counts, limits, place)?;
        Ok(Some(Self { low: low.map(|low| low.saturating_sub(BORDER)), nodes }))
    }
}

fn voxel_at([x, y, z]: [i32; 3], voxel: usize) -> [i32; 3] {
    let along = |shift: usize| i32::try_from(voxel >> shift & 7).unwrap_or(0);
    [x.wrapping_add(along(6)), y.wrapping_add(along(3)), z.wrapping_add(along(0))]
}

/// The stored content at the place of a leaf.
#[derive(Debug, Clone, Copy)]
enum Stored {
    Leaf(usize),
    Tile(usize),
}

/// The values of a grid at the nodes of a box.
#[derive(Debug)]
pub(super) struct GridValues {
    grid: VdbGrid,
    nodes: NodeBox,
    /// By the first voxel of a leaf, divided by 8.
    places: HashMap<[i32; 3], Stored>,
    /// Converts values from linear light to sRGB.
    is_color: bool,
}

impl GridValues {
    /// Of a grid.
    ///
    /// # Errors
    /// More blocks than the limits allow, because a tile represents many.
    pub fn new(
        grid: VdbGrid,
        nodes: NodeBox,
        is_color: bool,
        limits: &Limits,
        budget: &mut Budget,
    ) -> Result<Self> {
        let mut places = HashMap::new();
        let leaves = |side: u32| u64::from(side / 8).pow(3);
        let tiles: u64 = grid.tree.tiles.iter().map(|tile| leaves(tile.side)).sum();
        let blocks = tiles.saturating_add(grid.tree.leaves.len() as u64);
        limits::check(LimitName::Blocks, "blocks of a grid", blocks, limits.blocks, &Place::File)?;
        budget.spend(blocks * 48, "bytes of a grid's table", &Place::File)?;
        for (number, tile) in grid.tree.tiles.iter().enumerate() {
            let count = i32::try_from(tile.side / 8).unwrap_or(0);
            let [x, y, z] = tile.origin.map(|at| at.div_euclid(SIDE));
            for dx in 0..count {
                for dy in 0..count {
                    for dz in 0..count {
                        let at = [x + dx, y + dy, z + dz];
                        places.insert(at, Stored::Tile(number));
                    }
                }
            }
        }
        for (number, leaf) in grid.tree.leaves.iter().enumerate() {
            places.insert(leaf.origin.map(|at| at.div_euclid(SIDE)), Stored::Leaf(number));
        }
        Ok(Self { grid, nodes, places, is_color })
    }

    /// The value of a channel at a voxel.
    fn value(&self, channel: usize, voxel: [i32; 3]) -> f32 {
        let channel = if self.grid.width == 1 { 0 } else { channel };
        let value = match self.places.get(&voxel.map(|at| at.div_euclid(SIDE))) {
            None => self.grid.background.get(channel).copied(),
            Some(Stored::Tile(number)) => {
                let tile = self.grid.tree.tiles.get(*number);
                tile.and_then(|tile| tile.value.get(channel)).copied()
            }
            Some(Stored::Leaf(number)) => {
                let [x, y, z] = voxel.map(|at| at.rem_euclid(SIDE).unsigned_abs() as usize);
                let at = ((x * 8 + y) * 8 + z) * self.grid.width + channel;
                let leaf = self.grid.tree.leaves.get(*number);
                leaf.and_then(|leaf| leaf.values.get(at)).copied()
            }
        };
        let value = value.unwrap_or(0.0);
        #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
        if self.is_color { display(value.into()) as f32 } else { value }
    }
}

impl NodeValues for GridValues {
    fn nodes(&self) -> Nodes {
        self.nodes.nodes
    }

    fn channels(&self) -> usize {
        if self.is_color { 3 } else { 1 }
    }

    fn memory_bytes(&self) -> u64 {
        let values = (self.grid.tree.leaves.len() * LEAF_VOXELS * self.grid.width * 4) as u64;
        values + self.places.len() as u64 * 48
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        // The file's digest is that of all its bytes.
        hash(&[]);
        Ok(())
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        Ok(())
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let Nodes([_, _, nz]) = self.nodes();
        let [low_x, low_y, low_z] = self.nodes.low;
        let Placed { axis, step, .. } = self.grid.placed;
        let offset = |at: usize| i32::try_from(at).unwrap_or(i32::MAX);
        let at_x = low_x.saturating_add(offset(x));
        let rows = region.chunks_exact(nz.div_ceil(64)).zip(out.chunks_exact_mut(nz));
        for (y, (row, out)) in rows.enumerate() {
            let at_y = low_y.saturating_add(offset(y));
            for (start, end) in row::runs(row) {
                let places = out.get_mut(start..end).unwrap_or_default();
                for (z, out) in (start..).zip(places) {
                    let at = [at_x, at_y, low_z.saturating_add(offset(z))];
                    let mut voxel = [0; 3];
                    for ((at, axis), step) in at.into_iter().zip(axis).zip(step) {
                        if let Some(voxel) = voxel.get_mut(axis) {
                            *voxel = if step < 0.0 { at.wrapping_neg() } else { at };
                        }
                    }
                    *out = self.value(channel, voxel);
                }
            }
        }
        Ok(0)
    }
}

/// White light everywhere, for volumes without colours.
#[derive(Debug)]
pub(super) struct White(pub NodeBox);

impl NodeValues for White {
    fn nodes(&self) -> Nodes {
        self.0.nodes
    }

    fn channels(&self) -> usize {
        3
    }

    fn memory_bytes(&self) -> u64 {
        0
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        hash(&[]);
        Ok(())
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        Ok(())
    }

    fn read(&self, _: usize, _: usize, _: &[u64], out: &mut [f32]) -> Result<u64> {
        out.fill(1.0);
        Ok(0)
    }
}
