//! The views that see each cell of a coarse grid.
//!
//! ```text
//! depth(cell)     = mean optical depth per world unit of the nodes in the cell
//! hidden(cell, v) : the sum of depth over the way from the cell to the eye of v,
//!                   from START cells on, is above HIDDEN
//! ```
//!
//! The cells around the node itself do not count, because a surface does not hide itself.

use super::views::Views;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::model::field::{Nonfinite, Planes, RadianceField};
use crate::model::grid::{Nodes, row};

/// Cells along an axis, at most.
const CELLS: usize = 64;
/// Minimum nodes along an axis that are read, if there are as many.
const SAMPLED: usize = 128;
/// Nodes of a smaller opacity hide nothing.
const FAINT: f64 = 1e-4;
/// Distance in cells at which the way to the eye begins.
const START: f64 = 1.5;
/// Steps along the longest edge of a cell, at most: boxes may be as flat as paper.
const STEPS: f64 = 16.0;
/// Optical depth that leaves a tenth of the light.
const HIDDEN: f64 = std::f64::consts::LN_10;

/// Equal parts of a box, with the views that see each part.
#[derive(Debug)]
pub(super) struct CellVisibility {
    grid: CellGrid,
    /// Words of bits a cell, one bit for each view.
    words: usize,
    bits: Vec<u64>,
}

/// A field's box in cells.
#[derive(Debug)]
pub(super) struct CellGrid {
    nodes: [usize; 3],
    cells: [usize; 3],
    min: [f64; 3],
    /// Edges of a cell.
    edges: [f64; 3],
}

impl CellVisibility {
    /// From the density of a field within its free-space mask.
    ///
    /// # Errors
    /// Errors of reading density, and a request to stop.
    pub(super) fn find(
        geometry: &RadianceField,
        views: &Views,
        limits: &Limits,
        progress: &dyn Progress,
    ) -> Result<Self> {
        geometry.density.prepare(progress)?;
        let grid = CellGrid::new(geometry);
        let depths = grid.depths(geometry, limits)?;
        let words = views.count().div_ceil(64);
        let [nx, ny, nz] = grid.cells;
        let place = Place::Key("views".to_owned());
        let mut bits: Vec<u64> =
            Budget::new(limits).zeroed(nx * ny * nz * words, "bytes of views", &place)?;
        progress.begin(Step::Views, (nx * ny) as u64);
        let mut rows: Vec<&mut [u64]> = bits.chunks_mut((nz * words).max(1)).collect();
        parallel::map_mut(&mut rows, |row, bits| {
            for (z, bits) in bits.chunks_exact_mut(words).enumerate() {
                if progress.cancelled() {
                    return Err(Error::cancelled());
                }
                grid.note_views(&depths, [row / ny, row % ny, z], views, bits);
            }
            progress.advance(Step::Views, 1);
            Ok(())
        })?;
        drop(rows);
        Ok(Self { grid, words, bits })
    }

    /// Maximum bytes during its computation.
    pub(super) fn memory_bytes(views: &Views) -> u64 {
        (CELLS.pow(3) * (16 + 8 * views.count().div_ceil(64))) as u64
    }

    /// The cell of a node.
    pub(super) fn cell(&self, node: [usize; 3]) -> [usize; 3] {
        self.grid.cell(node)
    }

    /// The middle of a cell, in world units.
    pub(super) fn middle(&self, cell: [usize; 3]) -> [f64; 3] {
        self.grid.middle(cell)
    }

    /// The views that see a cell, in ascending order.
    pub(super) fn views(&self, [x, y, z]: [usize; 3]) -> Vec<usize> {
        let [_, ny, nz] = self.grid.cells;
        let first = ((x * ny + y) * nz + z) * self.words;
        let bits = self.bits.get(first..first + self.words).unwrap_or_default();
        let of_word = |(number, word): (usize, &u64)| {
            let word = *word;
            (0..64).filter(move |bit| word >> bit & 1 == 1).map(move |bit| 64 * number + bit)
        };
        bits.iter().enumerate().flat_map(of_word).collect()
    }
}

