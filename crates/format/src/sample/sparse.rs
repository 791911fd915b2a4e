//! A baked field: decoded frames, each with an apron of one node on its upper sides, found through
//! the indirection table.
//!
//! A cell belongs to the block of its lowest node. The apron repeats the lowest nodes of the next
//! blocks along each axis, so that all cells of a block are interpolated within its frame; where
//! the next block is not stored the apron holds the level's empty values.

use super::level::{Cell, Values, split};
use super::skip::{OccupiedMacroCells, SkipGrid};
use super::{SampleLevels, interpolated_density};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::parallel;
use crate::model::anisotropy::{ANISOTROPY, most_added};
use crate::model::baked::{
    BakedField, BakedLevel, ColorLayout, DensityDomain, Group, LevelMetadata, Metadata,
};
use crate::model::directional::DIRECTIONAL;
use crate::model::grid::Nodes;
use crate::model::scene::Activation;
use crate::quantize::decode_codes;

/// Marks blocks without a frame.
const NO_FRAME: u32 = u32::MAX;

/// Sparse levels.
#[derive(Debug)]
pub struct Sparse<const C: usize> {
    levels: Vec<Level<C>>,
    skip: SkipGrid,
}

#[derive(Debug)]
struct Level<const C: usize> {
    sizes: [usize; 3],
    /// For each node along each axis, its addend to the number of its block, and to its own number
    /// in its frame: divisions that rays would repeat.
    parts: [Vec<[u32; 2]>; 3],
    /// Frame of each block, or [`NO_FRAME`].
    frames: Vec<u32>,
    /// Nodes of a frame with its apron.
    frame_nodes: usize,
    empty_density: f32,
    empty_color: [f32; C],
    values: Values<C>,
}

impl<const C: usize> Sparse<C> {
    /// Decodes `field`.
    pub fn new(field: &BakedField, limits: &Limits) -> Result<Self> {
        let Metadata { activation, bounds, .. } = &field.metadata;
        let layout = field.metadata.layout();
        if layout.color_channels() > C {
            let found = format!("{} colour channels", layout.color_channels());
            return Err(Error::unsupported(Place::File, found, format!("at most {C}")));
        }
        let mut budget = Budget::new(limits);
        let mut levels = Vec::new();
        let mut occupied: Vec<Vec<bool>> = Vec::new();
        let Some(finest) = field.metadata.levels.first().map(|level| level.grid().nodes) else {
            return Err(Error::malformed(Place::File, "no levels", "at least one"));
        };
        for (level, metadata) in field.levels.iter().zip(&field.metadata.levels) {
            let decoded = Level::new(level, metadata, activation, layout, &mut budget)?;
            let own = decoded.occupied(level, metadata, finest, activation);
            let own = own.map(|cells| cells.finish(finest));
            // A level of colour alone shows level 0's density.
            occupied.extend(own.or_else(|| occupied.first().cloned()));
            levels.push(decoded);
        }
        let mask = field.free_space.as_ref();
        let skip = SkipGrid::new(finest, bounds, mask, &occupied)?;
        Ok(Self { levels, skip })
    }
}

impl<const C: usize> SampleLevels<C> for Sparse<C> {
    fn levels(&self) -> usize {
        self.levels.len()
    }

    #[inline(always)]
    fn locate(&self, level: usize, position: [f64; 3]) -> Option<Cell> {
        let level = &self.levels[level];
        let [px, py, pz] = position;
        let [sx, sy, sz] = level.sizes;
        let [(x, fx), (y, fy), (z, fz)] = [split(px, sx), split(py, sy), split(pz, sz)];
        let [xs, ys, zs] = &level.parts;
        let (x, y, z) = (xs[x], ys[y], zs[z]);
        let frame = level.frames[(x[0] + y[0] + z[0]) as usize];
        if frame == NO_FRAME {
            return None;
        }
        let node = frame as usize * level.frame_nodes + (x[1] + y[1] + z[1]) as usize;
        Some(Cell { node, fraction: [fx, fy, fz] })
    }

