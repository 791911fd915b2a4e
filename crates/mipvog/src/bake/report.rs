//! Reports of bakes.

use std::ops::Range;
use std::time::Instant;

use serde::Serialize;
use serde_json::Value;

use super::MaxErrors;
use super::fit::{Fitted, FittedLevel};
use super::max_bytes::Chosen;
use crate::container::layout::Entry;
use crate::levels::{Visible, VisibleLevel};
use crate::model::baked::{Encoding, Group, LevelMetadata, LevelOfDetail, Metadata};
use crate::model::grid::Bounds;
use crate::quantize::Bits;

/// The result of a bake, and its cost.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct BakeReport {
    /// Bytes of the container.
    pub output_bytes: u64,
    /// Fine to coarse.
    pub levels: Vec<LevelReport>,
    /// What levels from 1 on show around the next smaller box; absent without nested boxes.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub shells: Vec<LevelReport>,
    /// Fine to coarse, one for each of `levels`.
    pub pruned: Vec<PruneReport>,
    /// True if the container already existed, and is the one that this bake would have written.
    pub unchanged: bool,
    /// The report of the fit, if there was one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fitted: Option<FitReport>,
    /// True if the free-space mask had to be stored.
    pub free_space_stored: bool,
    /// Number of values that were not finite and were treated as empty.
    pub nonfinite_values: u64,
    /// The quality that was chosen to fit a requested size.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub chosen: Option<Chosen>,
    /// The islands that were dropped, if requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub islands: Option<IslandReport>,
    /// In the order of the work.
    pub stages: Vec<StageReport>,
}

/// The connected parts of level 0.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct IslandReport {
    /// All of them.
    pub components: u64,
    /// Those that became empty.
    pub dropped: u64,
    /// Their visible nodes.
    pub nodes: u64,
}

impl BakeReport {
    /// Of a bake that had nothing to do.
    pub fn unchanged(
        output_bytes: u64,
        levels: Vec<LevelReport>,
        shells: Vec<LevelReport>,
    ) -> Self {
        Self {
            output_bytes,
            levels,
            shells,
            pruned: Vec::new(),
            unchanged: true,
            fitted: None,
            free_space_stored: false,
            nonfinite_values: 0,
            chosen: None,
            islands: None,
            stages: Vec::new(),
        }
    }
}

/// The report of a fit.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct FitReport {
    /// The rule of levels that the fit found.
    pub level_of_detail: LevelOfDetail,
    /// The fitted levels, fine to coarse.
    pub levels: Vec<FittedLevel>,
    /// True if it ended early, at its time limit or on request.
    pub cut_short: bool,
}

impl FitReport {
    /// Renumbers levels for a container without this many of the finest ones.
    pub(super) fn without_finest(fitted: Fitted, dropped: usize) -> Self {
        let Fitted { level_of_detail, mut levels, cut_short, .. } = fitted;
        levels.retain(|fitted| fitted.level >= dropped);
        levels.iter_mut().for_each(|fitted| fitted.level -= dropped);
        Self { level_of_detail, levels, cut_short }
    }
}

/// One level of a container.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct LevelReport {
    /// 0 is the finest.
    pub level: usize,
    /// The box that the level spans, with its shell.
    pub bounds: Bounds,
    /// Nodes along x, y and z.
    pub dimensions: [usize; 3],
    /// Nodes along a block's edge.
    pub block_size: usize,
    /// Blocks of the level.
    pub blocks_total: usize,
    /// Stored blocks, including inherited ones.
    pub blocks_stored: usize,
    /// Blocks that inherit their colours from the next coarser level.
    pub blocks_filled: usize,
    /// Bytes of table and codes before compression.
    pub raw_bytes: u64,
    /// Bytes of the level's chunks.
    pub stored_bytes: u64,
    /// Leading bytes of the file that suffice to render the level; none in a forecast.
    pub prefix_bytes: Option<u64>,
    /// Proved bound on the error of opacity at retained nodes.
    pub max_opacity_error: Option<f32>,
    /// Proved bound on the error of colours and features at retained nodes.
    pub max_color_error: Option<f32>,
    /// The level's groups, density first.
    pub groups: Vec<GroupReport>,
}

/// Storage of one group of a level.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct GroupReport {
    /// Its name.
    pub group: &'static str,
    /// Bits per code: 1 to 16, f16 or f32; none if a forecast did not measure the level.
    pub bits: Option<String>,
    /// Proved bound on the error at retained nodes whose values were not moved; none if a forecast
    /// did not measure the level.
    pub max_error: Option<f32>,
    /// Proved bound on the error of values that were moved because they hardly show; none if there
    /// are none, or if the part of the error that is due to moves is unknown.
    pub moved_error: Option<f32>,
}

/// The errors that values were held to, in a container whose colours were moved after that.
struct Held(Option<MaxErrors>);

impl Held {
    /// By the options of a provenance.
    fn of(options: &Value) -> Self {
        let moves = |name: &str| options[name].as_f64().is_some_and(|codes| codes > 0.0);
        let is_moved = moves("coarseness") || moves("nearby_coarseness");
        Self(MaxErrors::from_json(&options["max_error"]).filter(|_| is_moved))
    }

    /// The error of values that were not moved, and of those that were.
    fn errors(&self, level: usize, group: Group, encoding: &Encoding) -> (f32, Option<f32>) {
        let stated = encoding.max_error;
        match self.0.map(|errors| errors.of_level(level).of(group)) {
            Some(held) if held < stated && group.is_color() => (held, Some(stated)),
            _ => (stated, None),
        }
    }
}

