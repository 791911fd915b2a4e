//! An unpacked container, packed again.
//!
//! Levels, encodings, ranges and occupancy are taken as they are: nothing is filtered or pruned,
//! and encodings are searched only where an error is asked for. Decoding and encoding are inverse
//! for codes, so without changes the result is the same file that was unpacked, byte for byte.

use serde_json::{Value, json};

use super::inherit::Inheritance;
use super::pack::{LevelSource, Packing};
use super::ranges::BitSearch;
use super::report::{BakeReport, Stages, level_reports};
use super::run::write;
use super::{ErrorBound, LevelRule, MaxErrors};
use crate::base::bytes::ByteSink;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::Limits;
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::codec::container::Head;
use crate::codec::quantize::{Bits, color_encoding, density_encoding};
use crate::codec::unpack::{Unpacked, UnpackedLevel};
use crate::levels::{Plane, PlaneSink, ReadSummary};
use crate::model::baked::{Encoding, Group, Metadata, Table};
use crate::model::field::{March, Scene, Volume};
use crate::model::grid::{BlockGrid, NodeMask, Nodes, row};

/// Changes to an unpacked container.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Changes {
    /// Other bits, with ranges to match.
    pub bits: Option<Bits>,
    /// The fewest bits that keep this error of the unpacked values, whatever `bits` says; 1e-6 to
    /// 0.25. Encodings that have no more bits stay: they hold the values exactly.
    pub max_error: Option<MaxErrors>,
    /// Fewer levels.
    pub levels: Option<usize>,
    /// Another compression level of zstd. Default: as the provenance says, else the bake's
    pub zstd_level: Option<i32>,
    /// Another rule of levels.
    pub lod_rule: Option<LevelRule>,
    /// Multiplies the rule's factor.
    pub lod_scale: Option<f32>,
    /// Start of rays.
    pub near: Option<f32>,
    /// Farthest entry of rays into the box.
    pub far: Option<f32>,
    /// Colour behind the field.
    pub background: Option<[f32; 3]>,
    /// Samples of at most this weight add no colour.
    pub color_threshold: Option<f32>,
}

impl Changes {
    /// Changes how rays are marched through a field.
    pub fn apply_to_scene(&self, scene: &mut Scene) {
        self.apply_to_march(&mut scene.march);
        scene.background = self.background.unwrap_or(scene.background);
    }

    fn apply_to_march(&self, march: &mut March) {
        march.near = self.near.unwrap_or(march.near);
        march.far = self.far.or(march.far);
        march.color_threshold = self.color_threshold.unwrap_or(march.color_threshold);
    }

    fn apply(&self, metadata: &mut Metadata) {
        if let Some(bits) = self.bits.filter(|_| self.max_error.is_none()) {
            let color = color_encoding(bits);
            for level in &mut metadata.levels {
                let domain = level.density_domain();
                if let Some(density) = &mut level.density {
                    change(density, &density_encoding(bits, domain, &metadata.activation));
                }
                level.diffuse.iter_mut().for_each(|encoding| change(encoding, &color));
                level.features.iter_mut().for_each(|encoding| change(encoding, &color));
            }
        }
        metadata.levels.truncate(self.levels.unwrap_or(usize::MAX));
        if let Some(rule) = self.lod_rule {
            metadata.level_of_detail = rule.applied_to(metadata.level_of_detail);
        }
        metadata.level_of_detail.factor *= self.lod_scale.unwrap_or(1.0);
        self.apply_to_march(&mut metadata.march);
        metadata.background = self.background.unwrap_or(metadata.background);
    }

    /// As provenance and reports name them.
    pub fn to_json(&self) -> Value {
        let bits = self.bits.filter(|_| self.max_error.is_none());
        let mut changes = json!({
            "bits": bits.map(|bits| bits.to_string()),
            "levels": self.levels,
            "zstd_level": self.zstd_level,
            "lod_scale": self.lod_scale,
            "near": self.near,
            "far": self.far,
            "background": self.background,
            "color_threshold": self.color_threshold,
        });
        if let Some(rule) = self.lod_rule {
            changes["lod_rule"] = rule.name().into();
        }
        if let Some(max_error) = self.max_error {
            changes["max_error"] = max_error.to_json();
        }
        changes
    }
}

/// Takes over another encoding, unless the old one has as many bits: then its range stays.
fn change(encoding: &mut Encoding, to: &Encoding) {
    if (encoding.number, encoding.bits) != (to.number, to.bits) {
        *encoding = to.clone();
    }
}

