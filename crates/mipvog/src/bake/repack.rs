//! A container, packed again.
//!
//! Levels, encodings, ranges and occupancy are taken as they are: nothing is filtered or pruned,
//! and encodings are searched only if an error or a size is requested. Decoding and encoding are
//! inverse for codes, so without changes the result is the same file, byte for byte. Edits
//! ([`super::edit`]) come first.
//!
//! **Errors add up.** Each quantization moves a value. So the error of a changed encoding is the
//! sum of the old encoding's error and its own.

use std::io;

use serde_json::Value;

use super::changes::Changes;
use super::edit;
use super::inherit::Inheritance;
use super::max_bytes::{self, Attempt, Chosen};
use super::origin::provenance_of_changes;
use super::pack::Packing;
use super::quality::errors_of;
use super::ranges::EncodingChoice;
use super::report::{BakeReport, IslandReport, Stages, level_reports, shell_reports};
use super::run::write;
use super::unpacked_levels::UnpackedLevels;
use super::{ErrorBound, MaxErrors, option_rules};
use crate::base::bytes::{ByteSink, WriterSink};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::container::layout::THUMBNAIL;
use crate::container::{self, EncodedLevel, Head, OtherChunk};
use crate::model::baked::{Encoding, Group, Metadata, Table};
use crate::model::grid::NodeMask;
use crate::unpacked::Unpacked;

/// Packs `unpacked` into `output`, which is complete but not yet finished when this returns.
///
/// Blocks that inherit their colours were unpacked with those colours. Each is encoded like any
/// other block, and inherits again only if that gives exactly its codes. So edited values are kept,
/// and changes of encodings or of the number of levels keep every bound.
///
/// # Errors
///
/// A value that is not finite, or one that its encoding cannot hold within the stated error; a
/// change that is out of range, or that the format cannot represent for this container.
pub fn repack(
    unpacked: &Unpacked,
    changes: &Changes,
    limits: &Limits,
    output: &mut dyn ByteSink,
    progress: &dyn Progress,
) -> Result<BakeReport> {
    changes.check(&unpacked.metadata.march)?;
    for level in unpacked.metadata.parts() {
        level.grid().nodes.check_planes(level.block_size, limits, &Place::File)?;
    }
    let mut stages = Stages::start();
    let stated = unpacked.provenance["options"]["zstd_level"].as_i64();
    // Provenance is not validated: a level that zstd does not have counts as none.
    let stated = stated.and_then(|level| i32::try_from(level).ok());
    let stated = stated.filter(|&level| option_rules::zstd_level(level).is_ok());
    let zstd_level = changes.zstd_level.or(stated).unwrap_or(super::options::DEFAULT_ZSTD_LEVEL);
    let (edited, islands) = edited(unpacked, changes, progress)?;
    let emptied = islands.is_some() || changes.crop.is_some();
    if emptied || changes.without_outermost > 0 || !changes.placement.is_identity() {
        stages.end("edit", 0);
    }
    let mut repacking = Repacking {
        unpacked,
        changes,
        zstd_level,
        is_recompressed: changes.zstd_level.is_some_and(|level| Some(level) != stated),
        limits,
        stages: &mut stages,
        progress,
    };
    let (packed, chosen) = match changes.max_bytes {
        Some(bytes) => {
            let (packed, chosen) = repacking.within(&edited, bytes)?;
            (packed, Some(chosen))
        }
        None => (repacking.pack(&edited, changes.max_error)?, None),
    };
    let head = packed.head(&edited, zstd_level, limits);
    let entries = write(&head, &packed.encoded, output, &mut stages, progress)?;
    Ok(BakeReport {
        output_bytes: output.length(),
        levels: level_reports(&packed.metadata, &entries, &packed.provenance["options"]),
        shells: shell_reports(&packed.metadata, &entries, &packed.provenance["options"]),
        pruned: Vec::new(),
        fitted: None,
        unchanged: false,
        free_space_stored: packed.metadata.free_space,
        nonfinite_values: 0,
        chosen,
        islands,
        stages: stages.list,
    })
}

