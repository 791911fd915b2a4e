//! A bake of a field with a world around it, box by box.
//!
//! ```text
//! box 0   level 0 (the field) ─filter─▶ level 1 ─┐
//! box 1   shell 1 outside box 0, level 1 within ─filter─▶ level 2 ─┐
//! box K   shell K outside box K - 1, level K within ─filter─▶ levels K + 1, ...
//! ```
//!
//! Each box is baked as a field of its own: its values are those of its shell, and inside the next
//! smaller box those of the level that was just made there ([`inner`]). So filters, visibility,
//! pruning, ranges, directional terms and inherited blocks are those of one box, and work across
//! the faces of the smaller ones. A shell's blocks are kept where one of their cells lies outside
//! the smaller box.
//!
//! The interval of box `m` is `2^m` times that of the field: opacities, their errors and the
//! pruning threshold are over the step length in that box.
//!
//! The light that weights colours of coarser levels also comes from empty space in the box, because
//! a world is seen from inside.

mod forecast;
mod inner;
mod merge;

use std::path::Path;
use std::sync::Arc;

pub use forecast::forecast;

use inner::{InnerLevel, with_inner};
use merge::{BoxRecord, Merged, PackedBox};

use super::max_bytes::{self, Attempt, Chosen};
use super::memory::MemoryPlan;
use super::prepare::Prepared;
use super::report::{Stages, level_reports, shell_reports};
use super::run::{Precision, packing, write};
use super::run_store::RunStore;
use super::{BakeOptions, BakeReport, Origin, levels::FilteredLevels, plan};
use crate::base::bytes::{ByteSink, WriterSink};
use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::container::{self, Head};
use crate::model::baked::Blend;
use crate::model::field::{Grid, RadianceField};
use crate::model::grid::Bounds;

/// Bakes a field with shells into `output`; see [`super::run::bake`].
///
/// # Errors
///
/// Errors of a bake, and options that worlds do not support.
pub fn bake(
    field: &RadianceField,
    options: &BakeOptions,
    origin: &Origin,
    output: &mut dyn ByteSink,
    progress: &dyn Progress,
) -> Result<BakeReport> {
    check(field, options)?;
    let mut stages = Stages::start();
    let folder = output.folder();
    let mut world = World { field, options, folder: &folder, stages: &mut stages, progress };
    let (packed, chosen) = match options.max_bytes {
        Some(bytes) => {
            let (packed, chosen) = world.within(bytes, origin)?;
            (packed, Some(chosen))
        }
        None => (world.pack(Precision::of(options))?, None),
    };
    let digest = origin.digest(field, &packed.density_checksums)?;
    let provenance = origin.provenance(&digest, options.to_json());
    let head = packed.head(field, &provenance, options);
    let entries = write(&head, &packed.encoded, output, &mut stages, progress)?;
    stages.join_same();
    Ok(BakeReport {
        output_bytes: output.length(),
        levels: level_reports(&packed.metadata, &entries, &provenance["options"]),
        shells: shell_reports(&packed.metadata, &entries, &provenance["options"]),
        pruned: packed.pruned,
        fitted: None,
        unchanged: false,
        free_space_stored: packed.metadata.free_space,
        nonfinite_values: packed.nonfinite,
        chosen,
        islands: None,
        stages: stages.list,
    })
}

/// Refuses options that worlds do not support.
fn check(field: &RadianceField, options: &BakeOptions) -> Result<()> {
    let filter = &*options.filter;
    let averages_alpha = filter.blend() == Blend::AfterActivation && !filter.is_fitted();
    let expected = "rate-tent, isotropic or coverage: the input has a world around its box \
                    (drop_background leaves it out)";
    Error::require_option(averages_alpha, "filter", filter.name(), expected)?;
    let least = field.shells.len() + 1;
    let levels = options.levels.unwrap_or(usize::MAX);
    let expected = format!("at least {least}: one for each of the nested boxes");
    Error::require_option(levels >= least, "levels", levels, &expected)
}

/// A field with its world, as it is packed.
struct World<'a> {
    field: &'a RadianceField,
    options: &'a BakeOptions,
    folder: &'a Path,
    stages: &'a mut Stages,
    progress: &'a dyn Progress,
}

