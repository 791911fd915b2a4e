//! The cells of a grid that the free-space mask lets samples be in.
//!
//! The mask is a grid of its own with its own box, looked up at each sample. A cell of a level is
//! *inside* if any of its points may be in the mask: if any mask node within the reach of a lookup
//! from the cell is. For a nearest lookup that is exact; for a trilinear one it errs towards
//! keeping, since an interpolated value never exceeds the nodes around it.

use crate::base::error::Result;
use crate::base::parallel;
use crate::model::field::{FreeSpace, Lookup, Planes};
use crate::model::grid::{Bounds, CellMask, NodeMask, Nodes, row};

/// Positions that fall within this of a border between mask nodes count for both sides.
const SLACK: f64 = 1e-4;

/// The cells of a level that the mask touches.
///
/// # Errors
///
/// None of its own.
pub fn inside_cells(free_space: &FreeSpace, bounds: &Bounds, nodes: Nodes) -> Result<CellMask> {
    touched_cells(free_space, &cell_faces(bounds, nodes))
}

/// The cells between `faces` (world positions along each axis, ascending) that the mask touches, as
/// a set of as many nodes as there are faces.
///
/// # Errors
///
/// None of its own.
pub fn touched_cells(free_space: &FreeSpace, faces: &[Vec<f64>; 3]) -> Result<CellMask> {
    let nodes = Nodes([0, 1, 2].map(|axis| faces[axis].len()));
    any_in_ranges(&inside_nodes(free_space)?, nodes, &mask_ranges(free_space, faces))
}

/// The opacity that would show if the mask were dropped: that over one interval of the visible
/// samples that only the mask drops, for each visible sample that it keeps. Cells that are partly
/// inside are sampled at 27 points each. A mask's box holds the field's, as training makes it, so
/// nothing is searched beyond its nodes.
///
/// # Errors
///
/// Those of reading density.
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

/// The cells of `nodes` for which `from` holds a node in the cell's ranges along each axis.
pub(super) fn any_in_ranges(
    from: &NodeMask,
    nodes: Nodes,
    ranges: &[Vec<(usize, usize)>; 3],
) -> Result<CellMask> {
    let words = row::words(nodes);
    let [x_ranges, y_ranges, z_ranges] = ranges;
    let lowest = NodeMask::of_planes(nodes, |x, plane| {
        let Some(&(start, end)) = x_ranges.get(x) else { return Ok(()) };
        let mut merged = vec![0; from.nodes().0[1] * from.row_words()];
        for x in start..end {
            row::or_into(&mut merged, from.plane(x));
        }
        let mut row = vec![0; from.row_words()];
        for (y, &(start, end)) in y_ranges.iter().enumerate() {
            row.fill(0);
            for other in merged[start * row.len()..end * row.len()].chunks_exact(row.len()) {
                row::or_into(&mut row, other);
            }
            let out = &mut plane[y * words..][..words];
            for (z, &(start, end)) in z_ranges.iter().enumerate() {
                if row::any_between(&row, start, end) {
                    row::set(out, z);
                }
            }
        }
        Ok(())
    });
    lowest.map(CellMask::of_lowest_nodes)
}

/// The mask's nodes that are inside by themselves.
fn inside_nodes(free_space: &FreeSpace) -> Result<NodeMask> {
    let nodes = free_space.nodes;
    let [_, ny, nz] = nodes.0;
    let words = row::words(nodes);
    NodeMask::of_planes(nodes, |x, plane| {
        for (y, row) in plane.chunks_exact_mut(words).enumerate() {
            let first = (x * ny + y) * nz;
            match &free_space.lookup {
                Lookup::Nearest(inside) => {
                    for z in (0..nz).filter(|z| inside[first + z]) {
                        row::set(row, z);
                    }
                }
                // At least a number is above the one below it.
                Lookup::Trilinear { values, threshold } => {
                    row::pack_above(&values[first..first + nz], threshold.next_down(), row);
                }
            }
        }
        Ok(())
    })
}

/// World positions of a level's nodes along each axis.
fn cell_faces(bounds: &Bounds, nodes: Nodes) -> [Vec<f64>; 3] {
    [0, 1, 2].map(|axis| {
        let (min, spacing) = (f64::from(bounds.min[axis]), nodes.spacing(bounds)[axis]);
        (0..nodes.0[axis]).map(|node| min + node as f64 * spacing).collect()
    })
}

/// Mask nodes that lookups from each cell between `faces` can reach, clipped to those that there
/// are: first and one past the last, by axis.
fn mask_ranges(free_space: &FreeSpace, faces: &[Vec<f64>; 3]) -> [Vec<(usize, usize)>; 3] {
    [0, 1, 2].map(|axis| {
        let count = free_space.nodes.0[axis];
        let clip = |at: f64| at.clamp(0.0, count as f64) as usize;
        let at = |face: f64| face * free_space.scale[axis] + free_space.shift[axis];
        let reach = |low: f64, high: f64| match free_space.lookup {
            Lookup::Nearest(_) => (clip(libm::rint(low)), clip(libm::rint(high) + 1.0)),
            Lookup::Trilinear { .. } => (clip(low.floor()), clip(high.ceil() + 1.0)),
        };
        let cells = faces[axis].windows(2);
        // The mask may run against the axis.
        let ends = cells.map(|pair| (at(pair[0]), at(pair[1])));
        ends.map(|(a, b)| reach(a.min(b) - SLACK, a.max(b) + SLACK)).collect()
    })
}

/// Points of a cell at which a mask is asked: its middle, and close to its faces, edges and
/// corners.
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
