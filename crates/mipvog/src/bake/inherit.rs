//! Blocks that inherit their colours from the next coarser level.
//!
//! From the second coarsest level to level 0, each block's colours are compared with those that a
//! reader would interpolate from the next coarser level ([`crate::quantize::InheritedColors`]). If
//! no retained node's colour would move by more than the limit, the block's own colours are
//! dropped; its density stays. Coarser levels are decided first, so each block is compared with the
//! colours that readers see. Memory holds the colour codes of one level and of the next coarser
//! one.

use super::importance::LevelImportance;
use crate::base::error::Result;
use crate::base::parallel;
use crate::container::{CompressedRun, EncodedAtlas, EncodedLevel, frames_per_run};
use crate::model::baked::{
    BakedLevel, Codes, ColorLayout, Encoding, GROUPS, Group, LevelMetadata, Metadata, Occupancy,
    Table,
};
use crate::model::grid::{BlockGrid, NodeMask};
use crate::quantize::{Frame, FrameShape, InheritedColors};

/// Number of groups of colour.
const COLORS: usize = Group::COLORS.len();

/// The blocks that may inherit their colours.
#[derive(Debug, Clone, Copy)]
pub struct Inheritance<'a> {
    /// The largest allowed move of a retained node's colour, 0 to 1, at mean importance.
    pub error: f32,
    /// Tables of the levels whose inheriting blocks may inherit; none allows any block.
    pub among: Option<&'a [Table]>,
}

/// Lets blocks of encoded levels inherit their colours. The metadata's errors grow by the largest
/// move. `level_nodes` gives each level's retained nodes, and their importance to cameras.
pub fn inherit_levels<'a>(
    encoded: &mut [EncodedLevel],
    metadata: &mut Metadata,
    inheritance: &Inheritance,
    zstd_level: i32,
    level_nodes: impl Fn(usize) -> (&'a NodeMask, Option<&'a LevelImportance>),
) -> Result<()> {
    let layout = metadata.layout();
    let activated = |encoding: &Encoding| -> Vec<f64> {
        let activation = &metadata.activation;
        encoding.values().map(|value| encoding.decode.activated(value.into(), activation)).collect()
    };
    let mut levels: Vec<LevelMetadata> = metadata.parts().cloned().collect();
    let mut coarser: Option<BakedLevel> = None;
    for number in metadata.parts_in_file() {
        let is_level = number < metadata.levels.len();
        if !levels[number].has_integer_colors() {
            coarser = coarser.filter(|_| !is_level);
            continue;
        }
        let mut own = decode(&encoded[number], &levels[number], layout)?;
        let above = metadata.level_of_part(number) + 1;
        let coarser_metadata =
            levels.get(above).filter(|_| metadata.shares_box_with_coarser(number)).cloned();
        if let (Some(coarser), Some(coarser_metadata)) = (&coarser, &coarser_metadata) {
            let level = &levels[number];
            let interpolated = Group::COLORS.map(|group| {
                InheritedColors::new(
                    level,
                    (coarser_metadata, coarser),
                    group,
                    group.channels(layout),
                )
            });
            let groups = std::array::from_fn(|i| {
                let group = Group::COLORS[i];
                Some(ColorGroup {
                    colors: interpolated[i].as_ref()?,
                    codes: own.atlases[group.index()].as_ref()?,
                    activated: activated(level.encoding(group)?),
                    channels: group.channels(layout),
                })
            });
            let (retained, importance) = level_nodes(number);
            let test = InheritanceTest {
                grid: level.grid(),
                retained,
                importance,
                max_shift: inheritance.error.into(),
            };
            let places: Vec<_> = own.table.stored().collect();
            let among = inheritance.among.map(|tables| &tables[number]);
            let moves = |frame: usize| {
                let place = places[frame];
                let may = among.is_none_or(|table| table.is_inherited(place));
                Ok(may.then(|| test.color_shifts(place, frame, &groups)).flatten())
            };
            let moves = parallel::map(places.len(), moves)?;
            let (table, moved) = inheriting(&own.table, &moves)?;
            let level = &mut levels[number];
            level.blocks_filled = table.inherited();
            for ((group, colors), moved) in Group::COLORS.into_iter().zip(interpolated).zip(moved) {
                let (Some(colors), Some(encoding)) = (colors, level.encoding_mut(group)) else {
                    continue;
                };
                let Some(codes) = own.atlases[group.index()].take() else { continue };
                let shape = shape(encoding, group, layout, table.grid().edge);
                let stored = only_stored(&codes, &table, shape);
                encoding.max_error = encoding.error_after(moved);
                if table.inherited() > 0 {
                    encoded[number].atlases[group.index()] =
                        Some(atlas(shape, &stored, zstd_level)?);
                }
                own.atlases[group.index()] = Some(colors.restore(&table, &stored));
            }
            own.table = table.clone();
            encoded[number].table = table;
        }
        if is_level {
            coarser = Some(own);
        }
    }
    metadata.parts_mut().zip(levels).for_each(|(old, level)| *old = level);
    Ok(())
}

