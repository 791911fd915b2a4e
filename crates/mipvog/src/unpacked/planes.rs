//! Planes of a decoded level.

use crate::base::error::{Error, Place, Result};
use crate::container::Container;
use crate::model::baked::{BakedLevel, Group, LevelMetadata};
use crate::quantize::decode_codes;

/// A slice of a level: the nodes with this index along this axis. Its values are in C order of the
/// other two axes.
#[derive(Debug, Clone, Copy)]
pub struct Slice {
    /// The axis, 0 to 2.
    pub axis: usize,
    /// The number of its nodes along the axis.
    pub index: usize,
}

impl Slice {
    /// The two axes that it spans.
    pub fn spans(self) -> [usize; 2] {
        match self.axis {
            0 => [1, 2],
            1 => [0, 2],
            _ => [0, 1],
        }
    }

    /// The node at a place in it.
    pub fn node(self, first: usize, second: usize) -> [usize; 3] {
        match self.axis {
            0 => [self.index, first, second],
            1 => [first, self.index, second],
            _ => [first, second, self.index],
        }
    }
}

/// Refuses levels that a container does not have, and a level with slabs that take too much memory.
pub fn check_levels(container: &Container, levels: &[usize]) -> Result<()> {
    let metadata = container.metadata();
    for (part, level) in metadata.parts().enumerate() {
        if levels.is_empty() || levels.contains(&metadata.level_of_part(part)) {
            let place = Place::Key(format!("dimensions of {}", metadata.part_name(part)));
            level.grid().nodes.check_planes(level.block_size, container.limits(), &place)?;
        }
    }
    let count = container.metadata().levels.len();
    match levels.iter().find(|&&level| level >= count) {
        None => Ok(()),
        Some(beyond) => Err(Error::invalid_option(
            "levels",
            format!("level {beyond}"),
            format!("levels 0 to {}", count.saturating_sub(1)),
        )),
    }
}

/// Writes one x plane, `ny * nz` values, of one channel of a group. `false`, and nothing done, if
/// the level has no such group.
pub fn fill_plane(
    level: &BakedLevel,
    metadata: &LevelMetadata,
    group: Group,
    channel: usize,
    x: usize,
    out: &mut [f32],
) -> bool {
    let (Some(codes), Some(encoding)) = (&level.atlases[group.index()], metadata.encoding(group))
    else {
        return false;
    };
    out.fill(encoding.empty);
    let grid = metadata.grid();
    let [_, ny, nz] = grid.nodes.0;
    let (edge, block_nodes) = (grid.edge, grid.block_nodes());
    let Some(channels) = (codes.len() / block_nodes).checked_div(level.table.frames()) else {
        return true;
    };
    let [_, by, bz] = grid.counts();
    for j in 0..by {
        for k in 0..bz {
            let Some(frame) = level.table.frame([x / edge, j, k]) else { continue };
            let block = (frame * channels + channel) * block_nodes;
            let count = edge.min(nz - k * edge);
            for y in j * edge..ny.min((j + 1) * edge) {
                let at = block + (x % edge * edge + y % edge) * edge;
                let row = &mut out[y * nz + k * edge..][..count];
                decode_codes(encoding, codes, at..at + count, row);
            }
        }
    }
    true
}

/// As [`fill_plane`], of the nodes of a slice along any axis.
pub fn fill_slice(
    level: &BakedLevel,
    metadata: &LevelMetadata,
    (group, channel): (Group, usize),
    slice: Slice,
    out: &mut [f32],
) {
    let (Some(codes), Some(encoding)) = (&level.atlases[group.index()], metadata.encoding(group))
    else {
        return;
    };
    out.fill(encoding.empty);
    let grid = metadata.grid();
    let (edge, block_nodes) = (grid.edge, grid.block_nodes());
    let Some(channels) = (codes.len() / block_nodes).checked_div(level.table.frames()) else {
        return;
    };
    let [rows, length] = slice.spans().map(|axis| grid.nodes.0[axis]);
    let inside = slice.index % edge;
    for (first, second) in (0..rows.div_ceil(edge))
        .flat_map(|i| (0..length.div_ceil(edge)).map(move |j| (i * edge, j * edge)))
    {
        let place = slice.node(first, second).map(|node| node / edge);
        let Some(frame) = level.table.frame(place) else { continue };
        let block = (frame * channels + channel) * block_nodes;
        for i in first..rows.min(first + edge) {
            for j in second..length.min(second + edge) {
                let [x, y, z] = Slice { index: inside, ..slice }.node(i % edge, j % edge);
                let at = block + (x * edge + y) * edge + z;
                let value = &mut out[i * length + j..][..1];
                decode_codes(encoding, codes, at..at + 1, value);
            }
        }
    }
}
