//! What a bake would take and give, without baking all of it.
//!
//! Pruning is done for real: it says how many nodes of each level are needed, and costs and bytes follow
//! those. Then two windows along x, an eighth of the box each, are encoded for real, with all levels: where a third of
//! level 0's needed nodes is passed, and where two thirds are. What they take and give a needed node, all of them will,
//! nearly.

use std::time::Instant;

use super::importance::LevelImportance;
use super::report::{BakeReport, StageReport, prune_reports};
use super::stream::Stream;
use super::{
    BakeOptions, Filter, encode_levels, expose, fill_levels, fit_encodings, level_reports,
    metadata, plan, prune_field, tables,
};
use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::codec::container::EncodedLevel;
use crate::model::baked::Group;
use crate::model::field::RadianceField;
use crate::model::grid::{NodeMask, Nodes};

/// Parts of the box along x, of which windows are made.
const PARTS: usize = 16;
/// Parts of a window.
const LENGTH: usize = 2;

/// What a bake would take and give.
#[derive(Debug, Clone)]
pub struct Forecast {
    /// As a bake would report it. Sizes of levels leave tables and metadata out.
    pub report: BakeReport,
    /// Wall-clock time of all stages.
    pub seconds: f64,
    /// Bytes that will be held at once beyond those that were held for the windows: what levels are
    /// compressed to waits until the coarsest is there.
    pub more_memory_bytes: u64,
    /// Bytes that will be read of the input beyond those that were read for the windows.
    pub more_bytes_read: u64,
}

