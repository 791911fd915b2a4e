//! A bake from a trained field to a container.

use std::path::Path;

use serde_json::{Value, json};

use super::fit::{FitOptions, Fitted, fit};
use super::importance::LevelImportance;
use super::inherit::Inheritance;
use super::levels::FilteredLevels;
use super::max_bytes::{self, Attempt, Chosen};
use super::memory::MemoryPlan;
use super::pack::Packing;
use super::prepare::Prepared;
use super::quality::{errors_of, nearby_coarseness_of};
use super::ranges::EncodingChoice;
use super::report::{Stages, level_reports, prune_reports};
use super::run_store::RunStore;
use super::{
    BakeOptions, BakeReport, ErrorBound, FitReport, MaxErrors, Origin, edit, nested, plan,
};
use crate::base::bytes::{ByteSink, WriterSink};
use crate::base::error::{Place, Result};
use crate::base::progress::{Progress, Step};
use crate::container::{self, EncodedLevel, Head, layout::Entry};
use crate::levels::Visible;
use crate::model::baked::{Metadata, Table};
use crate::model::field::{NonfiniteCount, RadianceField};
use crate::view::render::TrainedLevels;

/// Bakes `field` into `output`, which is complete but not yet finished when this returns.
/// `origin` goes into the container's provenance.
///
/// # Errors
///
/// Options that contradict each other or the field, reading, writing, values that are not finite,
/// if these are refused, and a request to stop.
pub fn bake(
    field: &RadianceField,
    options: &BakeOptions,
    origin: &Origin,
    output: &mut dyn ByteSink,
    progress: &dyn Progress,
) -> Result<BakeReport> {
    options.check()?;
    field.check()?;
    for lattice in field.lattices() {
        lattice.nodes.check_planes(options.block_size, &options.limits, &Place::File)?;
    }
    if !field.shells.is_empty() {
        return nested::bake(field, options, origin, output, progress);
    }
    let mut stages = Stages::start();
    let memory = MemoryPlan::of_bake(field, options)?;
    let Prepared { planes, sizes, mut visible, importance } =
        Prepared::new(field, options, &mut stages, progress)?;
    let fitted = match options.filter.is_fitted() {
        true => Some(fit_levels(field, options, sizes.len(), &visible, progress)?),
        false => None,
    };
    if fitted.is_some() {
        stages.end("fit", 0);
    }
    if options.keeps_blocks() {
        visible.keep_blocks(options.block_size)?;
    }
    let tables = plan::tables(&visible, options.block_size)?;
    let mut metadata = plan::metadata(field, options, &visible, &tables);
    if let Some(fitted) = &fitted {
        metadata.level_of_detail = fitted.level_of_detail;
        plan::add_fitted(&mut metadata, options, fitted);
    }
    let source = FilteredLevels {
        planes: &planes,
        options,
        visible: &visible,
        fitted: fitted.as_ref(),
        pipelined: memory.pipelined,
        is_window: false,
    };
    // A search holds two containers: the best so far and the current one.
    let share = if options.max_bytes.is_some() { 2 } else { 1 };
    let folder = output.folder();
    let mut packer = Packer {
        options,
        source: &source,
        visible: &visible,
        importance: &importance,
        metadata: &metadata,
        tables: &tables,
        run_bytes: memory.run_bytes / share,
        folder: &folder,
        stages: &mut stages,
        progress,
    };
    let digest = origin.digest(field, &visible.density_checksums)?;
    let provenance = origin.provenance(&digest, resolved(options, fitted.as_ref()));
    let head = Head {
        metadata: &metadata,
        view_mlp: field.network(),
        free_space: field.free_space.as_ref().filter(|_| visible.mask_is_required),
        provenance: &provenance,
        others: &[],
        zstd_level: options.zstd_level,
        limits: &options.limits,
    };
    let (packed, chosen) = match options.max_bytes {
        Some(bytes) => {
            let (packed, chosen) = packer.within(bytes, &head)?;
            (packed, Some(chosen))
        }
        None => (packer.pack(Precision::of(options))?, None),
    };
    let Packed { metadata, encoded, nonfinite_color } = packed;
    let dropped = chosen.as_ref().map_or(0, |chosen| chosen.without_finest);
    let nonfinite = visible.nonfinite.count + planes.accepted(nonfinite_color)?;
    let head = Head { metadata: &metadata, ..head };
    let entries = write(&head, &encoded, output, &mut stages, progress)?;
    Ok(BakeReport {
        output_bytes: output.length(),
        levels: level_reports(&metadata, &entries, &provenance["options"]),
        shells: Vec::new(),
        pruned: prune_reports(&visible, dropped),
        fitted: fitted.map(|fitted| FitReport::without_finest(fitted, dropped)),
        unchanged: false,
        free_space_stored: visible.mask_is_required,
        nonfinite_values: nonfinite,
        chosen,
        islands: None,
        stages: stages.list,
    })
}

/// Everything about a container that does not depend on errors.
struct Packer<'a> {
    options: &'a BakeOptions,
    source: &'a FilteredLevels<'a>,
    visible: &'a Visible,
    importance: &'a [LevelImportance],
    metadata: &'a Metadata,
    tables: &'a [Table],
    /// Bytes of compressed runs that may stay in memory; the others wait in `folder`.
    run_bytes: u64,
    folder: &'a Path,
    stages: &'a mut Stages,
    progress: &'a dyn Progress,
}

