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

/// The result of a bake and its cost.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct BakeReport {
    /// Size of the container in bytes.
    pub output_bytes: u64,
    /// Levels, fine to coarse.
    pub levels: Vec<LevelReport>,
    /// Shells of levels from 1 on, around the next smaller box; absent without nested boxes.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub shells: Vec<LevelReport>,
    /// Pruning of each level, fine to coarse.
    pub pruned: Vec<PruneReport>,
    /// True if an identical container already existed, so nothing was written.
    pub unchanged: bool,
    /// Report of the fit, if levels were fitted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fitted: Option<FitReport>,
    /// True if the container stores the free-space mask.
    pub free_space_stored: bool,
    /// Number of values that were not finite and were treated as empty.
    pub nonfinite_values: u64,
    /// Quality chosen for the requested size.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub chosen: Option<Chosen>,
    /// Dropped islands, if dropping was requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub islands: Option<IslandReport>,
    /// Stages of the work, in order.
    pub stages: Vec<StageReport>,
}

/// The connected components of level 0's visible nodes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct IslandReport {
    /// Number of components.
    pub components: u64,
    /// Number of dropped components, which are now empty.
    pub dropped: u64,
    /// Number of visible nodes in the dropped components.
    pub nodes: u64,
}

impl BakeReport {
    /// Sets the size of the file after bytes were added or removed before its levels.
    pub fn set_output_bytes(&mut self, bytes: u64) {
        for level in self.levels.iter_mut().chain(&mut self.shells) {
            level.prefix_bytes =
                level.prefix_bytes.map(|prefix| prefix + bytes - self.output_bytes);
        }
        self.output_bytes = bytes;
    }

    /// The report of a bake whose container was up to date.
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
    /// Fitted rule that picks the level of a sample.
    pub level_of_detail: LevelOfDetail,
    /// Fitted levels, fine to coarse.
    pub levels: Vec<FittedLevel>,
    /// True if the fit ended early, at its time limit or on request.
    pub cut_short: bool,
}

impl FitReport {
    /// Renumbers the levels after the `dropped` finest ones were removed.
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
    /// Index of the level; 0 is the finest.
    pub level: usize,
    /// Box of the level, including its shell, in world units.
    pub bounds: Bounds,
    /// Nodes along x, y and z.
    pub dimensions: [usize; 3],
    /// Nodes along each edge of a block.
    pub block_size: usize,
    /// Number of blocks, stored or empty.
    pub blocks_total: usize,
    /// Number of stored blocks, including inherited ones.
    pub blocks_stored: usize,
    /// Number of inherited blocks, whose colours come from the next coarser level.
    pub blocks_filled: usize,
    /// Bytes of the block table and the codes before compression.
    pub raw_bytes: u64,
    /// Bytes of the level's chunks in the file.
    pub stored_bytes: u64,
    /// Bytes from the start of the file that suffice to render the level; null in a forecast.
    pub prefix_bytes: Option<u64>,
    /// Proved bound on the error of opacity over one interval at retained nodes; opacity ranges
    /// from 0 to 1. Null if the level stores no density or in a forecast that did not measure it.
    pub max_opacity_error: Option<f32>,
    /// Proved bound on the error of colours and features at retained nodes; colours range from 0 to
    /// 1. Null if the level stores none or in a forecast that did not measure it.
    pub max_color_error: Option<f32>,
    /// Groups of the level, density first.
    pub groups: Vec<GroupReport>,
}

/// Storage of one group of channels in a level.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct GroupReport {
    /// Name of the group.
    pub group: &'static str,
    /// Bits per code: `1` to `16`, `f16` or `f32`; null if a forecast did not measure the level.
    pub bits: Option<String>,
    /// Proved bound on the error at retained nodes whose values were not moved, as opacity or
    /// colour from 0 to 1; null if a forecast did not measure the level.
    pub max_error: Option<f32>,
    /// Proved bound on the error of values that were moved because of low importance, as colour
    /// from 0 to 1; null if no value was moved, or if the effect of moving alone is unknown.
    pub moved_error: Option<f32>,
}

/// The error bounds before colours were moved.
struct Held(Option<MaxErrors>);

impl Held {
    /// Reads the bounds from the options of a provenance.
    fn of(options: &Value) -> Self {
        let moves = |name: &str| options[name].as_f64().is_some_and(|codes| codes > 0.0);
        let is_moved = moves("coarseness") || moves("nearby_coarseness");
        Self(MaxErrors::from_json(&options["max_error"]).filter(|_| is_moved))
    }

    /// The error of values that were not moved, and of moved ones.
    fn errors(&self, level: usize, group: Group, encoding: &Encoding) -> (f32, Option<f32>) {
        let stated = encoding.max_error;
        match self.0.map(|errors| errors.of_level(level).of(group)) {
            Some(held) if held < stated && group.is_color() => (held, Some(stated)),
            _ => (stated, None),
        }
    }
}

/// The nodes of a level by visibility.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct PruneReport {
    /// Index of the level; 0 is the finest.
    pub level: usize,
    /// Number of nodes of the grid.
    pub nodes: u64,
    /// Number of nodes whose own opacity exceeds the threshold.
    pub opaque_nodes: u64,
    /// Number of opaque nodes that the free-space mask removes.
    pub masked_nodes: u64,
    /// Number of retained nodes: the corners of visible cells.
    pub needed_nodes: u64,
}

/// One stage of the work.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct StageReport {
    /// Name of the stage.
    pub name: &'static str,
    /// Wall-clock time in seconds.
    pub seconds: f64,
    /// Bytes read from the input or written.
    pub bytes: u64,
}

/// The finished stages, and the clock of the current one.
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

    /// Ends the current stage and starts the next one.
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

    /// Restarts the clock of the current stage; the time so far counts for no stage.
    pub(super) fn restart(&mut self) {
        self.clock = Instant::now();
    }
}

/// The pruning of each level, without the `dropped` finest levels.
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

/// The levels of a container, fine to coarse, from its directory, its metadata and the options of
/// its provenance.
pub fn level_reports(metadata: &Metadata, entries: &[Entry], options: &Value) -> Vec<LevelReport> {
    part_reports(metadata, 0..metadata.levels.len(), entries, options)
}

/// The shells of a container, that of level 1 first; see [`level_reports`].
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