/// Refuses changes that nested boxes do not support.
fn refuse_of_worlds(unpacked: &Unpacked, changes: &Changes) -> Result<()> {
    let shells = unpacked.metadata.shells.len();
    if shells == 0 {
        return Ok(());
    }
    let finest = "0: outside the smallest of nested boxes the next level is not all that there \
                  is; bake with fewer nodes instead (resolution)";
    let found = changes.without_finest;
    Error::require_option(found == 0, "without_finest", found, finest)?;
    let expected =
        "a container of one box: this one has nested boxes (without_outermost drops them)";
    let found = changes.drop_islands.unwrap_or(0);
    Error::require_option(changes.drop_islands.is_none(), "drop_islands", found, expected)?;
    let levels = changes.levels.unwrap_or(usize::MAX);
    let expected = format!(
        "more than {shells}: a level for each of the nested boxes (without_outermost drops them)"
    );
    Error::require_option(levels > shells, "levels", levels, &expected)
}

/// The container after all edits, at its new place.
fn edited(
    unpacked: &Unpacked,
    changes: &Changes,
    progress: &dyn Progress,
) -> Result<(Unpacked, Option<IslandReport>)> {
    let mut edited = unpacked.clone();
    edit::drop_outermost(&mut edited, changes.without_outermost)?;
    // A world may be reduced to one box, which supports more changes.
    let of_world = changes.crop.filter(|_| !edited.metadata.shells.is_empty());
    of_world.map_or(Ok(()), |bounds| edit::crop_world(&mut edited, &bounds))?;
    refuse_of_worlds(&edited, changes)?;
    let islands = changes.drop_islands.map(|nodes| edit::drop_islands(&mut edited, nodes));
    let islands = islands.transpose()?;
    if let (Some(bounds), None) = (&changes.crop, &of_world) {
        edit::crop(&mut edited, bounds)?;
    }
    edit::drop_finest(&mut edited, changes.without_finest)?;
    edit::place(&mut edited, &changes.placement, progress)?;
    if changes.changes_the_scene() {
        // It shows what was there.
        edited.others.retain(|chunk| chunk.kind != THUMBNAIL);
    }
    Ok((edited, islands))
}

/// Everything about a container that does not depend on errors.
struct Repacking<'a> {
    /// As it was.
    unpacked: &'a Unpacked,
    changes: &'a Changes,
    zstd_level: i32,
    is_recompressed: bool,
    limits: &'a Limits,
    stages: &'a mut Stages,
    progress: &'a dyn Progress,
}

/// A container's parts that depend on errors.
struct Packed {
    metadata: Metadata,
    encoded: Vec<EncodedLevel>,
    provenance: Value,
    others: Vec<OtherChunk>,
}

impl Packed {
    /// The parts beside the levels; network and mask are those of `edited`.
    fn head<'a>(&'a self, edited: &'a Unpacked, zstd_level: i32, limits: &'a Limits) -> Head<'a> {
        Head {
            metadata: &self.metadata,
            view_mlp: edited.view_mlp.as_ref(),
            free_space: edited.free_space.as_ref(),
            provenance: &self.provenance,
            others: &self.others,
            zstd_level,
            limits,
        }
    }
}