    #[inline(always)]
    fn density(&self, level: usize, cell: &Cell, along: &[f32; ANISOTROPY]) -> f32 {
        self.levels[level].values.density(cell, along)
    }

    #[inline(always)]
    fn color(&self, level: usize, cell: &Cell) -> [f32; C] {
        self.levels[level].values.color(cell)
    }

    fn density_level(&self, level: usize) -> bool {
        self.levels.get(level).is_some_and(|level| level.values.density.is_some())
    }

    fn density_domain(&self, level: usize) -> DensityDomain {
        self.levels[level].values.domain
    }

    fn empty_density(&self, level: usize) -> f32 {
        self.levels[level].empty_density
    }

    fn empty_color(&self, level: usize) -> [f32; C] {
        self.levels[level].empty_color
    }

    fn skip(&self) -> &SkipGrid {
        &self.skip
    }
}

impl<const C: usize> Level<C> {
    fn new(
        level: &BakedLevel,
        metadata: &LevelMetadata,
        activation: &Activation,
        layout: ColorLayout,
        budget: &mut Budget,
    ) -> Result<Self> {
        let grid = metadata.grid();
        let side = grid.edge + 1;
        let nodes = side.pow(3);
        let table = &level.table;
        let has = |group: Group| metadata.encoding(group).is_some();
        let anisotropic = has(Group::Anisotropy);
        let lanes = C + 1 + if anisotropic { ANISOTROPY } else { 0 };
        let values = table.frames() as u64 * nodes as u64 * lanes as u64;
        budget.spend(4 * values, "bytes of decoded frames", &Place::File)?;
        let mut frames = vec![NO_FRAME; grid.total()];
        let places: Vec<[usize; 3]> = table.stored().collect();
        let [_, by, bz] = grid.counts();
        for (frame, &[x, y, z]) in places.iter().enumerate() {
            frames[(x * by + y) * bz + z] = frame as u32;
        }
        let domain = metadata.density_domain();
        let empty = |group: Group| metadata.encoding(group).map_or(0.0, |encoding| encoding.empty);
        let empty_density = interpolated_density(activation, domain, empty(Group::Density));
        let mut empty_color = [0.0; C];
        for group in Group::COLORS {
            let first = first_lane(group, layout, C);
            empty_color[first..first + group.channels(layout)].fill(empty(group));
        }
        let frame_count = table.frames();
        let has_density = metadata.density.is_some();
        let count = |has: bool| if has { frame_count * nodes } else { 0 };
        let mut density = vec![0.0; count(has_density)];
        let mut anisotropy = vec![[0.0; ANISOTROPY]; count(anisotropic)];
        let mut color = vec![[0.0; C]; frame_count * nodes];
        let mut densities = density.chunks_exact_mut(nodes);
        let mut anisotropies = anisotropy.chunks_exact_mut(nodes);
        let own = |color| (densities.next(), anisotropies.next(), color);
        let mut frames_of: Vec<_> = color.chunks_exact_mut(nodes).map(own).collect();
        parallel::map_mut(&mut frames_of, |i, (density, anisotropy, color)| {
            let mut scratch = vec![0.0; nodes];
            if let Some(density) = density {
                apron_frame(level, metadata, Group::Density, (0, 1), places[i], density);
                let stored = density.iter_mut();
                stored.for_each(|raw| *raw = interpolated_density(activation, domain, *raw));
            }
            if let Some(anisotropy) = anisotropy {
                for channel in 0..ANISOTROPY {
                    let from = (channel, ANISOTROPY);
                    apron_frame(level, metadata, Group::Anisotropy, from, places[i], &mut scratch);
                    let nodes = anisotropy.iter_mut().zip(&scratch);
                    nodes.for_each(|(node, &value)| node[channel] = value);
                }
            }
            for group in Group::COLORS.into_iter().filter(|&group| has(group)) {
                let (channels, first) = (group.channels(layout), first_lane(group, layout, C));
                for channel in 0..channels {
                    let from = (channel, channels);
                    apron_frame(level, metadata, group, from, places[i], &mut scratch);
                    for (node, &value) in color.iter_mut().zip(&scratch) {
                        node[first + channel] = value;
                    }
                }
            }
            Ok(())
        })?;
        let density = has_density.then_some(density);
        let strides = [side * side, side];
        let values = Values { density, domain, anisotropy, color, strides };
        let strides = [[by * bz, side * side], [bz, side], [1, 1]];
        let parts = [0, 1, 2].map(|axis| {
            let part = |node: usize| {
                let [block, inside] = [node / grid.edge, node % grid.edge];
                [(block * strides[axis][0]) as u32, (inside * strides[axis][1]) as u32]
            };
            (0..grid.nodes.0[axis]).map(part).collect()
        });
        Ok(Self {
            sizes: grid.nodes.0,
            parts,
            frames,
            frame_nodes: nodes,
            empty_density,
            empty_color,
            values,
        })
    }

