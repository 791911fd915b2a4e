//! The cells of a grid in which the free-space mask allows samples.
//!
//! The mask is a grid of its own with its own box, looked up at each sample. A cell of a level is
//! *inside* if any of its points may be in the mask: if any mask node within the reach of a lookup
//! from the cell is. For a nearest lookup, this is exact; for a trilinear one, it is conservative,
//! because an interpolated value never exceeds the nodes around it.

use crate::base::error::Result;
use crate::model::grid::{Bounds, CellMask, NodeMask, Nodes, row};
use crate::model::scene::{FreeSpace, Lookup};

/// Positions this close to a border between mask nodes count for both sides.
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

/// The cells of `nodes` for which `from` holds a node in the cell's ranges along each axis.
pub fn any_in_ranges(
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

/// The inside nodes of the mask.
pub fn inside_nodes(free_space: &FreeSpace) -> Result<NodeMask> {
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
                // At least the next representable number.
                Lookup::Trilinear { values, threshold } => {
                    row::pack_above(&values[first..first + nz], threshold.next_down(), row);
                }
            }
        }
        Ok(())
    })
}

/// World positions of a level's nodes along each axis.
pub fn cell_faces(bounds: &Bounds, nodes: Nodes) -> [Vec<f64>; 3] {
    [0, 1, 2].map(|axis| {
        let (min, spacing) = (f64::from(bounds.min[axis]), nodes.spacing(bounds)[axis]);
        (0..nodes.0[axis]).map(|node| min + node as f64 * spacing).collect()
    })
}

/// Mask nodes within reach of lookups from each cell between `faces`, clipped to the mask: first
/// and one past the last, by axis.
pub fn mask_ranges(free_space: &FreeSpace, faces: &[Vec<f64>; 3]) -> [Vec<(usize, usize)>; 3] {
    [0, 1, 2].map(|axis| {
        let count = free_space.nodes.0[axis];
        let clip = |at: f64| at.clamp(0.0, count as f64) as usize;
        let at = |face: f64| face * free_space.scale[axis] + free_space.shift[axis];
        let reach = |low: f64, high: f64| match free_space.lookup {
            Lookup::Nearest(_) => (clip(libm::rint(low)), clip(libm::rint(high) + 1.0)),
            Lookup::Trilinear { .. } => (clip(low.floor()), clip(high.ceil() + 1.0)),
        };
        let cells = faces[axis].windows(2);
        // The mask may run in the opposite direction.
        let ends = cells.map(|pair| (at(pair[0]), at(pair[1])));
        ends.map(|(a, b)| reach(a.min(b) - SLACK, a.max(b) + SLACK)).collect()
    })
}