/// A group that blocks may inherit.
struct ColorGroup<'a> {
    colors: &'a InheritedColors<'a>,
    /// The codes stored so far.
    codes: &'a Codes,
    /// The colour of each code.
    activated: Vec<f64>,
    channels: usize,
}

/// The test that a level's blocks must pass to inherit.
struct InheritanceTest<'a> {
    grid: BlockGrid,
    retained: &'a NodeMask,
    importance: Option<&'a LevelImportance>,
    /// Largest allowed move of a retained node's colour if its importance is 1 or unknown.
    max_shift: f64,
}

impl InheritanceTest<'_> {
    /// The largest colour move of each group if the block inherits; none if it exceeds the limit.
    fn color_shifts(
        &self,
        place: [usize; 3],
        frame: usize,
        groups: &[Option<ColorGroup>; COLORS],
    ) -> Option<[f64; COLORS]> {
        let edge = self.grid.edge;
        let nodes = edge.pow(3);
        let sizes = self.grid.nodes.0;
        let mut moves = [0.0f64; COLORS];
        for (group, largest) in groups.iter().zip(&mut moves) {
            let Some(group) = group else { continue };
            let inherited = group.colors.block(place);
            for node in 0..nodes {
                let inside = [node / (edge * edge), node / edge % edge, node % edge];
                let at = [0, 1, 2].map(|axis| place[axis] * edge + inside[axis]);
                if (0..3).any(|axis| at[axis] >= sizes[axis]) || !self.retained.contains(at) {
                    continue;
                }
                let importance = self.importance.map_or(1.0, |level| level.node(sizes, at));
                for channel in 0..group.channels {
                    let code = group.codes.code((frame * group.channels + channel) * nodes + node)
                        as usize;
                    let to = inherited[channel * nodes + node] as usize;
                    let moved = (group.activated[to] - group.activated[code]).abs();
                    if moved * moved * f64::from(importance) > self.max_shift * self.max_shift {
                        return None;
                    }
                    *largest = largest.max(moved);
                }
            }
        }
        Some(moves)
    }
}

/// The table in which the blocks with a move inherit, and the largest moves.
fn inheriting(table: &Table, moves: &[Option<[f64; COLORS]>]) -> Result<(Table, [f64; COLORS])> {
    let mut next = moves.iter();
    let mut largest = [0.0f64; COLORS];
    let mut occupancy = table.occupancy().to_vec();
    for block in occupancy.iter_mut().filter(|block| **block != Occupancy::Empty) {
        if let Some(Some(moves)) = next.next() {
            *block = Occupancy::Inherited;
            largest
                .iter_mut()
                .zip(moves)
                .for_each(|(largest, moved)| *largest = largest.max(*moved));
        }
    }
    Ok((Table::new(table.grid(), occupancy)?, largest))
}

fn shape(encoding: &Encoding, group: Group, layout: ColorLayout, edge: usize) -> FrameShape {
    FrameShape { number: encoding.number, channels: group.channels(layout), edge }
}

/// A level's colours as they were encoded.
fn decode(
    level: &EncodedLevel,
    metadata: &LevelMetadata,
    layout: ColorLayout,
) -> Result<BakedLevel> {
    let mut atlases = [const { None }; GROUPS];
    for group in Group::COLORS {
        let atlas = level.atlases[group.index()].as_ref();
        if let (Some(atlas), Some(encoding)) = (atlas, metadata.encoding(group)) {
            let shape = shape(encoding, group, layout, metadata.block_size);
            atlases[group.index()] = Some(atlas.codes(shape, encoding, level.table.frames())?);
        }
    }
    Ok(BakedLevel { table: level.table.clone(), atlases })
}

/// The codes of the blocks that do not inherit.
fn only_stored(codes: &Codes, table: &Table, shape: FrameShape) -> Codes {
    let kept: Vec<bool> = table.stored().map(|place| !table.is_inherited(place)).collect();
    codes.kept_frames(shape.channels * shape.nodes(), &kept)
}

/// An atlas of these codes.
fn atlas(shape: FrameShape, codes: &Codes, zstd_level: i32) -> Result<EncodedAtlas> {
    let size = shape.channels * shape.nodes();
    let frame = |frame: usize| {
        let codes = codes.slice(frame * size..(frame + 1) * size);
        Frame { codes, retained: vec![true; shape.nodes()].into() }
    };
    let (count, full) = (codes.len() / size, frames_per_run(shape));
    let runs = parallel::map(count.div_ceil(full), |run| {
        let frames: Vec<Frame> = (run * full..count.min((run + 1) * full)).map(frame).collect();
        // Every code must match: codes of don't-care nodes were chosen when the level was encoded.
        CompressedRun::new(shape, &frames, 0, zstd_level)
    })?;
    EncodedAtlas::new(full, runs)
}
