//! Anisotropy of coarser levels, from the gradient of alpha around a node.
//!
//! ```text
//! a_m = v * (sum of |g|^2 Y_2m(g / |g|)) / (sum of |g|^2 + 0.01)
//! ```
//!
//! with the gradient `g` of alpha in the middle of each of the eight cells around the node, a
//! difference over the mean distance of nodes; the stored density `v`; and the functions `Y_2m` of
//! [`crate::model::anisotropy`]. The sum of the products of a gradient's parts is the structure
//! tensor, which tells a wall from a rod and from fog: alpha changes across a wall, not along it.
//! So a wall absorbs more across than along it. Where alpha hardly changes, anisotropy is 0.

use multiversion::multiversion;

use crate::model::anisotropy::{ANISOTROPY, of_tensor};

/// Added to the sum of squared gradients. Fog has small gradients, and absorbs alike in all
/// directions.
const FLAT: f32 = 0.01;
/// Products of a gradient's parts: xx, yy, zz, xy, xz, yz.
const PRODUCTS: usize = 6;

/// The alpha of the rows around a row of nodes: planes below and above, and rows of each.
pub(super) type RowsAround<'a> = [[Option<&'a [f32]>; 3]; 3];

/// Structure tensors along one row.
#[derive(Debug)]
pub(super) struct StructureTensor {
    /// Mean node distance divided by the node distance along each axis.
    scale: [f32; 3],
    /// Products, summed over the cells of a span between a node of the row and the next one.
    cells: [Vec<f32>; PRODUCTS],
}

impl StructureTensor {
    /// For rows of `nz` nodes, at least 2.
    pub fn new(scale: [f32; 3], nz: usize) -> Self {
        Self { scale, cells: [(); PRODUCTS].map(|()| vec![0.0; nz + 1]) }
    }

    /// The anisotropy of the nodes `start..end` of the middle row, whose stored densities are
    /// `density`. `values` are rows of the same nodes.
    pub fn anisotropy(
        &mut self,
        rows: &RowsAround,
        (start, end): (usize, usize),
        density: &[f32],
        values: [&mut [f32]; ANISOTROPY],
    ) {
        // Cells outside the grid add nothing.
        let (first, last) = (start.saturating_sub(1), end.min(self.cells[0].len() - 2));
        let count = end - start + 1;
        let mut cells = self.cells.each_mut().map(|cells| &mut cells[..count]);
        cells.iter_mut().for_each(|cells| cells.fill(0.0));
        let inside = 1 + first - start..1 + last - start;
        let mut inner = cells.each_mut().map(|cells| &mut cells[inside.clone()]);
        for low in [0, 1] {
            for left in [0, 1] {
                let corner = |x: usize, y: usize| rows[low + x][left + y];
                if let (Some(a), Some(b), Some(c), Some(d)) =
                    (corner(0, 0), corner(0, 1), corner(1, 0), corner(1, 1))
                {
                    let corners = [a, b, c, d].map(|row| &row[first..=last]);
                    add_products(corners, self.scale, &mut inner);
                }
            }
        }
        divide(cells.map(|cells| &*cells), density, values);
    }
}

/// The anisotropy of nodes from the sums of products of the cells before and behind each.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn divide(cells: [&[f32]; PRODUCTS], density: &[f32], values: [&mut [f32]; ANISOTROPY]) {
    let count = density.len();
    let cells = cells.map(|cells| &cells[..count + 1]);
    let [va, vb, vc, vd, ve] = values.map(|values| &mut values[..count]);
    for i in 0..count {
        let tensor = cells.map(|cells| cells[i] + cells[i + 1]);
        let share = density[i] / (tensor[0] + tensor[1] + tensor[2] + FLAT);
        let [a, b, c, d, e] = of_tensor(tensor).map(|value| value * share);
        (va[i], vb[i], vc[i], vd[i], ve[i]) = (a, b, c, d, e);
    }
}

/// Adds the products of the gradients in the middle of cells between four rows: those at low x and
/// low y, low x and high y, high x and low y, high x and high y.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn add_products(rows: [&[f32]; 4], scale: [f32; 3], products: &mut [&mut [f32]; PRODUCTS]) {
    let count = products[0].len();
    let [a, b, c, d] = rows.map(|row| &row[..count + 1]);
    let [xx, yy, zz, xy, xz, yz] = products.each_mut().map(|products| &mut products[..count]);
    let [sx, sy, sz] = scale.map(|scale| scale / 4.0);
    for i in 0..count {
        let [pa, pb, pc, pd] = [a, b, c, d].map(|row| row[i] + row[i + 1]);
        let x = (pc + pd - pa - pb) * sx;
        let y = (pb + pd - pa - pc) * sy;
        let [da, db, dc, dd] = [a, b, c, d].map(|row| row[i + 1] - row[i]);
        let z = (da + db + dc + dd) * sz;
        xx[i] += x * x;
        yy[i] += y * y;
        zz[i] += z * z;
        xy[i] += x * y;
        xz[i] += x * z;
        yz[i] += y * z;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::anisotropy::functions;

    /// Anisotropy in the middle of 3 x 3 x 3 alphas, at a density of 1.
    fn in_the_middle(alpha: impl Fn([f32; 3]) -> f32, scale: [f32; 3]) -> [f32; ANISOTROPY] {
        let node = |i: usize| i as f32 - 1.0;
        let row = |x: usize, y: usize| {
            (0..3).map(|z| alpha([node(x), node(y), node(z)])).collect::<Vec<f32>>()
        };
        let rows = [0, 1, 2].map(|x| [0, 1, 2].map(|y| row(x, y)));
        let around = rows.each_ref().map(|rows| rows.each_ref().map(|row| Some(row.as_slice())));
        let mut values = [[0.0f32; 1]; ANISOTROPY];
        let out = values.each_mut().map(|value| &mut value[..]);
        StructureTensor::new(scale, 3).anisotropy(&around, (1, 2), &[1.0], out);
        values.map(|[value]| value)
    }

    #[test]
    fn a_slope_has_the_functions_of_its_direction() {
        for normal in [[1.0f64, 0.0, 0.0], [0.6, 0.0, -0.8], [0.48, -0.6, 0.64]] {
            let [x, y, z] = normal.map(|part| part as f32);
            let scale = [1.0, 0.5, 2.0];
            // Twice the node distance along an axis halves its scale.
            let slope = |at: [f32; 3]| 0.5 + 0.2 * (x * at[0] + y * at[1] * 2.0 + z * at[2] * 0.5);
            let found = in_the_middle(slope, scale);
            let share = 8.0 * 0.04 / (8.0 * 0.04 + FLAT);
            for (found, expected) in found.into_iter().zip(functions(normal)) {
                assert!((found - expected * share).abs() < 1e-5, "{found} for {expected}");
            }
        }
    }

    #[test]
    fn fog_has_none_and_a_rod_hides_less_along_itself() {
        assert_eq!(in_the_middle(|_| 0.4, [1.0; 3]), [0.0; ANISOTROPY]);
        let rod = |at: [f32; 3]| if at[0] == 0.0 && at[1] == 0.0 { 0.8 } else { 0.0 };
        let rod = in_the_middle(rod, [1.0; 3]);
        let along = |direction| {
            let functions = functions(direction);
            rod.iter().zip(functions).map(|(value, function)| value * function).sum::<f32>()
        };
        assert!(along([0.0, 0.0, 1.0]) < -0.15);
        assert!(along([1.0, 0.0, 0.0]) > 0.05 && along([0.0, 1.0, 0.0]) > 0.05);
    }
}
