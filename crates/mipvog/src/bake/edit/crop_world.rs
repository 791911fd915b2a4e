//! A world that is empty outside a box.
//!
//! Boxes around the smallest one that holds the kept part are dropped. Rays are sampled only in the
//! kept part, at every level alike; blocks that no sample reads lose their frames. Remaining
//! samples read the same values as before.

use super::blocks::keep_blocks;
use super::crop::{check_meets, crop};
use super::outermost::drop_outermost;
use crate::base::error::Result;
use crate::model::baked::Metadata;
use crate::model::grid::Bounds;
use crate::unpacked::Unpacked;

/// Positions this close to a node, in distances of nodes, are that node.
const ON_NODE: f64 = 1e-4;

/// Empties everything outside `asked`, world coordinates, which is widened to voxels of level 0.
///
/// # Errors
///
/// [`crate::base::error::ErrorKind::InvalidOption`] for an empty box, or one that does not overlap
/// the container's.
pub fn crop_world(unpacked: &mut Unpacked, asked: &Bounds) -> Result<()> {
    let boxes = unpacked.metadata.boxes();
    let outermost = unpacked.metadata.outer_bounds();
    check_meets(asked, &outermost)?;
    let within = asked.common(&outermost).unwrap_or(outermost);
    let holds = |bounds: &&Bounds| within.common(bounds) == Some(within);
    let holding = boxes.iter().position(|bounds| holds(&bounds)).unwrap_or(boxes.len() - 1);
    drop_outermost(unpacked, boxes.len() - 1 - holding)?;
    if holding == 0 {
        return crop(unpacked, asked);
    }
    let outermost = unpacked.metadata.outer_bounds();
    let widened = widened(&unpacked.metadata, &within, &outermost);
    if widened == outermost {
        return Ok(());
    }
    let sampled = unpacked.metadata.march.sampled.unwrap_or(outermost);
    check_meets(&widened, &sampled)?;
    let kept = widened.common(&sampled).unwrap_or(sampled);
    unpacked.metadata.march.sampled = Some(kept);
    for part in 0..unpacked.levels.len() {
        let grid = unpacked.levels[part].table.grid();
        let bounds = boxes[unpacked.metadata.box_of_part(part)];
        let spacing = grid.nodes.spacing(&bounds);
        // Nodes that samples read, and one more: rounding may put a sample on a face into the cell
        // before.
        let blocks = [0, 1, 2].map(|axis| {
            let at = |world: f32| (f64::from(world) - f64::from(bounds.min[axis])) / spacing[axis];
            let (first, last) = (at(kept.min[axis]).floor() - 1.0, at(kept.max[axis]).ceil() + 1.0);
            let end = (grid.nodes.0[axis] - 1) as f64;
            // None if they do not meet.
            let meets = last >= 0.0 && first <= end;
            let blocks = |node: f64| node.clamp(0.0, end) as usize / grid.edge;
            meets.then(|| blocks(first)..=blocks(last))
        });
        keep_blocks(unpacked, part, |place| {
            let inside = |axis: usize| blocks[axis].as_ref().map(|own| own.contains(&place[axis]));
            (0..3).all(|axis| inside(axis) == Some(true))
        })?;
    }
    Ok(())
}

/// A box, widened to voxels of level 0, which continue beyond level 0's box, and clamped to the
/// outermost box.
fn widened(metadata: &Metadata, within: &Bounds, outermost: &Bounds) -> Bounds {
    let (inner, nodes) = (metadata.bounds, metadata.levels[0].dimensions);
    let mut widened = *within;
    for (axis, nodes) in nodes.into_iter().enumerate() {
        let from = f64::from(inner.min[axis]);
        let spacing = (f64::from(inner.max[axis]) - from) / (nodes - 1) as f64;
        let at = |world: f32| (f64::from(world) - from) / spacing;
        let low = from + (at(within.min[axis]) + ON_NODE).floor() * spacing;
        let high = from + (at(within.max[axis]) - ON_NODE).ceil() * spacing;
        widened.min[axis] = (low as f32).max(outermost.min[axis]);
        widened.max[axis] = (high as f32).min(outermost.max[axis]);
    }
    widened
}