    /// The macro cells in which the level is visible; none if it has no density.
    fn occupied(
        &self,
        level: &BakedLevel,
        metadata: &LevelMetadata,
        finest: Nodes,
        activation: &Activation,
    ) -> Option<OccupiedMacroCells> {
        let density = self.values.density.as_ref()?;
        let grid = metadata.grid();
        let mut cells = OccupiedMacroCells::new(grid.nodes, finest, self.values.domain, activation);
        let [plane, row] = self.values.strides;
        let mut anisotropy = self.values.anisotropy.chunks_exact(self.frame_nodes);
        for (place, frame) in level.table.stored().zip(density.chunks_exact(self.frame_nodes)) {
            let own = anisotropy.next().unwrap_or_default();
            let first = place.map(|block| block * grid.edge);
            let end = [0, 1, 2].map(|axis| (first[axis] + grid.edge).min(grid.nodes.0[axis] - 1));
            if (0..3).any(|axis| first[axis] == end[axis]) {
                // Only the last nodes of an axis, which are no cell's lowest.
                continue;
            }
            for (i, &value) in frame.iter().enumerate() {
                let value = value + own.get(i).map_or(0.0, most_added);
                let inside = [i / plane, i % plane / row, i % row];
                let at = [0, 1, 2].map(|axis| first[axis] + inside[axis]);
                cells.mark(at, value, [first, end]);
            }
        }
        Some(cells)
    }
}

/// The lane of a group's first channel: groups follow each other, but for directional brightness,
/// which has the last lanes.
fn first_lane(group: Group, layout: ColorLayout, lanes: usize) -> usize {
    match group {
        Group::Directional => lanes - DIRECTIONAL,
        _ => {
            let before = Group::COLORS.into_iter().take_while(|&before| before != group);
            before.map(|before| before.channels(layout)).sum()
        }
    }
}

/// Decodes one channel of a block with its apron.
fn apron_frame(
    level: &BakedLevel,
    metadata: &LevelMetadata,
    group: Group,
    (channel, channels): (usize, usize),
    place: [usize; 3],
    out: &mut [f32],
) {
    let (Some(codes), Some(encoding)) = (&level.atlases[group.index()], metadata.encoding(group))
    else {
        return;
    };
    let grid = metadata.grid();
    let (edge, side) = (grid.edge, grid.edge + 1);
    let counts = grid.counts();
    out.fill(encoding.empty);
    for corner in 0..8usize {
        let up = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
        let neighbour = [0, 1, 2].map(|axis| place[axis] + up[axis]);
        if (0..3).any(|axis| neighbour[axis] >= counts[axis]) {
            continue;
        }
        let Some(frame) = level.table.frame(neighbour) else { continue };
        let block = (frame * channels + channel) * grid.block_nodes();
        // The block itself, or the lowest nodes of a neighbour along each axis that is up.
        let count = up.map(|up| if up == 1 { 1 } else { edge });
        for x in 0..count[0] {
            for y in 0..count[1] {
                let from = block + (x * edge + y) * edge;
                let to = ((x + up[0] * edge) * side + y + up[1] * edge) * side + up[2] * edge;
                let row = &mut out[to..to + count[2]];
                decode_codes(encoding, codes, from..from + count[2], row);
            }
        }
    }
}