impl CellGrid {
    pub(super) fn new(field: &RadianceField) -> Self {
        let (bounds, Nodes(nodes)) = (&field.scene.bounds, field.scene.nodes);
        let cells = nodes.map(|count| count.min(CELLS));
        let mut edges = bounds.extent();
        edges.iter_mut().zip(cells).for_each(|(edge, count)| *edge /= count as f64);
        Self { nodes, cells, min: bounds.min.map(f64::from), edges }
    }

    /// The cell of a node.
    pub(super) fn cell(&self, node: [usize; 3]) -> [usize; 3] {
        let mut cell = node;
        let axes = cell.iter_mut().zip(self.nodes).zip(self.cells);
        axes.for_each(|((at, nodes), cells)| *at = *at * cells / nodes);
        cell
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        let [_, ny, nz] = self.cells;
        (x * ny + y) * nz + z
    }

    /// The middle of a cell, in world units.
    pub(super) fn middle(&self, cell: [usize; 3]) -> [f64; 3] {
        let mut middle = self.min;
        let axes = middle.iter_mut().zip(cell).zip(self.edges);
        axes.for_each(|((at, cell), edge)| *at += (cell as f64 + 0.5) * edge);
        middle
    }

    /// Mean optical depth per world unit of each cell, over a part of its nodes.
    fn depths(&self, geometry: &RadianceField, limits: &Limits) -> Result<Vec<f64>> {
        let ([nx, ny, nz], scene) = (self.nodes, &geometry.scene);
        let mut sums = vec![0.0; self.cells.iter().product()];
        let mut counts = vec![0.0; sums.len()];
        let place = Place::Key("density".to_owned());
        let mut plane: Vec<f32> =
            Budget::new(limits).zeroed(ny * nz, "bytes of a plane", &place)?;
        let planes = Planes::new(geometry, None, Nonfinite::Empty);
        let least = scene.activation.raw_at_opacity(FAINT);
        let depth_of_interval =
            f64::from(scene.activation.interval) / scene.march.interval_length();
        let [by_x, by_y, by_z] = self.nodes.map(|count| (count / SAMPLED).max(1));
        for x in (0..nx).step_by(by_x) {
            let region = self.region(geometry, x, [by_y, by_z]);
            planes.read(0, x, &region, &mut plane, false)?;
            for y in (0..ny).step_by(by_y) {
                for z in (0..nz).step_by(by_z) {
                    let cell = self.index(self.cell([x, y, z]));
                    let (Some(sum), Some(count)) = (sums.get_mut(cell), counts.get_mut(cell))
                    else {
                        continue;
                    };
                    *count += 1.0;
                    let bits = region.get(y * nz.div_ceil(64)..).unwrap_or_default();
                    let raw = plane.get(y * nz + z).filter(|_| row::get(bits, z));
                    if let Some(raw) = raw.map(|raw| f64::from(*raw)).filter(|raw| *raw > least) {
                        *sum += scene.activation.density(raw) * depth_of_interval;
                    }
                }
            }
        }
        sums.iter_mut()
            .zip(counts)
            .for_each(|(sum, count): (&mut f64, f64)| *sum /= count.max(1.0));
        Ok(sums)
    }

    /// Some nodes of a plane that are within the free-space mask.
    fn region(&self, geometry: &RadianceField, x: usize, [by_y, by_z]: [usize; 2]) -> Vec<u64> {
        let [_, ny, nz] = self.nodes;
        let spacing = geometry.scene.nodes.spacing(&geometry.scene.bounds);
        let mut bits = vec![0; ny * nz.div_ceil(64)];
        for (y, bits) in bits.chunks_exact_mut(nz.div_ceil(64)).enumerate().step_by(by_y) {
            for z in (0..nz).step_by(by_z) {
                let mut world = self.min;
                let axes = world.iter_mut().zip([x, y, z]).zip(spacing);
                axes.for_each(|((at, node), by)| *at += node as f64 * by);
                if geometry.free_space.as_ref().is_none_or(|mask| mask.contains(world)) {
                    row::set(bits, z);
                }
            }
        }
        bits
    }

