//! A baked field: decoded frames, each with an apron of one node on its upper sides, found through
//! the indirection table.
//!
//! A cell belongs to the block of its lowest node. The apron repeats the lowest nodes of the next
//! blocks along each axis, so that all cells of a block are interpolated within its frame; if the
//! next block is not stored, the apron has the level's empty values.

use super::level::{Cell, Values, split};
use super::skip::{CellPlace, OccupiedMacroCells, SkipGrid};
use super::{SampleLevels, interpolated_density};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::parallel;
use crate::model::anisotropy::{ANISOTROPY, most_added};
use crate::model::baked::{
    BakedField, BakedLevel, ColorLayout, DensityDomain, Group, LevelMetadata, Metadata,
};
use crate::model::directional::DIRECTIONAL;
use crate::model::grid::{BlockGrid, BoxFrame, Nodes};
use crate::model::scene::Activation;
use crate::quantize::decode_codes;

/// Marks blocks without a frame.
const NO_FRAME: u32 = u32::MAX;

/// Sparse levels.
#[derive(Debug)]
pub struct Sparse<const C: usize> {
    /// Levels, then shells.
    parts: Vec<Level<C>>,
    levels: usize,
    /// By nested box.
    skip: Vec<SkipGrid>,
}

#[derive(Debug)]
struct Level<const C: usize> {
    /// Place in the outermost box, unless it is that box.
    frame: Option<BoxFrame>,
    depth_scale: f32,
    sizes: [usize; 3],
    /// For each node along each axis, its addends to the block number and to the node number in the
    /// frame, which saves divisions per ray.
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
        let Metadata { activation, bounds, levels, .. } = &field.metadata;
        let layout = field.metadata.layout();
        if layout.color_channels() > C {
            let found = format!("{} colour channels", layout.color_channels());
            return Err(Error::unsupported(Place::File, found, format!("at most {C}")));
        }
        let mut budget = Budget::new(limits);
        let boxes = BoxFrame::of_boxes(&field.metadata.boxes());
        let mut parts = Vec::new();
        for (part, (level, metadata)) in field.levels.iter().zip(field.metadata.parts()).enumerate()
        {
            let frame = boxes.get(field.metadata.box_of_part(part)).copied();
            let mut own = Level::new(level, metadata, frame, activation, layout, &mut budget)?;
            if own.values.domain != DensityDomain::Raw {
                let number = field.metadata.box_of_part(part);
                own.depth_scale = libm::exp2(-(number as f64)) as f32;
            }
            parts.push(own);
        }
        if levels.is_empty() {
            return Err(Error::malformed(Place::File, "no levels", "at least one"));
        }
        let mut sparse = Self { parts, levels: levels.len(), skip: Vec::new() };
        for number in 0..boxes.len().max(1) {
            let finest = Nodes(sparse.parts[sparse.part(number, number)].sizes);
            let mask = field.free_space.as_ref().filter(|_| number == 0);
            let occupied = sparse.occupied(field, number, boxes.get(number), finest);
            sparse.skip.push(SkipGrid::new(finest, bounds, mask, &occupied)?);
        }
        Ok(sparse)
    }

    /// The macro cells of a nested box that its levels occupy, from the box's number on.
    fn occupied(
        &self,
        field: &BakedField,
        number: usize,
        frame: Option<&BoxFrame>,
        finest: Nodes,
    ) -> Vec<Vec<bool>> {
        let activation = &field.metadata.activation;
        let mut occupied: Vec<Vec<bool>> = Vec::new();
        for level in number..self.levels {
            let part = self.part(level, number);
            let (own, codes) = (&self.parts[part], &field.levels[part]);
            let nodes = Nodes(own.sizes);
            let place = match (&own.frame, frame) {
                (Some(own), Some(frame)) => CellPlace::between(nodes, own, finest, frame),
                _ => CellPlace::same_box(nodes, finest),
            };
            let edge = field.metadata.part(part).map_or(1, |level| level.block_size);
            let cells =
                OccupiedMacroCells::new(nodes, finest, place, own.values.domain, activation);
            let cells = own.occupied(codes, edge, cells).map(|cells| cells.finish(finest));
            // A level with only colour uses level 0's density.
            occupied.extend(cells.or_else(|| occupied.first().cloned()));
        }
        occupied
    }
}

impl<const C: usize> SampleLevels<C> for Sparse<C> {
    fn levels(&self) -> usize {
        self.levels
    }

    #[inline(always)]
    fn locate(&self, level: usize, position: [f64; 3]) -> Option<Cell> {
        let level = &self.parts[level];
        let [px, py, pz] = match &level.frame {
            None => position,
            Some(frame) => frame.place_within(position),
        };
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
        self.parts[level].values.density(cell, along)
    }

    #[inline(always)]
    fn color(&self, level: usize, cell: &Cell) -> [f32; C] {
        self.parts[level].values.color(cell)
    }

    fn density_level(&self, level: usize) -> bool {
        self.parts.get(level).is_some_and(|level| level.values.density.is_some())
    }

    fn density_domain(&self, level: usize) -> DensityDomain {
        self.parts[level].values.domain
    }

    fn depth_scale(&self, part: usize) -> f32 {
        self.parts[part].depth_scale
    }

    fn empty_density(&self, level: usize) -> f32 {
        self.parts[level].empty_density
    }

    fn empty_color(&self, level: usize) -> [f32; C] {
        self.parts[level].empty_color
    }

    fn skip(&self, number: usize) -> &SkipGrid {
        &self.skip[number]
    }
}

impl<const C: usize> Level<C> {
    fn new(
        level: &BakedLevel,
        metadata: &LevelMetadata,
        frame: Option<BoxFrame>,
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
            frame,
            depth_scale: 1.0,
            sizes: grid.nodes.0,
            parts,
            frames,
            frame_nodes: nodes,
            empty_density,
            empty_color,
            values,
        })
    }

    /// Marks the macro cells in which the level is visible; none if it has no density.
    fn occupied(
        &self,
        level: &BakedLevel,
        edge: usize,
        mut cells: OccupiedMacroCells,
    ) -> Option<OccupiedMacroCells> {
        let density = self.values.density.as_ref()?;
        let grid = BlockGrid { nodes: Nodes(self.sizes), edge };
        let [plane, row] = self.values.strides;
        let mut anisotropy = self.values.anisotropy.chunks_exact(self.frame_nodes);
        for (place, frame) in level.table.stored().zip(density.chunks_exact(self.frame_nodes)) {
            let own = anisotropy.next().unwrap_or_default();
            let first = place.map(|block| block * grid.edge);
            let end = [0, 1, 2].map(|axis| (first[axis] + grid.edge).min(grid.nodes.0[axis] - 1));
            if (0..3).any(|axis| first[axis] == end[axis]) {
                // Only the last nodes of an axis, which are not the lowest of any cell.
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

/// The lane of a group's first channel: groups are consecutive, except directional brightness,
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
        // The block itself, or the lowest nodes of a neighbour along each axis with `up`.
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
