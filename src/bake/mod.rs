//! The whole bake, in order.
//!
//! 1. **Prune** ([`crate::levels::prune`]): one pass over all of density, and one over what of it holds matter, find for every
//!    level the nodes that must be right and the blocks that are kept.
//!    With `min_weight`, what given cameras do not see is dropped too ([`crate::view::render::camera_coverage`]).
//! 2. **Encode**: another pass streams density and colour through all levels at once ([`stream`]),
//!    reading only what needed nodes reach, quantizes each plane as it goes by, and turns slabs of blocks into
//!    compressed runs as they come ([`encode`]). Where an error is asked for instead of bits, a pass like it goes before and
//!    finds what each level holds, lowest to highest ([`ranges`]). What cameras see little of is
//!    stored coarser ([`importance`]). Blocks whose colours the next coarser level says well enough
//!    lose their own, if wanted ([`fill`]).
//! 3. **Write** ([`crate::codec::container`]): metadata, then the levels, coarse to fine.
//!
//! A bound on memory ([`memory`]) changes where things wait, and when.
//!
//! Nothing depends on the number of threads: runs are cut by frame numbers, not by who is free.

mod current;
mod encode;
mod fill;
mod filter;
pub mod fit;
mod forecast;
mod importance;
mod level_rule;
mod max_error;
mod memory;
mod options;
mod origin;
mod preset;
mod ranges;
mod rebake;
mod report;
mod stream;

use std::path::Path;
use std::time::Instant;

use serde_json::json;

pub use current::is_current;
pub use encode::{Check, EncodeOptions, Importance, LevelEncoder, LevelPlanes};
use fill::fill_levels;
pub use filter::Filter;
pub use forecast::{Forecast, forecast};
use importance::LevelImportance;
pub use level_rule::LevelRule;
pub use max_error::MaxErrors;
use memory::{Plan, Room};
pub use options::BakeOptions;
pub use origin::Origin;
pub use preset::Preset;
use ranges::{LevelSpans, encodings_within};
pub use rebake::{Changes, rebake};
use report::prune_reports;
pub use report::{
    BakeReport, FitReport, GroupReport, LevelReport, PruneReport, StageReport, level_reports,
};
use stream::{Stream, Streamed};

use crate::bake::fit::{FitOptions, Fitted, fit};
use crate::base::bytes::Output;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::{Progress, Step};
use crate::codec::container::{self, EncodedLevel, Head};
use crate::codec::quantize::{Bits, color_encoding, density_encoding};
use crate::levels::prune::{self, DensityFilter, Pruned};
use crate::model::baked::{
    ColorSpace, Group, LevelMetadata, Metadata, Occupancy, Table, ViewMetadata,
};
use crate::model::field::{Planes, RadianceField};
use crate::model::grid::{BlockGrid, NodeMask, Nodes};
use crate::view::render::{CameraCoverage, Field, camera_coverage};

