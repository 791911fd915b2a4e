//! A bake from a trained field to a container.

use serde_json::{Value, json};

use super::fit::{FitOptions, Fitted, fit};
use super::importance::LevelImportance;
use super::inherit::Inheritance;
use super::levels::FilteredLevels;
use super::memory::MemoryPlan;
use super::pack::Packing;
use super::prepare::Prepared;
use super::ranges::BitSearch;
use super::report::{Stages, level_reports, prune_reports};
use super::run_store::RunStore;
use super::{BakeOptions, BakeReport, ErrorBound, FitReport, Origin, plan};
use crate::base::bytes::ByteSink;
use crate::base::error::Result;
use crate::base::progress::{Progress, Step};
use crate::codec::container::{self, EncodedLevel, Head, layout::Entry};
use crate::codec::quantize::Bits;
use crate::levels::Visible;
use crate::model::field::RadianceField;
use crate::view::render::TrainedLevels;

/// Bakes `field` into `output`, which is complete but not yet finished when this returns.
/// `origin` goes into the container's provenance.
///
/// # Errors
///
/// Options that contradict each other or the field, reading, writing, values that are not finite
/// where those are refused, and a request to stop.
pub fn bake(
    field: &RadianceField,
    options: &BakeOptions,
    origin: &Origin,
    output: &mut dyn ByteSink,
    progress: &dyn Progress,
) -> Result<BakeReport> {
    options.check()?;
    field.check()?;
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
    if options.bits == Bits::F32 && options.max_error.is_none() {
        // Every value of a stored block is kept exactly.
        for level in &mut visible.levels {
            level.retained = level.retained.whole_blocks(options.block_size)?;
        }
    }
    let tables = plan::tables(&visible, options.block_size)?;
    let mut metadata = plan::metadata(field, options, &visible, &tables);
    if let Some(fitted) = &fitted {
        metadata.level_of_detail = fitted.level_of_detail;
    }
    let source = FilteredLevels {
        planes: &planes,
        options,
        visible: &visible,
        fitted: fitted.as_ref(),
        pipelined: memory.is_none_or(|memory| memory.pipelined),
        is_window: false,
    };
    let store = memory.map(|memory| RunStore::new(memory.run_bytes, &output.folder()));
    let store = store.transpose()?;
    let packing = packing(options, &source, &visible, &importance, store.as_ref());
    let (encoded, summary) = packing.run(&mut metadata, tables, &mut stages, progress)?;
    let nonfinite = visible.nonfinite.count + planes.accepted(summary.nonfinite_color)?;
    let digest = origin.digest(field, &visible.density_checksums)?;
    let head = Head {
        metadata: &metadata,
        view_mlp: field.view_mlp.as_ref(),
        free_space: field.free_space.as_ref().filter(|_| visible.mask_is_required),
        provenance: &origin.provenance(&digest, resolved(options, fitted.as_ref())),
        zstd_level: options.zstd_level,
        limits: &options.limits,
    };
    let entries = write(&head, &encoded, output, &mut stages, progress)?;
    Ok(BakeReport {
        output_bytes: output.length(),
        levels: level_reports(&metadata, &entries),
        pruned: prune_reports(&visible),
        fitted: fitted.map(FitReport::from),
        unchanged: false,
        free_space_stored: visible.mask_is_required,
        nonfinite_values: nonfinite,
        stages: stages.list,
    })
}

/// The packing of a trained field's levels.
pub(super) fn packing<'a>(
    options: &BakeOptions,
    source: &'a FilteredLevels<'a>,
    visible: &'a Visible,
    importance: &'a [LevelImportance],
    store: Option<&'a RunStore>,
) -> Packing<'a> {
    Packing {
        source,
        retained: visible.retained(),
        search: options.max_error.map(|max_errors| BitSearch { max_errors, only_fewer: false }),
        bound: ErrorBound::Proved,
        importance,
        coarseness: options.coarseness,
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

/// Options as the provenance states them. A fit that was cut short states its steps too, because
/// nothing else tells it from another one.
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
    };
    let retained = visible.retained();
    let masked = visible.mask_is_required;
    fit(field, levels, &retained, masked, &fit_options, &options.limits, progress)
}