/// The nodes of a level, sorted by visibility.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct PruneReport {
    /// 0 is the finest.
    pub level: usize,
    /// Nodes of the grid.
    pub nodes: u64,
    /// Nodes whose own opacity is above the threshold.
    pub opaque_nodes: u64,
    /// Opaque nodes that the free-space mask drops.
    pub masked_nodes: u64,
    /// Nodes that are kept: the corners of visible cells.
    pub needed_nodes: u64,
}

/// One stage of the work.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct StageReport {
    /// Its name.
    pub name: &'static str,
    /// Wall-clock time.
    pub seconds: f64,
    /// Bytes read from the input, or written.
    pub bytes: u64,
}

/// The stages so far, and the clock of the one at work.
#[derive(Debug)]
pub(super) struct Stages {
    pub(super) list: Vec<StageReport>,
    clock: Instant,
}

impl Stages {
    /// Starts the first stage.
    pub(super) fn start() -> Self {
        Self { list: Vec::new(), clock: Instant::now() }
    }

    /// Ends a stage, and starts the next one.
    pub(super) fn end(&mut self, name: &'static str, bytes: u64) {
        let seconds = self.clock.elapsed().as_secs_f64();
        self.list.push(StageReport { name, seconds, bytes });
        self.clock = Instant::now();
    }

    /// Merges stages of the same name into the first one.
    pub(super) fn join_same(&mut self) {
        let mut joined: Vec<StageReport> = Vec::new();
        for stage in self.list.drain(..) {
            match joined.iter_mut().find(|other| other.name == stage.name) {
                Some(same) => {
                    same.seconds += stage.seconds;
                    same.bytes += stage.bytes;
                }
                None => joined.push(stage),
            }
        }
        self.list = joined;
    }

    /// Starts the stage at work anew: the time until now belongs to none.
    pub(super) fn restart(&mut self) {
        self.clock = Instant::now();
    }
}

/// The dropped nodes of each level, without this many of the finest levels.
pub(super) fn prune_reports(visible: &Visible, dropped: usize) -> Vec<PruneReport> {
    let report = |(level, visible): (usize, &VisibleLevel)| PruneReport {
        level,
        nodes: visible.retained.nodes().count() as u64,
        opaque_nodes: visible.opaque_nodes,
        masked_nodes: visible.masked_nodes,
        needed_nodes: visible.retained.count(),
    };
    visible.levels.iter().skip(dropped).enumerate().map(report).collect()
}

/// The levels of a container, from its directory, its metadata and the options of its provenance.
/// Fine to coarse.
pub fn level_reports(metadata: &Metadata, entries: &[Entry], options: &Value) -> Vec<LevelReport> {
    part_reports(metadata, 0..metadata.levels.len(), entries, options)
}

/// The same of its shells, that of level 1 first.
pub fn shell_reports(metadata: &Metadata, entries: &[Entry], options: &Value) -> Vec<LevelReport> {
    part_reports(metadata, metadata.levels.len()..metadata.parts().count(), entries, options)
}

fn part_reports(
    metadata: &Metadata,
    parts: Range<usize>,
    entries: &[Entry],
    options: &Value,
) -> Vec<LevelReport> {
    let held = Held::of(options);
    let report = |(number, level): (usize, &LevelMetadata)| {
        let own = entries.iter().filter(|entry| entry.level == u32::try_from(number).ok());
        let grid = level.grid();
        let values = |group: Group| {
            level
                .encoding(group)
                .map_or(0, |encoding| group.channels(metadata.layout()) * encoding.number.bytes())
        };
        let group = |group: Group| {
            let encoding = level.encoding(group)?;
            let bits = Bits::of(encoding).to_string();
            let (max_error, moved_error) = held.errors(number, group, encoding);
            let max_error = Some(max_error);
            Some(GroupReport { group: group.name(), bits: Some(bits), max_error, moved_error })
        };
        let colors = Group::COLORS.into_iter().filter_map(|group| {
            level.encoding(group).map(|encoding| held.errors(number, group, encoding).0)
        });
        let opacities = [level.density.as_ref(), level.anisotropy.as_ref()];
        let blocks = |group: Group| {
            level.blocks_stored - if group.is_color() { level.blocks_filled } else { 0 }
        };
        let values_per_node: usize =
            Group::ALL.into_iter().map(|group| blocks(group) * values(group)).sum();
        LevelReport {
            level: metadata.level_of_part(number),
            bounds: metadata.level_bounds(metadata.level_of_part(number)),
            dimensions: level.dimensions,
            block_size: level.block_size,
            blocks_total: grid.total(),
            blocks_stored: level.blocks_stored,
            blocks_filled: level.blocks_filled,
            raw_bytes: (grid.total() + grid.block_nodes() * values_per_node) as u64,
            stored_bytes: own.clone().map(|entry| entry.length).sum(),
            prefix_bytes: own.map(|entry| entry.prefix).max(),
            max_opacity_error: opacities
                .into_iter()
                .flatten()
                .map(|encoding| encoding.max_error)
                .reduce(|density, anisotropy| density + anisotropy),
            max_color_error: colors.reduce(f32::max),
            groups: Group::ALL.into_iter().filter_map(group).collect(),
        }
    };
    metadata.parts().enumerate().skip(parts.start).take(parts.len()).map(report).collect()
}