    /// Sets the bits of the views that see a cell, for cells near occupied space.
    fn note_views(&self, depths: &[f64], cell: [usize; 3], views: &Views, bits: &mut [u64]) {
        if !self.is_near_matter(depths, cell) {
            return;
        }
        for view in 0..views.count() {
            let (direction, distance) = views.at(view, self.middle(cell));
            if !self.is_hidden(depths, cell, direction, distance)
                && let Some(word) = bits.get_mut(view / 64)
            {
                *word |= 1 << (view % 64);
            }
        }
    }

    fn is_near_matter(&self, depths: &[f64], cell: [usize; 3]) -> bool {
        let [xs, ys, zs] = {
            let mut ranges = [(); 3].map(|()| 0..0);
            for ((range, at), count) in ranges.iter_mut().zip(cell).zip(self.cells) {
                *range = at.saturating_sub(1)..(at + 2).min(count);
            }
            ranges
        };
        xs.into_iter().any(|x| {
            ys.clone().any(|y| {
                zs.clone().any(|z| depths.get(self.index([x, y, z])).is_some_and(|&d| d > 0.0))
            })
        })
    }

    /// True if little light of a cell reaches an eye that sees it along a direction.
    fn is_hidden(
        &self,
        depths: &[f64],
        cell: [usize; 3],
        direction: [f64; 3],
        distance: f64,
    ) -> bool {
        let shortest = self.edges.iter().copied().fold(f64::INFINITY, f64::min);
        let longest = self.edges.iter().copied().fold(0.0, f64::max);
        let step = shortest.max(longest / STEPS);
        let from = self.middle(cell);
        let (mut t, mut passed) = (START * longest, 0.0);
        while t < distance {
            let mut index = [0; 3];
            let axes = index.iter_mut().zip(from).zip(direction).zip(self.min).zip(self.edges);
            let mut inside = true;
            for (((((index, from), by), min), edge), count) in axes.zip(self.cells) {
                let at = (from - t * by - min) / edge;
                inside &= at >= 0.0 && at < count as f64;
                #[expect(clippy::cast_possible_truncation, reason = "a cell's number")]
                let cell = at.max(0.0) as usize;
                *index = cell;
            }
            if !inside {
                return false;
            }
            passed += depths.get(self.index(index)).copied().unwrap_or(0.0) * step;
            if passed > HIDDEN {
                return true;
            }
            t += step;
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::progress::Silent;

    /// A ball of radius 1 in a box of half size 1.5.
    fn ball(size: usize) -> RadianceField {
        let at = |index: usize| 3.0 * index as f64 / (size - 1) as f64 - 1.5;
        let raw = |node: usize| {
            let [x, y, z] = [node / (size * size), node / size % size, node % size].map(at);
            if x * x + y * y + z * z < 1.0 { 20.0 } else { -60.0 }
        };
        let count = size.pow(3);
        let builder =
            RadianceField::builder([size; 3], (0..count).map(raw).collect(), vec![0.0; 3 * count]);
        builder.bounds([-1.5; 3], [1.5; 3]).build().expect("a field")
    }

    #[test]
    fn a_ball_hides_its_far_side() {
        let limits = Limits::default();
        for size in [33, 97] {
            let field = ball(size);
            let far = |at: f64| [8.0 * libm::cos(at), 8.0 * libm::sin(at), 0.0];
            let cameras: Vec<[f64; 3]> = (0..32).map(|at| far(f64::from(at) * 0.2)).collect();
            for views in [Views::new(&[]), Views::new(&cameras)] {
                let seen =
                    CellVisibility::find(&field, &views, &limits, &Silent).expect("densities");
                // The node of the surface on the side of positive x.
                let node = [(size - 1) * 5 / 6, size / 2, size / 2];
                let found = seen.views(seen.cell(node));
                let along_x = |view: usize| views.at(view, [1.0, 0.0, 0.0]).0[0];
                assert!(!found.is_empty());
                for view in 0..views.count() {
                    let x = along_x(view);
                    if x.abs() > 0.3 {
                        assert_eq!(found.contains(&view), x < 0.0, "{size}: along {x}");
                    }
                }
                // Nothing sees the middle.
                assert_eq!(seen.views(seen.cell([size / 2; 3])), Vec::<usize>::new());
            }
        }
    }
}