/// Bakes `field` into `output`, which is complete but not yet finished when this returns.
/// `origin` goes into the container's provenance.
pub fn bake(
    field: &RadianceField,
    options: &BakeOptions,
    origin: &Origin,
    output: &mut Output,
    progress: &dyn Progress,
) -> Result<BakeReport> {
    options.check()?;
    let mut stages = Vec::new();
    let mut clock = Instant::now();
    let mut stage = |name: &'static str, bytes: u64| {
        stages.push(StageReport { name, seconds: clock.elapsed().as_secs_f64(), bytes });
        clock = Instant::now();
    };

    let plan = plan(field, options)?;
    let (planes, sizes, mut pruned) = prune_field(field, options, progress)?;
    stage("prune", field.density.bytes());
    let seen = expose(field, options, &mut pruned, progress)?;
    if seen.is_some() {
        stage("expose", 0);
    }

    let fitted = match options.filter {
        Filter::Fit => {
            let fitted = fit_levels(field, options, &sizes, &pruned, progress)?;
            stage("fit", 0);
            Some(fitted)
        }
        _ => None,
    };
    if options.bits == Bits::F32 && options.max_error.is_none() {
        // Nothing is lost of what is kept.
        for level in &mut pruned.levels {
            level.needed = level.needed.whole_blocks(options.block_size)?;
        }
    }
    let tables = tables(&pruned, options.block_size)?;
    let mut metadata = metadata(field, options, &sizes, &tables, pruned.keeps_mask);
    if let Some(fitted) = &fitted {
        metadata.level_of_detail = fitted.level_of_detail;
    }
    let stream = Stream {
        planes: &planes,
        options,
        pruned: &pruned,
        fitted: fitted.as_ref(),
        in_turn: plan.is_some_and(|plan| plan.in_turn),
        is_part: false,
    };
    if let Some(max_error) = options.max_error {
        let bytes = fit_encodings(&stream, max_error, &mut metadata, progress)?;
        stage("ranges", bytes);
    }
    let importance = seen.map(|seen| LevelImportance::of_levels(seen, &sizes, options));
    let importance = importance.as_deref().unwrap_or_default();
    let folder = output.written().parent().unwrap_or(Path::new("."));
    let room = plan.map(|plan| Room::new(plan.room, folder)).transpose()?;
    let (mut encoded, streamed) =
        encode_levels(&stream, &mut metadata, tables, importance, room.as_ref(), progress)?;
    fill_levels(&mut encoded, &mut metadata, &pruned, importance, options)?;
    let nonfinite = pruned.nonfinite + planes.take_nonfinite()?.count;
    stage("encode", streamed.bytes_read);
    let digest = origin.digest(&pruned.density_checksums, &streamed.checksums);

    progress.begin(Step::Write, 1);
    let mut resolved = options.to_json();
    // What else could tell one such fit from another.
    if let Some(fitted) = fitted.as_ref().filter(|fitted| fitted.cut_short) {
        let steps: Vec<usize> = fitted.courses.iter().map(|course| course.steps).collect();
        resolved["fit_steps_taken"] = json!(steps);
    }
    let head = Head {
        metadata: &metadata,
        view_mlp: field.view_mlp.as_ref(),
        free_space: field.free_space.as_ref().filter(|_| pruned.keeps_mask),
        provenance: &origin.provenance(&digest, resolved),
        zstd_level: options.zstd_level,
    };
    let entries = container::write(&head, &encoded, output)?;
    progress.advance(Step::Write, 1);
    stage("write", output.length());
    let levels = level_reports(&metadata, &entries);
    Ok(BakeReport {
        output_bytes: output.length(),
        levels,
        pruned: prune_reports(&pruned),
        fitted: fitted.map(|fitted| FitReport {
            level_of_detail: fitted.level_of_detail,
            levels: fitted.courses,
            cut_short: fitted.cut_short,
        }),
        unchanged: false,
        free_space_stored: pruned.keeps_mask,
        nonfinite_values: nonfinite,
        stages,
    })
}

/// How to keep to a bound on memory, if there is one.
fn plan(field: &RadianceField, options: &BakeOptions) -> Result<Option<Plan>> {
    let sizes = options.filter.level_sizes(field.scene.nodes, options.levels);
    options.memory.map(|bound| Plan::new(field, options, &sizes, bound)).transpose()
}

fn fit_levels(
    field: &RadianceField,
    options: &BakeOptions,
    sizes: &[Nodes],
    pruned: &Pruned,
    progress: &dyn Progress,
) -> Result<Fitted> {
    let mut levels = options.filter.trained_levels(&field.scene);
    levels.levels.most = sizes.len();
    levels.level_of_detail = options.level_of_detail();
    let needed: Vec<&NodeMask> = pruned.levels.iter().map(|level| &level.needed).collect();
    let fit_options = FitOptions {
        steps: options.fit_steps,
        seconds: options.fit_seconds,
        cameras: &options.fit_cameras,
    };
    fit(field, levels, &needed, pruned.keeps_mask, &fit_options, &Limits::default(), progress)
}

/// What can be seen of a field's levels, and what it is read by.
fn prune_field<'a>(
    field: &'a RadianceField,
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<(Planes<'a>, Vec<Nodes>, Pruned)> {
    let sizes = options.filter.level_sizes(field.scene.nodes, options.levels);
    let planes = prune::masked_planes(field, options.nonfinite)?;
    let (filter, activation) = (options.filter, &field.scene.activation);
    let density_filter = filter
        .filters_density()
        .then(|| DensityFilter { kernel: filter.kernel(), matter: filter.matter(activation) });
    let pruned = prune::prune(&planes, &sizes, density_filter, options.alpha_threshold, progress)?;
    Ok((planes, sizes, pruned))
}

/// What given cameras see, if anything depends on it; drops what they do not, where it is to be dropped.
fn expose(
    field: &RadianceField,
    options: &BakeOptions,
    pruned: &mut Pruned,
    progress: &dyn Progress,
) -> Result<Option<CameraCoverage>> {
    if !options.sees() {
        return Ok(None);
    }
    let unbaked = Field::trained(field, None, &Limits::default())?;
    let least = options.min_weight.unwrap_or(1.0);
    let seen = camera_coverage(&unbaked, &options.seen_from, least, progress)?;
    if options.min_weight.is_some() {
        pruned.keep_cells(&seen.cells)?;
    }
    Ok(Some(seen))
}

fn tables(pruned: &Pruned, edge: usize) -> Result<Vec<Table>> {
    let occupancy = |kept: bool| if kept { Occupancy::Stored } else { Occupancy::Empty };
    let table = |needed: &NodeMask| {
        let blocks = needed.blocks(edge)?.into_iter().map(occupancy).collect();
        Table::new(BlockGrid { nodes: needed.nodes(), edge }, blocks)
    };
    pruned.levels.iter().map(|level| table(&level.needed)).collect()
}