impl World<'_> {
    /// Encodes all boxes, the smallest first.
    fn pack(&mut self, precision: Precision) -> Result<Merged> {
        let count = self.field.shells.len() + 1;
        let mut merged: Option<Merged> = None;
        let mut inner = None;
        let mut held = 0;
        for number in 0..count {
            let own = self.own_field(number, inner.take())?;
            let levels = match number + 1 == count {
                true => self.options.levels.map(|levels| levels - number),
                false => Some(2),
            };
            let mut options = self.own_options(number);
            // Memory held for the smaller boxes is subtracted.
            options.memory = options.memory.map(|memory| memory.saturating_sub(held));
            let smaller = number.checked_sub(1).map(|smaller| self.bounds_of(smaller));
            let packed = self.pack_box(&own, &options, smaller, levels, precision)?;
            // Planes of this box are not read beside those of the next one.
            [&own.density].into_iter().chain(&own.color).for_each(Grid::release);
            if number + 1 < count {
                let bounds = own.scene.bounds;
                let level = InnerLevel::new(&packed.0, &packed.1, bounds)?;
                held = level.bytes();
                inner = Some(Arc::new(level));
            }
            match &mut merged {
                Some(merged) => merged.add(packed),
                None => merged = Some(Merged::of_first(packed)),
            }
        }
        merged.ok_or_else(Error::cancelled)
    }

    fn bounds_of(&self, number: usize) -> Bounds {
        let shell = number.checked_sub(1).and_then(|shell| self.field.shells.get(shell));
        shell.map_or(self.field.scene.bounds, |shell| shell.lattice.bounds)
    }

    /// A box as a field of its own.
    fn own_field(&self, number: usize, inner: Option<Arc<InnerLevel>>) -> Result<RadianceField> {
        let Some(own) = self.field.of_shell(number) else {
            return Ok(RadianceField { shells: Vec::new(), ..self.field.clone() });
        };
        let mut own = match inner {
            Some(inner) => with_inner(own, &inner),
            None => own,
        };
        let times = libm::exp2(number as f64) as f32;
        own.scene.activation.interval *= times;
        own.scene.march.voxel_size *= times;
        own.scene.march.voxel.iter_mut().flatten().for_each(|edge| *edge *= times);
        own.check()?;
        Ok(own)
    }

    /// The options of a box. Options for cameras apply to the innermost box only.
    fn own_options(&self, number: usize) -> BakeOptions {
        let options = self.options.clone();
        match number {
            0 => options,
            _ => BakeOptions { seen_from: Vec::new(), min_weight: None, ..options },
        }
    }

    /// Prunes, filters and encodes one box, with at most this many levels.
    fn pack_box(
        &mut self,
        own: &RadianceField,
        options: &BakeOptions,
        smaller: Option<Bounds>,
        levels: Option<usize>,
        precision: Precision,
    ) -> Result<PackedBox> {
        let memory = MemoryPlan::of_bake(own, options)?;
        let prepared = Prepared::lit_inside(own, options, self.stages, self.progress)?;
        let Prepared { planes, mut visible, mut importance, .. } = prepared;
        let count = levels.unwrap_or(usize::MAX);
        visible.levels.truncate(count);
        importance.truncate(count);
        if let Some(smaller) = smaller {
            inner::hollow(&mut visible.levels[0].retained, &own.lattice(), &smaller);
            // Distant parts are seen from inside only: nobody looks behind the sky.
            visible.drop_unlit()?;
        }
        if options.keeps_blocks() {
            visible.keep_blocks(options.block_size)?;
        }
        let tables = plan::tables(&visible, options.block_size)?;
        let mut metadata = plan::metadata(own, options, &visible, &tables);
        let source = FilteredLevels {
            planes: &planes,
            options,
            visible: &visible,
            fitted: None,
            pipelined: memory.pipelined,
            is_window: false,
        };
        // Runs of all boxes wait for the last one.
        let boxes = self.field.shells.len() as u64 + 1;
        let store = RunStore::new(memory.run_bytes / boxes, self.folder);
        let packing = packing(options, precision, &source, &visible, &importance, Some(&store));
        let (encoded, summary) = packing.run(&mut metadata, tables, self.stages, self.progress)?;
        let nonfinite = visible.nonfinite.count + planes.accepted(summary.nonfinite_color)?;
        let record = BoxRecord::new(&visible, nonfinite);
        Ok((metadata, encoded, record))
    }

    /// The best container of at most this many bytes.
    fn within(&mut self, bytes: u64, origin: &Origin) -> Result<(Merged, Chosen)> {
        let (field, options) = (self.field, self.options);
        max_bytes::search(bytes, 1, |_, factor| {
            let precision = Precision::of_factor(factor, options);
            let packed = self.pack(precision)?;
            let digest = origin.digest(field, &packed.density_checksums)?;
            let provenance = origin.provenance(&digest, options.to_json());
            let mut count = WriterSink::new(std::io::sink());
            container::write(
                &packed.head(field, &provenance, options),
                &packed.encoded,
                &mut count,
            )?;
            Ok(Attempt { bytes: count.length(), nearby_coarseness: None, packed })
        })
    }
}

impl Merged {
    /// The parts beside the levels.
    fn head<'a>(
        &'a self,
        field: &'a RadianceField,
        provenance: &'a serde_json::Value,
        options: &'a BakeOptions,
    ) -> Head<'a> {
        Head {
            metadata: &self.metadata,
            view_mlp: field.network(),
            free_space: field.free_space.as_ref().filter(|_| self.metadata.free_space),
            provenance,
            others: &[],
            zstd_level: options.zstd_level,
            limits: &options.limits,
        }
    }
}