/// Packs `unpacked` into `output`, which is complete but not yet finished when this returns.
///
/// Blocks that inherit their colours were unpacked with those colours. Each is encoded like any
/// other block, and inherits again if that gives exactly its codes. So edited values are kept, and
/// a changed encoding or number of levels breaks no bound.
///
/// # Errors
///
/// A value that is not finite, or one that its encoding cannot hold within the stated error.
pub fn repack(
    unpacked: &Unpacked,
    changes: &Changes,
    limits: &Limits,
    output: &mut dyn ByteSink,
    progress: &dyn Progress,
) -> Result<BakeReport> {
    changes.max_error.map_or(Ok(()), |max_error| max_error.check())?;
    let mut stages = Stages::start();
    let mut metadata = unpacked.metadata.clone();
    changes.apply(&mut metadata);
    let stated = unpacked.provenance["options"]["zstd_level"].as_i64();
    let stated = stated.and_then(|level| i32::try_from(level).ok());
    let zstd_level = changes.zstd_level.or(stated).unwrap_or(super::options::DEFAULT_ZSTD_LEVEL);
    let levels = &unpacked.levels[..metadata.levels.len()];
    let unpacked_tables: Vec<Table> = levels.iter().map(|level| level.table.clone()).collect();
    let tables = unpacked_tables.iter().map(Table::without_inheritance);
    let tables = tables.collect::<Result<Vec<Table>>>()?;
    metadata.levels.iter_mut().for_each(|level| level.blocks_filled = 0);
    let stored: Vec<NodeMask> = tables.iter().map(stored_nodes).collect();
    let inherits = unpacked_tables.iter().any(|table| table.inherited() > 0);
    let packing = Packing {
        source: &UnpackedLevels(levels),
        retained: stored.iter().collect(),
        search: changes.max_error.map(|max_errors| BitSearch { max_errors, only_fewer: true }),
        // Arrays can be edited, and encodings were made for the values before.
        bound: changes.max_error.map_or(ErrorBound::Encoding, ErrorBound::Asked),
        importance: &[],
        coarseness: 0.0,
        inheritance: inherits.then_some(Inheritance { error: 0.0, among: Some(&unpacked_tables) }),
        zstd_level,
        store: None,
    };
    let (encoded, _) = packing.run(&mut metadata, tables, &mut stages, progress)?;
    let unchanged = metadata == unpacked.metadata
        && changes.zstd_level.is_none_or(|level| Some(level) == stated);
    let provenance = if unchanged {
        unpacked.provenance.clone()
    } else {
        json!({
            "tool": env!("CARGO_PKG_NAME"),
            "version": env!("CARGO_PKG_VERSION"),
            "input": { "kind": "unpacked container", "provenance": unpacked.provenance },
            "options": changes.to_json(),
        })
    };
    let head = Head {
        metadata: &metadata,
        view_mlp: unpacked.view_mlp.as_ref(),
        free_space: unpacked.free_space.as_ref(),
        provenance: &provenance,
        zstd_level,
        limits,
    };
    let entries = write(&head, &encoded, output, &mut stages, progress)?;
    Ok(BakeReport {
        output_bytes: output.length(),
        levels: level_reports(&metadata, &entries),
        pruned: Vec::new(),
        fitted: None,
        unchanged: false,
        free_space_stored: metadata.free_space,
        nonfinite_values: 0,
        stages: stages.list,
    })
}

/// Every node of a stored block: each value counts as it is.
fn stored_nodes(table: &Table) -> NodeMask {
    let BlockGrid { nodes, edge } = table.grid();
    let [nx, _, nz] = nodes.0;
    let words = row::words(nodes);
    let mut stored = NodeMask::empty(nodes);
    let mut planes = stored.planes_mut(0);
    for [i, j, k] in table.stored() {
        for plane in &mut planes[i * edge..nx.min((i + 1) * edge)] {
            for row in plane.chunks_exact_mut(words).take((j + 1) * edge).skip(j * edge) {
                row::set_between(row, k * edge, nz.min((k + 1) * edge));
            }
        }
    }
    stored
}

/// The levels of an unpacked container, as they are.
struct UnpackedLevels<'a>(&'a [UnpackedLevel]);

impl LevelSource for UnpackedLevels<'_> {
    fn stream(
        &self,
        sink: &dyn PlaneSink,
        step: Step,
        progress: &dyn Progress,
    ) -> Result<ReadSummary> {
        progress.begin(step, self.0.len() as u64);
        let mut summary = ReadSummary::default();
        for (number, level) in self.0.iter().enumerate() {
            stream_level(number, level, sink, progress)?;
            summary.bytes += level.volumes.iter().flatten().map(Volume::bytes).sum::<u64>();
            progress.advance(step, 1);
        }
        Ok(summary)
    }
}

/// Streams one level, a block's thickness at a time.
fn stream_level(
    number: usize,
    level: &UnpackedLevel,
    sink: &dyn PlaneSink,
    progress: &dyn Progress,
) -> Result<()> {
    let channels: Vec<(Group, &Volume, usize)> = Group::ALL
        .into_iter()
        .zip(&level.volumes)
        .filter_map(|(group, volume)| volume.as_ref().map(|volume| (group, volume)))
        .flat_map(|(group, volume)| (0..volume.channels).map(move |c| (group, volume, c)))
        .collect();
    let BlockGrid { nodes: Nodes([nx, ny, nz]), edge } = level.table.grid();
    for first in (0..nx).step_by(edge) {
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
        let planes = first..nx.min(first + edge);
        parallel::map(planes.len() * channels.len(), |i| {
            let (group, volume, channel) = channels[i % channels.len()];
            let x = first + i / channels.len();
            let mut values = vec![0.0; ny * nz];
            let mut scratch = Vec::new();
            for (y, row) in values.chunks_exact_mut(nz).enumerate() {
                volume.read_run(channel, [x, y, 0], row, &mut scratch, |_| {})?;
                if let Some(z) = row.iter().position(|value| !value.is_finite()) {
                    let kind = ErrorKind::NonFinite { count: 1, first: [channel, x, y, z] };
                    let name = format!("level{number}.{}", group.name());
                    return Err(Error::new(kind, Place::Tensor(name)));
                }
            }
            let channel = i % channels.len();
            sink.plane(Plane { level: number, x, channel, values: &mut values })
        })?;
        sink.slab(number, planes)?;
    }
    Ok(())
}