fn metadata(
    field: &RadianceField,
    options: &BakeOptions,
    sizes: &[Nodes],
    tables: &[Table],
    free_space: bool,
) -> Metadata {
    let scene = &field.scene;
    let features = field.color_channels() - 3;
    let (blend, step_rule) = options.filter.rules();
    let levels = options.filter.levels(scene);
    let density = |level: usize| {
        density_encoding(options.bits, levels.density_domain(level), &scene.activation)
    };
    let color = color_encoding(options.bits);
    let level = |(number, (nodes, table)): (usize, (&Nodes, &Table))| {
        let has_density = number == 0 || options.filter.filters_density();
        LevelMetadata {
            dimensions: nodes.0,
            block_size: options.block_size,
            blocks_stored: table.frames(),
            blocks_filled: 0,
            density: has_density.then(|| density(number)),
            diffuse: Some(color.clone()),
            features: (features > 0).then(|| color.clone()),
        }
    };
    Metadata {
        bounds: scene.bounds,
        activation: scene.activation,
        march: scene.march,
        step_rule,
        level_of_detail: options.level_of_detail(),
        blend,
        background: scene.background,
        color_space: ColorSpace::SrgbDisplay,
        features,
        view: field.view_mlp.as_ref().map(|network| ViewMetadata {
            widths: network.widths(),
            frequencies: network.frequencies,
            input: network.input,
        }),
        free_space,
        alpha_threshold: options.alpha_threshold,
        filter: options.filter.name().to_owned(),
        levels: sizes.iter().zip(tables).enumerate().map(level).collect(),
    }
}

/// Makes the levels' encodings those with the fewest bits within an error, by what the levels hold.
/// Returns the bytes that were read.
fn fit_encodings(
    stream: &Stream,
    max_errors: MaxErrors,
    metadata: &mut Metadata,
    progress: &dyn Progress,
) -> Result<u64> {
    let Metadata { levels, activation, features, .. } = metadata;
    let spans: Vec<LevelSpans> = levels
        .iter()
        .zip(&stream.pruned.levels)
        .map(|(level, pruned)| LevelSpans::new(level, &pruned.needed, activation, *features))
        .collect();
    let put = |level: usize, x, channel, plane: &[f32]| {
        spans[level].put(x, channel, plane);
        Ok(())
    };
    let streamed = stream.run(Step::Ranges, progress, put, |_, _| Ok(()))?;
    // The pass that encodes finds the same again, and counts it.
    stream.planes.take_nonfinite()?;
    let found = encodings_within(max_errors, levels, activation, &spans)?;
    for (level, [density, diffuse, features]) in levels.iter_mut().zip(found) {
        (level.density, level.diffuse, level.features) = (density, diffuse, features);
    }
    Ok(streamed.bytes_read)
}

/// Streams the field through all levels and encodes them; `importance` of each level may be missing. Errors in
/// the metadata grow by what coarsening moves values.
fn encode_levels(
    stream: &Stream,
    metadata: &mut Metadata,
    tables: Vec<Table>,
    importance: &[LevelImportance],
    room: Option<&Room>,
    progress: &dyn Progress,
) -> Result<(Vec<EncodedLevel>, Streamed)> {
    let encode_options = EncodeOptions {
        level: 0,
        features: metadata.features,
        activation: metadata.activation,
        zstd_level: stream.options.zstd_level,
        check: None,
        room,
        importance: None,
    };
    let mut encoders = Vec::new();
    let levels = metadata.levels.iter().zip(&stream.pruned.levels).zip(tables);
    for (number, ((level, pruned), table)) in levels.enumerate() {
        let encodings = Group::ALL.map(|group| level.encoding(group));
        let coarseness = stream.options.coarseness;
        let importance = importance.get(number).filter(|_| coarseness > 0.0);
        let importance = importance.map(|level| level.importance(coarseness));
        let encode_options = EncodeOptions { level: number, importance, ..encode_options };
        encoders.push(LevelEncoder::new(table, &pruned.needed, encodings, encode_options));
    }
    let planes: Vec<_> = encoders.iter().map(LevelEncoder::planes).collect();
    let put = |level: usize, x, channel, plane: &[f32]| planes[level].put(x, channel, plane);
    let streamed =
        stream.run(Step::Encode, progress, put, |level, planes| encoders[level].take(planes))?;
    for (level, encoder) in metadata.levels.iter_mut().zip(&encoders) {
        for (group, error) in Group::ALL.into_iter().zip(encoder.max_errors()) {
            if let (Some(encoding), Some(error)) = (level.encoding_mut(group), error) {
                encoding.max_error = error;
            }
        }
    }
    Ok((encoders.into_iter().map(LevelEncoder::finish).collect::<Result<_>>()?, streamed))
}
