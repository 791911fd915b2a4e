//! A forecast of a bake's time, memory and bytes, without baking all of it.
//!
//! The search for visible nodes runs in full, because costs and bytes depend on the number of
//! retained nodes. A scene of up to [`SMALL`] nodes is then encoded whole. For a larger scene, two
//! windows along x are encoded with all levels. Each is an eighth of the box. They start behind one
//! third and two thirds of level 0's retained nodes. The forecast assumes that all retained nodes
//! cost as much as those in the windows. The container is not written. Its head and its tables are
//! encoded and counted, then discarded.

use super::Origin;
use super::levels::FilteredLevels;
use super::memory::MemoryPlan;
use super::prepare::Prepared;
use super::report::{Stages, level_reports, prune_reports};
use super::run::{Precision, packing};
use super::{BakeOptions, BakeReport, plan};
use crate::base::bytes::{ByteSink, WriterSink};
use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::container::{self, EncodedAtlas, EncodedLevel, Head};
use crate::levels::Visible;
use crate::model::baked::{GROUPS, Group, Metadata};
use crate::model::field::RadianceField;
use crate::model::grid::{NodeMask, Nodes};

/// Scenes of up to this many nodes are encoded whole, in a fraction of a second. Levels of small
/// scenes are too short for windows, and coarser levels store more per node than level 0.
const SMALL: usize = 1 << 22;
/// Parts of the box along x. Windows consist of whole parts.
const PARTS: usize = 16;
/// Parts of a window.
const LENGTH: usize = 2;

/// The cost and the result of a bake that was not done.
#[derive(Debug, Clone)]
pub struct Forecast {
    /// The report of the bake. Sizes of levels exclude tables; the size of the output includes
    /// them.
    pub report: BakeReport,
    /// Wall-clock time of all stages; none if levels are fitted, because a fit ends when it stops
    /// gaining.
    pub seconds: Option<f64>,
    /// Steps of a fit in all, at most.
    pub fit_steps: Option<usize>,
    /// The least bound on memory that the bake would keep to; none if it has no bound.
    pub least_memory_bytes: Option<u64>,
    /// Bytes that the bake holds at once beyond those of the windows: compressed runs wait for the
    /// coarsest level. None if levels are fitted: a fit holds pictures and whole levels.
    pub more_memory_bytes: Option<u64>,
    /// Peak memory of the bake, if windows were measured: the rest is computed, not measured. None
    /// for a scene that was encoded whole, and if whole levels are held.
    pub most_memory_bytes: Option<u64>,
    /// Bytes of the input that the bake reads beyond those that the windows read.
    pub more_bytes_read: u64,
}

