//! The visible effect of dropping the free-space mask.

use crate::base::error::Result;
use crate::base::parallel;
use crate::model::field::{FreeSpace, Planes};
use crate::model::grid::{CellMask, row};
use mipvog_format::sample::free_cells::{any_in_ranges, cell_faces, inside_nodes, mask_ranges};

/// The opacity that dropping the mask would reveal: the opacity over one interval of visible
/// samples that only the mask drops, per visible sample that it keeps. Cells that are partly inside
/// are sampled at 27 points each. A trained mask's box contains the field's, so the search ends at
/// its nodes.
///
/// # Errors
///
/// Errors of reading density.
pub fn masked_share(
    free_space: &FreeSpace,
    planes: &Planes,
    cells: &CellMask,
    raw_threshold: f32,
) -> Result<f64> {
    let field = planes.field();
    let bounds = &field.scene.bounds;
    let nodes = cells.lowest_nodes().nodes();
    let outside = inside_nodes(free_space)?.complement();
    let ranges = mask_ranges(free_space, &cell_faces(bounds, nodes));
    let mut partial = any_in_ranges(&outside, nodes, &ranges)?;
    partial.intersect(cells);
    let corners = partial.corners()?;
    let partial = partial.lowest_nodes();
    let spacing = nodes.spacing(bounds);
    let activation = &field.scene.activation;
    let [nx, ny, nz] = nodes.0;
    let sums = parallel::map(nx - 1, |x| {
        let mut sum = 0.0;
        if partial.plane(x).iter().all(|&word| word == 0) {
            return Ok(sum);
        }
        let mut pair = [vec![0.0; ny * nz], vec![0.0; ny * nz]];
        for (i, plane) in pair.iter_mut().enumerate() {
            planes.read(0, x + i, corners.plane(x + i), plane, false)?;
        }
        for y in 0..ny - 1 {
            for (start, end) in row::runs(partial.row(x, y)) {
                for z in start..end {
                    let corner = |i: usize, j: usize, k: usize| pair[i][(y + j) * nz + z + k];
                    for at in probes() {
                        let raw = trilinear(at, corner);
                        let world = [0, 1, 2].map(|axis| {
                            let node = [x, y, z][axis] as f64 + at[axis];
                            f64::from(bounds.min[axis]) + node * spacing[axis]
                        });
                        if raw > f64::from(raw_threshold) && !free_space.contains(world) {
                            sum += activation.opacity(raw);
                        }
                    }
                }
            }
        }
        Ok(sum)
    })?;
    Ok(sums.iter().sum::<f64>() / (27 * cells.count().max(1)) as f64)
}

/// Points of a cell at which a mask is sampled: the middle, and close to faces, edges and corners.
fn probes() -> impl Iterator<Item = [f64; 3]> {
    const AXIS: [f64; 3] = [1.0 / 64.0, 0.5, 63.0 / 64.0];
    (0..27usize).map(|probe| [AXIS[probe / 9], AXIS[probe / 3 % 3], AXIS[probe % 3]])
}

fn trilinear(at: [f64; 3], corner: impl Fn(usize, usize, usize) -> f32) -> f64 {
    let mut sum = 0.0;
    for i in 0..8usize {
        let bits = [i >> 2 & 1, i >> 1 & 1, i & 1];
        let weight: f64 =
            bits.iter().zip(at).map(|(&bit, at)| if bit == 1 { at } else { 1.0 - at }).product();
        sum += weight * f64::from(corner(bits[0], bits[1], bits[2]));
    }
    sum
}