/// Forecasts [`super::bake`].
///
/// # Errors
///
/// Fits are not forecast: they end when nothing is gained any more. Otherwise as a bake's.
pub fn forecast(
    field: &RadianceField,
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<Forecast> {
    options.check()?;
    if options.filter == Filter::Fit {
        return Err(Error::usage(
            "--dry-run does not know when a fit will end; take another filter",
        ));
    }
    let mut clock = Instant::now();
    let mut lap = || std::mem::replace(&mut clock, Instant::now()).elapsed().as_secs_f64();
    let plan = plan(field, options)?;
    let (planes, sizes, mut pruned) = prune_field(field, options, progress)?;
    let mut stages =
        vec![StageReport { name: "prune", seconds: lap(), bytes: field.density.bytes() }];
    let seen = expose(field, options, &mut pruned, progress)?;
    if seen.is_some() {
        stages.push(StageReport { name: "expose", seconds: lap(), bytes: 0 });
    }
    let whole: Vec<u64> = pruned.levels.iter().map(|level| level.needed.count()).collect();
    let all_tables = tables(&pruned, options.block_size)?;
    let mut metadata = metadata(field, options, &sizes, &all_tables, pruned.keeps_mask);
    let reports = prune_reports(&pruned);
    let starts = pruned.levels.first().map_or([0; 2], |finest| window_starts(&finest.needed));
    for (number, level) in pruned.levels.iter_mut().enumerate() {
        level.needed.intersect(&windows(level.needed.nodes(), options.block_size, number, starts)?);
    }
    let part: Vec<u64> = pruned.levels.iter().map(|level| level.needed.count()).collect();
    let times = whole.iter().sum::<u64>() as f64 / part.iter().sum::<u64>().max(1) as f64;
    let part_tables = tables(&pruned, options.block_size)?;
    let more_frames = match (all_tables.first(), part_tables.first()) {
        (Some(all), Some(part)) if options.fill_error.is_some() => all.frames() - part.frames(),
        _ => 0,
    };
    lap();
    let in_turn = plan.is_some_and(|plan| plan.in_turn);
    let (pruned, planes) = (&pruned, &planes);
    let stream = Stream { planes, options, pruned, fitted: None, in_turn, is_part: true };
    let mut more_bytes_read = 0;
    let mut scaled = |bytes: u64| {
        let all = (bytes as f64 * times) as u64;
        more_bytes_read += all.saturating_sub(bytes);
        all
    };
    if let Some(max_error) = options.max_error {
        let bytes = fit_encodings(&stream, max_error, &mut metadata, progress)?;
        stages.push(StageReport { name: "ranges", seconds: lap() * times, bytes: scaled(bytes) });
    }
    let importance = seen.map(|seen| LevelImportance::of_levels(seen, &sizes, options));
    let importance = importance.as_deref().unwrap_or_default();
    let (mut encoded, streamed) =
        encode_levels(&stream, &mut metadata, part_tables, importance, None, progress)?;
    fill_levels(&mut encoded, &mut metadata, pruned, importance, options)?;
    let seconds = lap() * times;
    stages.push(StageReport { name: "encode", seconds, bytes: scaled(streamed.bytes_read) });
    let bytes =
        |level: &EncodedLevel| level.atlases.iter().flatten().map(|a| a.bytes()).sum::<u64>();
    let mut levels = level_reports(&metadata, &[]);
    let mut of_finer = 0.0;
    let mut held = 0;
    for (number, level) in levels.iter_mut().enumerate() {
        let bytes = bytes(&encoded[number]);
        held += bytes;
        // A level that no window meets takes for a node what the next finer one does.
        of_finer = if part[number] > 0 { bytes as f64 / part[number] as f64 } else { of_finer };
        level.stored_bytes = (whole[number] as f64 * of_finer) as u64;
    }
    let output_bytes: u64 = levels.iter().map(|level| level.stored_bytes).sum();
    let more_held = output_bytes.saturating_sub(held);
    // Beyond the room there is for them, they wait in a file.
    let more_held = plan.map_or(more_held, |plan| more_held.min(plan.room.saturating_sub(held)));
    // Filling holds level 0's colours as they are and as they will be.
    let color = metadata.levels[0].encoding(Group::Diffuse);
    let code = color.map_or(0, |encoding| encoding.number.bytes());
    let more_codes = 2 * more_frames * options.block_size.pow(3) * field.color_channels() * code;
    Ok(Forecast {
        seconds: stages.iter().map(|stage| stage.seconds).sum(),
        more_memory_bytes: more_held + more_codes as u64,
        more_bytes_read,
        report: BakeReport {
            output_bytes,
            levels,
            pruned: reports,
            unchanged: false,
            fitted: None,
            free_space_stored: pruned.keeps_mask,
            nonfinite_values: pruned.nonfinite,
            stages,
        },
    })
}

/// The parts of the box with which windows start.
fn window_starts(needed: &NodeMask) -> [usize; 2] {
    let nx = needed.nodes().0[0];
    let mut counts = [0; PARTS];
    for x in 0..nx {
        let of_plane = needed.plane(x).iter().map(|word| u64::from(word.count_ones()));
        counts[x * PARTS / nx] += of_plane.sum::<u64>();
    }
    let all: u64 = counts.iter().sum();
    [1, 2].map(|third| {
        let mut passed = 0;
        let part = counts.iter().position(|count| {
            passed += count;
            3 * passed > third * all
        });
        // One part before it is in the window too, but for that at the box's end.
        part.unwrap_or(0).clamp(1, PARTS - LENGTH + 1) - 1
    })
}

/// The nodes of a level inside the windows, whole rows of blocks. Where level 0 is too short for windows, all of it; no
/// coarser level that is: it is made of everything around the windows, and hardly counts itself.
fn windows(nodes: Nodes, edge: usize, level: usize, starts: [usize; 2]) -> Result<NodeMask> {
    let full = NodeMask::full(nodes);
    let rows = nodes.0[0].div_ceil(edge);
    if rows < PARTS {
        return Ok(if level == 0 { full } else { NodeMask::empty(nodes) });
    }
    let inside = |x: usize| {
        let place = x / edge * PARTS / rows;
        starts.iter().any(|&start| (start..start + LENGTH).contains(&place))
    };
    NodeMask::of_planes(nodes, |x, plane| {
        if inside(x) {
            plane.copy_from_slice(full.plane(x));
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_are_where_needed_nodes_are() {
        let nodes = Nodes([64, 2, 2]);
        let starts = |range: std::ops::Range<usize>| {
            let mut needed = NodeMask::empty(nodes);
            range.for_each(|x| needed.insert([x, 0, 1]));
            window_starts(&needed)
        };
        assert_eq!(starts(0..64), [4, 9]);
        assert_eq!(starts(0..4), [0, 0]);
        assert_eq!(starts(60..64), [14, 14]);
        assert_eq!(starts(0..0), [0, 0]);
        for end in 1..64 {
            let [low, high] = starts(0..end);
            let inside = |x: usize| (low..low + LENGTH).contains(&(x / 4));
            assert!((0..end).any(inside) && low <= high, "{end}");
        }
    }
}
