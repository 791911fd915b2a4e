//! Grids of possibly occupied space.

use super::parameters::{LOW, SPAN};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::folder::{Folder, RGB, RGBA};
use crate::source::SideFile;
use crate::sparse::whole;

/// Voxels along an edge of a cell, coarsest grid first, in the viewer's order.
pub(super) const CELLS: [usize; 5] = [128, 64, 32, 16, 8];

fn name(cell: usize) -> String {
    format!("occupancy_grid_{cell}.png")
}

/// A grid of cells.
#[derive(Debug)]
struct Level {
    /// Cells along each axis.
    count: usize,
    /// Voxels along an edge of a cell.
    cell: usize,
    /// A bit for each cell, x fastest.
    bits: Vec<u64>,
}

impl Level {
    fn is_full(&self, [x, y, z]: [usize; 3]) -> bool {
        let at = (z * self.count + y) * self.count + x;
        x < self.count
            && y < self.count
            && self.bits.get(at / 64).is_some_and(|word| word >> (at % 64) & 1 == 1)
    }
}

/// The grids of a folder, the coarsest first.
#[derive(Debug)]
pub(super) struct Occupancy {
    levels: Vec<Level>,
    /// Edge of a voxel.
    voxel: f64,
}

/// Checks the pictures for a grid of `resolution` voxels.
pub(super) fn look(folder: &Folder, resolution: usize) -> Result<Vec<SideFile>> {
    let pictures = CELLS.into_iter().map(|cell| {
        let count = resolution.div_ceil(cell);
        folder.look("occupancy", name(cell), [count, count * count], &[RGB, RGBA])
    });
    pictures.collect()
}

impl Occupancy {
    /// Reads the pictures.
    pub(super) fn read(folder: &Folder, resolution: usize, limits: &Limits) -> Result<Self> {
        let read = |cell: usize| {
            let count = resolution.div_ceil(cell);
            let place = Place::Entry(name(cell));
            let total = limits::product(&[count as u64; 3], "cells", &place)?;
            limits::check(LimitName::Blocks, "cells", total as u64, limits.blocks, &place)?;
            let picture = folder.read(&name(cell), [count, count * count], limits)?;
            let mut bits = vec![0u64; total.div_ceil(64)];
            for (at, [code, ..]) in picture.bytes.as_chunks::<4>().0.iter().enumerate() {
                if let Some(word) = bits.get_mut(at / 64) {
                    *word |= u64::from(*code != 0) << (at % 64);
                }
            }
            Ok::<_, Error>(Level { count, cell, bits })
        };
        let levels = CELLS.into_iter().map(read).collect::<Result<_>>()?;
        Ok(Self { levels, voxel: SPAN / resolution as f64 })
    }

    /// The box of the coarsest empty cell around a position of contracted space, if any.
    pub(super) fn empty_cell(&self, position: [f64; 3]) -> Option<[[f64; 3]; 2]> {
        self.levels.iter().find_map(|level| {
            let edge = self.voxel * level.cell as f64;
            let cell = position.map(|at| whole((at - LOW) / edge));
            let low = cell.map(|at| LOW + at as f64 * edge);
            (!level.is_full(cell)).then(|| [low, low.map(|at| at + edge)])
        })
    }

    /// True if a voxel or one of its neighbours is in occupied cells of all grids.
    pub(super) fn is_near(&self, voxel: [usize; 3]) -> bool {
        let finest = self.levels.last().map_or(1, |level| level.cell);
        let [xs, ys, zs] = voxel.map(|at| [at.saturating_sub(1) / finest, (at + 1) / finest]);
        let full = |cell: [usize; 3]| {
            self.levels.iter().all(|level| level.is_full(cell.map(|at| at * finest / level.cell)))
        };
        let span = |[low, high]: [usize; 2]| low..=high;
        span(xs).any(|x| span(ys).any(|y| span(zs).any(|z| full([x, y, z]))))
    }
}
