//! Rows in memory, and values between nodes, for models that are rendered by their own rules.

use super::array::RowArray;
use super::index::{Index, LoadedIndex};
use crate::base::error::{Place, Result};
use crate::base::limits::Budget;
use crate::model::grid::Nodes;

/// Cells along an edge of a cube that is skipped if none of its nodes has a density above 0.
const CUBE: usize = 8;

/// A grid of rows in memory. Nodes without a row hold zeros.
#[derive(Debug)]
pub struct LoadedRows {
    index: LoadedIndex,
    /// Cubes along each axis, and for each, z fastest, true if a corner of its cells has a density
    /// above 0.
    cubes: [usize; 3],
    occupied: Vec<bool>,
    arrays: Vec<Vec<f32>>,
    /// The array, the width of its rows, and the column of densities; those of colours.
    density: [usize; 3],
    color: [usize; 3],
}

/// The rows around a position and their trilinear weights.
#[derive(Debug, Clone, Copy)]
pub struct Cell {
    rows: [Option<usize>; 8],
    weights: [f64; 8],
}

impl LoadedRows {
    /// Loads rows: density is column `density` of the first array, colours start at column `color`
    /// of the last one.
    ///
    /// # Errors
    /// Errors of reading, values that are not finite, more memory than the budget has.
    pub fn load(
        index: &Index,
        arrays: &[&RowArray],
        density: usize,
        color: usize,
        budget: &mut Budget,
    ) -> Result<Self> {
        let index = index.load(budget)?;
        let width = |array: Option<&&RowArray>| array.map_or(0, |array| array.width());
        let density = [0, width(arrays.first()), density];
        let color = [arrays.len().saturating_sub(1), width(arrays.last()), color];
        let loaded = arrays.iter().map(|array| {
            let values = array.values(budget)?;
            array.check_nodes(&values, index.nodes(), |node| index.row(node)).map(|()| values)
        });
        let loaded: Vec<Vec<f32>> = loaded.collect::<Result<_>>()?;
        let is_full = |node: [usize; 3]| {
            let [array, width, column] = density;
            let value = |row: usize| loaded.get(array)?.get(row * width + column);
            index.row(node).and_then(value).is_some_and(|density| *density > 0.0)
        };
        let cubes = index.nodes().0.map(|size| (size - 1).div_ceil(CUBE));
        let mut occupied = budget.zeroed(cubes.iter().product(), "cubes", &Place::File)?;
        let [nx, ny, nz] = index.nodes().0;
        for x in 0..nx {
            for y in 0..ny {
                for z in (0..nz).filter(|&z| is_full([x, y, z])) {
                    // A node on the border between cubes is a corner of cells on both sides.
                    let touched = |node: usize, count: usize| {
                        node.saturating_sub(1) / CUBE..(node / CUBE).min(count - 1) + 1
                    };
                    for i in touched(x, cubes[0]) {
                        for j in touched(y, cubes[1]) {
                            for k in touched(z, cubes[2]) {
                                let cube = (i * cubes[1] + j) * cubes[2] + k;
                                if let Some(occupied) = occupied.get_mut(cube) {
                                    *occupied = true;
                                }
                            }
                        }
                    }
                }
            }
        }
        Ok(Self { index, cubes, occupied, arrays: loaded, density, color })
    }

    /// Nodes along each axis.
    pub fn nodes(&self) -> Nodes {
        self.index.nodes()
    }

    /// Clamps a position, in nodes, to positions with nodes on all sides.
    pub fn clamped(&self, position: [f64; 3]) -> [f64; 3] {
        let mut clamped = position;
        let last = self.nodes().0.map(|count| (count - 1) as f64);
        clamped.iter_mut().zip(last).for_each(|(at, last)| *at = at.clamp(0.0, last));
        clamped
    }