impl Repacking<'_> {
    /// Encodes all levels of `edited`, within an error where one is given.
    fn pack(&mut self, edited: &Unpacked, max_errors: Option<MaxErrors>) -> Result<Packed> {
        let mut metadata = edited.metadata.clone();
        self.changes.apply(&mut metadata);
        // Dropped coarsest levels precede the shells.
        let mut levels = edited.levels.clone();
        levels.drain(metadata.levels.len()..edited.metadata.levels.len());
        let levels = &*levels;
        let mut before = edited.metadata.clone();
        before.levels.truncate(metadata.levels.len());
        let unpacked_tables: Vec<Table> = levels.iter().map(|level| level.table.clone()).collect();
        let tables = unpacked_tables.iter().map(Table::without_inheritance);
        let tables = tables.collect::<Result<Vec<Table>>>()?;
        metadata.parts_mut().for_each(|level| level.blocks_filled = 0);
        let stored: Vec<NodeMask> =
            levels.iter().map(|level| level.counted_nodes()).collect::<Result<_>>()?;
        let inherits = unpacked_tables.iter().any(|table| table.inherited() > 0);
        let among = Some(&*unpacked_tables);
        let packing = Packing {
            source: &UnpackedLevels { levels, metadata: &before },
            retained: stored.iter().collect(),
            choice: match (max_errors, self.changes.fixed_bits()) {
                (Some(max_errors), _) => {
                    Some(EncodingChoice::Within { max_errors, only_fewer: true })
                }
                (None, Some(bits)) => Some(EncodingChoice::Laid(bits)),
                (None, None) => None,
            },
            // Arrays may have been edited since the encodings were made. Rotated values are not
            // codes: where an encoding stays, its error holds.
            bound: max_errors
                .filter(|_| !self.changes.placement.rotates())
                .map_or(ErrorBound::Encoding, ErrorBound::Asked),
            importance: &[],
            coarseness: 0.0,
            inheritance: inherits.then_some(Inheritance { error: 0.0, among }),
            zstd_level: self.zstd_level,
            store: None,
        };
        let (encoded, _) = packing.run(&mut metadata, tables, self.stages, self.progress)?;
        add_errors(&mut metadata, &before);
        let others = edited.others.clone();
        let mut packed = Packed { metadata, encoded, provenance: Value::Null, others };
        packed.provenance = match self.is_unchanged(edited, &packed)? {
            true => self.unpacked.provenance.clone(),
            false => provenance_of_changes(&self.unpacked.provenance, &self.changes.to_json()),
        };
        Ok(packed)
    }

    /// True if the container is unchanged.
    fn is_unchanged(&self, edited: &Unpacked, packed: &Packed) -> Result<bool> {
        let unpacked = self.unpacked;
        let unchanged = packed.metadata == unpacked.metadata
            && !self.is_recompressed
            && edited.free_space == unpacked.free_space
            && self.changes.drop_islands.is_none();
        match unpacked.content.filter(|_| unchanged) {
            // Dense arrays and their network can have been edited.
            Some(content) => {
                let head = packed.head(edited, self.zstd_level, self.limits);
                Ok(container::content_checksum_of(&head, &packed.encoded)? == content)
            }
            None => Ok(unchanged),
        }
    }

    /// The best container of at most this many bytes.
    fn within(&mut self, edited: &Unpacked, bytes: u64) -> Result<(Packed, Chosen)> {
        let whole = self.attempt(edited, None)?;
        if whole.bytes <= bytes {
            let chosen = Chosen {
                bytes: whole.bytes,
                max_error: None,
                nearby_coarseness: None,
                without_finest: self.changes.without_finest,
            };
            return Ok((whole.packed, chosen));
        }
        // Finest levels of a world are not dropped.
        let droppable = if edited.metadata.shells.is_empty() { edited.levels.len() } else { 1 };
        let levels = droppable.min(self.changes.levels.unwrap_or(usize::MAX));
        max_bytes::search(bytes, levels, |dropped, factor| {
            let mut fewer = edited.clone();
            edit::drop_finest(&mut fewer, dropped)?;
            self.attempt(&fewer, Some(errors_of(factor)))
        })
        .map(|(packed, chosen)| {
            let without_finest = chosen.without_finest + self.changes.without_finest;
            (packed, Chosen { without_finest, ..chosen })
        })
    }

    fn attempt(
        &mut self,
        edited: &Unpacked,
        max_errors: Option<MaxErrors>,
    ) -> Result<Attempt<Packed>> {
        let packed = self.pack(edited, max_errors)?;
        let head = packed.head(edited, self.zstd_level, self.limits);
        let mut count = WriterSink::new(io::sink());
        container::write(&head, &packed.encoded, &mut count)?;
        Ok(Attempt { bytes: count.length(), nearby_coarseness: None, packed })
    }
}

/// Adds the old errors of values to those of encodings that changed.
fn add_errors(metadata: &mut Metadata, before: &Metadata) {
    let codes = |encoding: &Encoding| Encoding { max_error: 0.0, ..encoding.clone() };
    for (level, before) in metadata.parts_mut().zip(before.parts()) {
        for group in Group::ALL {
            if let (Some(encoding), Some(before)) =
                (level.encoding_mut(group), before.encoding(group))
                && codes(encoding) != codes(before)
            {
                encoding.max_error = encoding.error_after(before.max_error.into());
            }
        }
    }
}