/// Forecasts [`super::bake`].
///
/// # Errors
///
/// The errors of a bake, and a search for a number of bytes, which cannot be forecast.
pub fn forecast(
    field: &RadianceField,
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<Forecast> {
    if !field.shells.is_empty() {
        return super::nested::forecast(field, options, progress);
    }
    let is_small = field.scene.nodes.count() <= SMALL;
    forecast_by(field, options, is_small, progress)
}

/// The forecast, from the whole scene or from windows.
fn forecast_by(
    field: &RadianceField,
    options: &BakeOptions,
    whole_scene: bool,
    progress: &dyn Progress,
) -> Result<Forecast> {
    options.check()?;
    field.check()?;
    if options.max_bytes.is_some() {
        let expected = "no bound on bytes: the search for errors is the bake";
        return Err(Error::invalid_option("max_bytes", "a bound", expected));
    }
    let mut stages = Stages::start();
    let memory = MemoryPlan::of_bake(field, options)?;
    let Prepared { planes, mut visible, importance, .. } =
        Prepared::new(field, options, &mut stages, progress)?;
    if options.keeps_blocks() {
        visible.keep_blocks(options.block_size)?;
    }
    let whole: Vec<u64> = visible.levels.iter().map(|level| level.retained.count()).collect();
    let all_tables = plan::tables(&visible, options.block_size)?;
    let mut metadata = plan::metadata(field, options, &visible, &all_tables);
    let pruned = prune_reports(&visible, 0);
    let starts = visible.levels.first().map_or([0; 2], |finest| window_starts(&finest.retained));
    let windowed = visible.levels.iter_mut().enumerate().filter(|_| !whole_scene);
    for (number, level) in windowed {
        let nodes = level.retained.nodes();
        level.retained.intersect(&windows(nodes, options.block_size, number, starts)?);
    }
    let part: Vec<u64> = visible.levels.iter().map(|level| level.retained.count()).collect();
    let times = whole.iter().sum::<u64>() as f64 / part.iter().sum::<u64>().max(1) as f64;
    let part_tables = plan::tables(&visible, options.block_size)?;
    let more_frames = match (all_tables.first(), part_tables.first()) {
        (Some(all), Some(part)) if options.fill_error.is_some() => all.frames() - part.frames(),
        _ => 0,
    };
    stages.restart();
    let measured = stages.list.len();
    let source = FilteredLevels {
        planes: &planes,
        options,
        visible: &visible,
        fitted: None,
        pipelined: memory.pipelined,
        is_window: true,
    };
    let packing = packing(options, Precision::of(options), &source, &visible, &importance, None);
    let (encoded, _) = packing.run(&mut metadata, part_tables, &mut stages, progress)?;
    let mut more_bytes_read = 0;
    for stage in &mut stages.list[measured..] {
        let all = (stage.bytes as f64 * times) as u64;
        more_bytes_read += all.saturating_sub(stage.bytes);
        (stage.seconds, stage.bytes) = (stage.seconds * times, all);
    }
    let bytes = |level: &EncodedLevel| -> u64 {
        level.atlases.iter().flatten().map(EncodedAtlas::bytes).sum()
    };
    let mut levels = level_reports(&metadata, &[], &options.to_json());
    let mut bytes_per_node = 0.0;
    let mut held = 0;
    for (number, level) in levels.iter_mut().enumerate() {
        let bytes = bytes(&encoded[number]);
        held += bytes;
        // A level that no window overlaps takes as much per node as the next finer one.
        if part[number] > 0 {
            bytes_per_node = bytes as f64 / part[number] as f64;
        }
        if part[number] == 0 && options.max_error.is_some() {
            // Its encodings depend on its values, which were not read.
            (level.max_opacity_error, level.max_color_error) = (None, None);
            level.groups.iter_mut().for_each(|g| (g.bits, g.max_error) = (None, None));
        }
        level.stored_bytes = (whole[number] as f64 * bytes_per_node) as u64;
    }
    let head = (field, options, &metadata, &visible);
    let output_bytes = if whole_scene {
        container_bytes(head, &encoded)?
    } else {
        let empty = |table| EncodedLevel { table, atlases: [const { None }; GROUPS] };
        let empty: Vec<EncodedLevel> = all_tables.into_iter().map(empty).collect();
        container_bytes(head, &empty)? + levels.iter().map(|level| level.stored_bytes).sum::<u64>()
    };
    // Runs that find no room in memory wait in a file.
    let more_held = output_bytes.min(memory.run_bytes).saturating_sub(held);
    // Inheritance holds the codes of level 0's colours twice: before and after.
    let color = metadata.levels.first().and_then(|level| level.encoding(Group::Diffuse));
    let code = color.map_or(0, |encoding| encoding.number.bytes());
    let more_codes = 2 * more_frames * options.block_size.pow(3) * field.color_channels() * code;
    let is_fitted = options.filter.is_fitted();
    let coarser = metadata.levels.len().saturating_sub(1);
    Ok(Forecast {
        seconds: (!is_fitted).then(|| stages.list.iter().map(|stage| stage.seconds).sum()),
        fit_steps: is_fitted.then_some(if coarser > 0 { options.fit_steps } else { 0 }),
        more_memory_bytes: (!is_fitted).then_some(more_held + more_codes as u64),
        more_bytes_read,
        least_memory_bytes: MemoryPlan::least(field, options),
        most_memory_bytes: MemoryPlan::most(field, options, output_bytes).filter(|_| !whole_scene),
        report: BakeReport {
            output_bytes,
            levels,
            shells: Vec::new(),
            pruned,
            unchanged: false,
            fitted: None,
            free_space_stored: visible.mask_is_required,
            nonfinite_values: visible.nonfinite.count,
            chosen: None,
            islands: None,
            stages: stages.list,
        },
    })
}

/// Bytes of a container of these levels.
fn container_bytes(
    (field, options, metadata, visible): (&RadianceField, &BakeOptions, &Metadata, &Visible),
    levels: &[EncodedLevel],
) -> Result<u64> {
    let provenance = Origin::of_arrays().provenance(&[0; 32], options.to_json());
    let head = Head {
        metadata,
        view_mlp: field.network(),
        free_space: field.free_space.as_ref().filter(|_| visible.mask_is_required),
        provenance: &provenance,
        others: &[],
        zstd_level: options.zstd_level,
        limits: &options.limits,
    };
    let mut count = WriterSink::new(std::io::sink());
    container::write(&head, levels, &mut count)?;
    Ok(count.length())
}

/// The parts of the box that the windows start with.
fn window_starts(retained: &NodeMask) -> [usize; 2] {
    let nx = retained.nodes().0[0];
    let mut counts = [0; PARTS];
    for x in 0..nx {
        let bits = retained.plane(x).iter().map(|word| u64::from(word.count_ones()));
        counts[x * PARTS / nx] += bits.sum::<u64>();
    }
    let all: u64 = counts.iter().sum();
    [1, 2].map(|third| {
        let mut passed = 0;
        let part = counts.iter().position(|count| {
            passed += count;
            3 * passed > third * all
        });
        // The part before it is in the window too, except at the end of the box.
        part.unwrap_or(0).clamp(1, PARTS - LENGTH + 1) - 1
    })
}

/// The nodes of a level inside the windows, in whole rows of blocks. If level 0 is too short for
/// windows, all of it is inside. A coarser level that is too short is outside: it would read
/// everything around the windows, and hardly counts itself.
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
    use crate::base::progress::Silent;

    /// Waves that repeat along x.
    fn waves() -> RadianceField {
        let nodes = [64, 20, 24];
        let [_, ny, nz] = nodes;
        let place = |at: usize| [at / (ny * nz), at / nz % ny, at % nz].map(|at| at as f32);
        let count = nodes.iter().product::<usize>();
        let density = (0..count).map(|at| {
            let [x, y, z] = place(at);
            6.0 * libm::sinf(0.8 * x) * libm::cosf(0.7 * y + 0.3 * z)
        });
        let color = (0..3 * count).map(|at| libm::sinf(at as f32));
        RadianceField::builder(nodes, density.collect(), color.collect()).build().expect("a field")
    }

    #[test]
    fn windows_forecast_what_the_whole_scene_takes() {
        let field = waves();
        let errors = Some(super::super::MaxErrors::from(0.02));
        for max_error in [None, errors] {
            let options = BakeOptions { block_size: 4, max_error, ..BakeOptions::default() };
            let by = |whole| forecast_by(&field, &options, whole, &Silent).expect("a forecast");
            let (whole, windows) = (by(true).report, by(false).report);
            let ratio = windows.output_bytes as f64 / whole.output_bytes as f64;
            assert!((0.85..1.15).contains(&ratio), "{ratio}");
            // Windows skip short levels, whose encodings depend on their values.
            for level in &windows.levels {
                let is_unknown = max_error.is_some() && level.level > 0;
                assert!(level.groups.iter().all(|group| group.bits.is_none() == is_unknown));
                assert_eq!(level.max_color_error.is_none(), is_unknown);
            }
            assert!(whole.levels.iter().all(|level| level.max_color_error.is_some()));
        }
    }

    #[test]
    fn windows_are_where_retained_nodes_are() {
        let nodes = Nodes([64, 2, 2]);
        let starts = |range: std::ops::Range<usize>| {
            let mut retained = NodeMask::empty(nodes);
            range.for_each(|x| retained.insert([x, 0, 1]));
            window_starts(&retained)
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
