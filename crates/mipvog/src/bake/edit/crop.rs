//! A container that is empty outside a box.
//!
//! Every level spans the same box with nodes on its faces, and the cell counts of neighbouring
//! levels rarely have a common divisor. So no smaller box has nodes of all levels on its faces: the
//! grids stay, and nodes outside become empty. The free-space mask cuts samples at the box, the
//! same at every level; blocks that no sample inside reads lose their frames. Samples inside read
//! the same values as before.

use crate::base::error::{Error, Result};
use crate::model::field::{FreeSpace, Lookup};
use crate::model::grid::{Bounds, Nodes};
use crate::unpacked::Unpacked;

use super::blocks::keep_blocks;

/// Positions this close to a face, in shares of the box, count as inside.
const ON_FACE: f64 = 1e-6;

/// Empties everything outside the box `asked` in world coordinates, widened to nodes of level 0. A
/// free-space mask is cut at its next node outside.
///
/// # Errors
///
/// [`crate::base::error::ErrorKind::InvalidOption`] for an empty box, or one that does not overlap
/// the container's.
pub fn crop(unpacked: &mut Unpacked, asked: &Bounds) -> Result<()> {
    let bounds = unpacked.metadata.bounds;
    check_meets(asked, &bounds)?;
    let Some(finest) = unpacked.levels.first() else { return Ok(()) };
    let nodes = finest.table.grid().nodes;
    let spacing = nodes.spacing(&bounds);
    let cells = nodes.0.map(|count| count - 1);
    let at =
        |world: f32, axis: usize| (f64::from(world) - f64::from(bounds.min[axis])) / spacing[axis];
    let mut range = [[0; 2]; 3];
    for (axis, range) in range.iter_mut().enumerate() {
        let (low, high) = (at(asked.min[axis], axis), at(asked.max[axis], axis));
        let end = cells[axis] as f64;
        // A face that is a node up to rounding is that node.
        let slack = ON_FACE * end;
        *range = [(low + slack).floor().max(0.0) as usize, (high - slack).ceil().min(end) as usize];
        range[1] = range[1].max(range[0] + 1);
    }
    for level in 0..unpacked.levels.len() {
        let grid = unpacked.levels[level].table.grid();
        // Nodes that samples inside read, and one more: rounding may put a sample on a face into
        // the cell before.
        let blocks = [0, 1, 2].map(|axis| {
            let own = grid.nodes.0[axis] - 1;
            let first = (range[axis][0] * own / cells[axis]).saturating_sub(1);
            let last = ((range[axis][1] * own).div_ceil(cells[axis]) + 1).min(own);
            first / grid.edge..=last / grid.edge
        });
        keep_blocks(unpacked, level, |place| {
            (0..3).all(|axis| blocks[axis].contains(&place[axis]))
        })?;
    }
    if range == cells.map(|cells| [0, cells]) {
        return Ok(());
    }
    let faces = [0, 1].map(|end| {
        [0, 1, 2].map(|axis| f64::from(bounds.min[axis]) + range[axis][end] as f64 * spacing[axis])
    });
    unpacked.free_space = Some(match &unpacked.free_space {
        Some(mask) => cropped(mask, faces),
        None => whole_box(faces),
    });
    unpacked.metadata.free_space = true;
    Ok(())
}

/// Refuses an empty box, and one that does not overlap the container's.
pub(super) fn check_meets(asked: &Bounds, bounds: &Bounds) -> Result<()> {
    // A number that is not finite is no bound either.
    let meets = |axis: usize| {
        let (low, high) = (asked.min[axis], asked.max[axis]);
        low < high && low < bounds.max[axis] && high > bounds.min[axis]
    };
    if (0..3).all(meets) {
        return Ok(());
    }
    let found = format!("{:?} to {:?}", asked.min, asked.max);
    let expected = format!(
        "a box with its lowest corner first that meets {:?} to {:?}",
        bounds.min, bounds.max
    );
    Err(Error::invalid_option("crop", found, expected))
}

/// A mask that is inside between the corners `[lowest, highest]`. Along each axis it has two inside
/// nodes, each the nearest one in its half, and one outside node on each side: renderers find the
/// cells that a mask cuts by its nodes.
fn whole_box([low, high]: [[f64; 3]; 2]) -> FreeSpace {
    let scale = [0, 1, 2].map(|axis| 2.0 * (1.0 - ON_FACE) / (high[axis] - low[axis]));
    let shift = [0, 1, 2].map(|axis| 0.5 + ON_FACE - low[axis] * scale[axis]);
    let inside =
        |node: usize| [node / 16, node / 4 % 4, node % 4].iter().all(|at| [1, 2].contains(at));
    let lookup = Lookup::Nearest((0..64).map(inside).collect());
    FreeSpace { nodes: Nodes([4; 3]), scale, shift, lookup }
}

/// The part of a mask that positions between the corners can read, surrounded by outside nodes.
fn cropped(mask: &FreeSpace, [low, high]: [[f64; 3]; 2]) -> FreeSpace {
    let is_nearest = matches!(mask.lookup, Lookup::Nearest(_));
    // The node before the first one that is read, and the number of nodes up to the one after the
    // last.
    let axis = |axis: usize| {
        let at = |world: f64| world * mask.scale[axis] + mask.shift[axis];
        let (a, b) = (at(low[axis]), at(high[axis]));
        let (from, to) = (a.min(b) - ON_FACE, a.max(b) + ON_FACE);
        let [from, to] = match is_nearest {
            true => [libm::rint(from), libm::rint(to)],
            false => [from.floor(), to.ceil()],
        };
        let end = mask.nodes.0[axis] as f64;
        let [from, to] = [from, to].map(|node| node.clamp(-1.0, end) as isize);
        (from - 1, (to - from + 3) as usize)
    };
    let axes = [0, 1, 2].map(axis);
    let nodes = axes.map(|(_, count)| count);
    // The node of the whole mask, if it is one that is read.
    let own = |node: usize| {
        let inside = [node / (nodes[1] * nodes[2]), node / nodes[2] % nodes[1], node % nodes[2]];
        let mut own = 0;
        for axis in 0..3 {
            let is_ring = inside[axis] == 0 || inside[axis] + 1 == nodes[axis];
            let at = usize::try_from(axes[axis].0 + inside[axis] as isize).ok();
            let at = at.filter(|&at| !is_ring && at < mask.nodes.0[axis])?;
            own = own * mask.nodes.0[axis] + at;
        }
        Some(own)
    };
    let all = 0..nodes.iter().product::<usize>();
    let lookup = match &mask.lookup {
        Lookup::Nearest(inside) => {
            Lookup::Nearest(all.map(|node| own(node).is_some_and(|own| inside[own])).collect())
        }
        Lookup::Trilinear { values, threshold } => {
            // So low that a position a hundredth of a cell beyond a kept node is outside.
            let lowest = values.iter().copied().fold(*threshold, f32::min);
            let highest = values.iter().copied().fold(*threshold, f32::max);
            let outside = lowest - 100.0 * (highest - lowest) - 1.0;
            let value = |node: usize| own(node).map_or(outside, |own| values[own]);
            Lookup::Trilinear { values: all.map(value).collect(), threshold: *threshold }
        }
    };
    let shift = [0, 1, 2].map(|axis| mask.shift[axis] - axes[axis].0 as f64);
    FreeSpace { nodes: Nodes(nodes), scale: mask.scale, shift, lookup }
}