impl Packer<'_> {
    /// Encodes all levels.
    fn pack(&mut self, precision: Precision) -> Result<Packed> {
        let store = RunStore::new(self.run_bytes, self.folder);
        let Self { options, source, visible, importance, .. } = *self;
        let packing = packing(options, precision, source, visible, importance, Some(&store));
        let mut metadata = self.metadata.clone();
        let tables = self.tables.to_vec();
        let (encoded, summary) = packing.run(&mut metadata, tables, self.stages, self.progress)?;
        Ok(Packed { metadata, encoded, nonfinite_color: summary.nonfinite_color })
    }

    /// The best container of at most this many bytes; `head` has its parts beside the levels.
    fn within(&mut self, bytes: u64, head: &Head) -> Result<(Packed, Chosen)> {
        let is_moved = self.options.is_seen_nearby() && !self.importance.is_empty();
        max_bytes::search(bytes, self.metadata.levels.len(), |dropped, factor| {
            let precision = Precision::of_factor(factor, self.options);
            let nearby_coarseness = is_moved.then_some(precision.moved_codes);
            let mut packed = self.pack(precision)?;
            if !packed.drop_finest(dropped)? {
                return Ok(Attempt { bytes: u64::MAX, nearby_coarseness, packed });
            }
            let mut count = WriterSink::new(std::io::sink());
            let head = Head { metadata: &packed.metadata, ..*head };
            container::write(&head, &packed.encoded, &mut count)?;
            Ok(Attempt { bytes: count.length(), nearby_coarseness, packed })
        })
    }
}

/// A container's parts that depend on errors.
struct Packed {
    metadata: Metadata,
    encoded: Vec<EncodedLevel>,
    nonfinite_color: NonfiniteCount,
}

impl Packed {
    /// Drops the finest levels, whose codes come first. Returns `false` if other codes would have
    /// to change: float codes cannot be scaled by their encoding.
    fn drop_finest(&mut self, count: usize) -> Result<bool> {
        let scales = edit::drop_from_metadata(&mut self.metadata, count)?;
        self.encoded.drain(..count);
        let mut levels = self.metadata.levels.iter().zip(scales);
        Ok(levels.all(|(level, scale)| {
            scale == 1.0 || level.density.as_ref().is_none_or(|density| !density.number.is_float())
        }))
    }
}

/// How much values may move.
#[derive(Debug, Clone, Copy)]
pub(super) struct Precision {
    /// Errors of the values; none if bits are given.
    max_errors: Option<MaxErrors>,
    /// Codes that colours may move by at nodes of importance 1.
    moved_codes: f32,
}

impl Precision {
    /// As the options state it.
    pub fn of(options: &BakeOptions) -> Self {
        let moved_codes = match options.is_seen_nearby() {
            true => options.nearby_coarseness,
            false => options.coarseness,
        };
        Self { max_errors: options.max_error, moved_codes }
    }

    /// The factor on the preset `web`.
    pub fn of_factor(factor: f64, options: &BakeOptions) -> Self {
        let moved_codes = match options.is_seen_nearby() {
            true => nearby_coarseness_of(factor),
            false => options.coarseness,
        };
        Self { max_errors: Some(errors_of(factor)), moved_codes }
    }
}

/// The packing of a trained field's levels.
pub(super) fn packing<'a>(
    options: &BakeOptions,
    precision: Precision,
    source: &'a FilteredLevels<'a>,
    visible: &'a Visible,
    importance: &'a [LevelImportance],
    store: Option<&'a RunStore>,
) -> Packing<'a> {
    Packing {
        source,
        retained: visible.retained(),
        choice: match precision.max_errors {
            Some(max_errors) => Some(EncodingChoice::Within { max_errors, only_fewer: false }),
            None => source.is_laid_over_values().then_some(EncodingChoice::Laid(options.bits)),
        },
        bound: ErrorBound::Proved,
        importance,
        coarseness: precision.moved_codes,
        inheritance: options.fill_error.map(|error| Inheritance { error, among: None }),
        zstd_level: options.zstd_level,
        store,
    }
}

/// Writes a container, as the last stage.
pub(super) fn write(
    head: &Head,
    encoded: &[EncodedLevel],
    output: &mut dyn ByteSink,
    stages: &mut Stages,
    progress: &dyn Progress,
) -> Result<Vec<Entry>> {
    progress.begin(Step::Write, 1);
    let entries = container::write(head, encoded, output)?;
    progress.advance(Step::Write, 1);
    stages.end("write", output.length());
    Ok(entries)
}

/// Options as the provenance states them. A fit that was cut short also states its steps, which
/// alone distinguish it from a complete one.
fn resolved(options: &BakeOptions, fitted: Option<&Fitted>) -> Value {
    let mut resolved = options.to_json();
    if let Some(fitted) = fitted.filter(|fitted| fitted.cut_short) {
        let steps: Vec<usize> = fitted.levels.iter().map(|level| level.steps).collect();
        resolved["fit_steps_taken"] = json!(steps);
    }
    resolved
}

fn fit_levels(
    field: &RadianceField,
    options: &BakeOptions,
    count: usize,
    visible: &Visible,
    progress: &dyn Progress,
) -> Result<Fitted> {
    let levels = TrainedLevels {
        filter: &*options.filter,
        count,
        level_of_detail: options.level_of_detail(),
    };
    let fit_options = FitOptions {
        steps: options.fit_steps,
        seconds: options.fit_seconds,
        cameras: &options.fit_cameras,
        photographs: options.photographs.as_ref().map(|photographs| &*photographs.folder),
    };
    let retained = visible.retained();
    let masked = visible.mask_is_required;
    fit(field, levels, &retained, masked, &fit_options, &options.limits, progress)
}