    /// The cell around a position in nodes, 0 to `N - 1` along each axis.
    pub fn cell(&self, position: [f64; 3]) -> Cell {
        let Nodes([nx, ny, nz]) = self.nodes();
        let along = |at: f64, count: usize| {
            let low = whole(at).min(count - 2);
            (low, at - low as f64)
        };
        let [x, y, z] = position;
        let ((x, u), (y, v), (z, w)) = (along(x, nx), along(y, ny), along(z, nz));
        let (mut rows, mut weights) = ([None; 8], [0.0; 8]);
        for (corner, (row, weight)) in rows.iter_mut().zip(&mut weights).enumerate() {
            let [i, j, k] = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let share = |up: usize, share: f64| if up == 1 { share } else { 1.0 - share };
            *row = self.index.row([x + i, y + j, z + k]);
            *weight = share(i, u) * share(j, v) * share(k, w);
        }
        Cell { rows, weights }
    }

    /// True if no cell of the cube around a position has a density above 0.
    pub fn is_empty(&self, position: [f64; 3]) -> bool {
        let [i, j, k] = self.cube(position);
        let [_, by, bz] = self.cubes;
        !self.occupied.get((i * by + j) * bz + k).copied().unwrap_or(false)
    }

    /// The faces of the cube around a position: lowest and highest along each axis, in nodes. Faces
    /// on the grid's border are at infinity.
    pub fn cube_faces(&self, position: [f64; 3]) -> [[f64; 2]; 3] {
        let cube = self.cube(position);
        let axes = cube.into_iter().zip(self.cubes).map(|(at, count)| {
            let low = if at == 0 { f64::NEG_INFINITY } else { (at * CUBE) as f64 };
            let high = if at + 1 == count { f64::INFINITY } else { ((at + 1) * CUBE) as f64 };
            [low, high]
        });
        let mut faces = [[0.0; 2]; 3];
        faces.iter_mut().zip(axes).for_each(|(faces, own)| *faces = own);
        faces
    }

    fn cube(&self, position: [f64; 3]) -> [usize; 3] {
        let ([x, y, z], [i, j, k]) = (position, self.cubes);
        let along = |at: f64, count: usize| (whole(at) / CUBE).min(count - 1);
        [along(x, i), along(y, j), along(z, k)]
    }

    /// Density in a cell.
    pub fn density(&self, cell: &Cell) -> f64 {
        let [array, width, column] = self.density;
        let Some(values) = self.arrays.get(array) else { return 0.0 };
        let corners = cell.rows.iter().zip(cell.weights);
        let value = |row: usize| values.get(row * width + column).copied().unwrap_or(0.0);
        corners.map(|(row, weight)| row.map_or(0.0, |row| weight * f64::from(value(row)))).sum()
    }

    /// The columns of colours, from the first one on.
    pub fn coefficients(&self, cell: &Cell, out: &mut [f64]) {
        let [array, width, column] = self.color;
        out.fill(0.0);
        let Some(values) = self.arrays.get(array) else { return };
        for (row, weight) in cell.rows.iter().zip(cell.weights) {
            let Some(row) = row else { continue };
            let own = values.get(row * width + column..(row + 1) * width).unwrap_or_default();
            out.iter_mut().zip(own).for_each(|(out, own)| *out += weight * f64::from(*own));
        }
    }

    /// Sums, for red, green and blue, of `functions` coefficients times the value of each function.
    /// Rows hold `stored` coefficients of a colour one after the other.
    pub fn color(&self, cell: &Cell, functions: &[f64], stored: usize) -> [f64; 3] {
        let [array, width, column] = self.color;
        let mut sums = [0.0; 3];
        let Some(values) = self.arrays.get(array) else { return sums };
        for (row, weight) in cell.rows.iter().zip(cell.weights) {
            let Some(row) = row else { continue };
            let first = row * width + column;
            let coefficients = values.get(first..first + 3 * stored).unwrap_or_default();
            for (sum, coefficients) in sums.iter_mut().zip(coefficients.chunks_exact(stored)) {
                let terms = functions.iter().zip(coefficients);
                let color: f64 = terms.map(|(f, coefficient)| f * f64::from(*coefficient)).sum();
                *sum += weight * color;
            }
        }
        sums
    }
}

/// The integer part of a non-negative number; 0 for anything else.
pub fn whole(number: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
    let whole = number as usize;
    whole
}
