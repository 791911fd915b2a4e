//! An unpacked container, packed again.
//!
//! Levels, encodings, ranges and occupancy are taken as they are: nothing is filtered or pruned, and
//! encodings are searched only where an error is asked for. Decoding and encoding are inverse for
//! codes, so without changes the result is the same file that was unpacked, byte for byte.

use std::ops::Range;
use std::time::Instant;

use serde_json::{Value, json};

use super::encode::{Check, EncodeOptions, LevelEncoder};
use super::ranges::{LevelSpans, encodings_within};
use super::report::{BakeReport, StageReport, level_reports};
use super::{LevelRule, MaxErrors};
use crate::base::bytes::Output;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::codec::container::{self, Head};
use crate::codec::quantize::{Bits, color_encoding, density_encoding};
use crate::codec::unpack::{Unpacked, UnpackedLevel};
use crate::model::baked::{Encoding, Group, Metadata, Table};
use crate::model::field::{March, Scene, Volume};
use crate::model::grid::{BlockGrid, NodeMask, Nodes, row};

/// What to change of an unpacked container.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Changes {
    /// Other bits, with ranges to match.
    pub bits: Option<Bits>,
    /// The fewest bits that keep this error of the unpacked values, whatever `bits` says; 1e-6 to 0.25.
    /// Encodings that have no more bits stay: they hold the values exactly.
    pub max_error: Option<MaxErrors>,
    /// Fewer levels.
    pub levels: Option<usize>,
    /// Another compression level of zstd. Default: as the provenance says, else the bake's
    pub zstd_level: Option<i32>,
    /// Another rule of levels.
    pub lod_rule: Option<LevelRule>,
    /// Multiplies the rule's factor.
    pub lod_scale: Option<f32>,
    /// Where rays start.
    pub near: Option<f32>,
    /// Where rays enter the box at the latest.
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
pub fn rebake(
    unpacked: &Unpacked,
    changes: &Changes,
    output: &mut Output,
    progress: &dyn Progress,
) -> Result<BakeReport> {
    changes.max_error.map_or(Ok(()), |max_error| max_error.check())?;
    let clock = Instant::now();
    let mut metadata = unpacked.metadata.clone();
    changes.apply(&mut metadata);
    if let Some(max_error) = changes.max_error {
        fit_encodings(unpacked, max_error, &mut metadata)?;
    }
    let stated = unpacked.provenance["options"]["zstd_level"].as_i64();
    let stated = stated.and_then(|level| i32::try_from(level).ok());
    let zstd_level = changes.zstd_level.or(stated).unwrap_or(super::options::DEFAULT_ZSTD_LEVEL);
    progress.begin(Step::Encode, metadata.levels.len() as u64);
    let mut levels = Vec::new();
    let mut bytes_read = 0;
    for (number, (level, of_level)) in unpacked.levels.iter().zip(&metadata.levels).enumerate() {
        // Arrays can be edited: what a container's encodings were made for may be gone.
        let options = EncodeOptions {
            level: number,
            features: metadata.features,
            activation: metadata.activation,
            zstd_level,
            check: Some(Check { most: changes.max_error }),
            room: None,
            importance: None,
        };
        let needed = stored_nodes(&level.table);
        let encodings = Group::ALL.map(|group| of_level.encoding(group));
        let mut encoder = LevelEncoder::new(level.table.clone(), &needed, encodings, options);
        let planes = encoder.planes();
        let put = |x, channel, plane: &[f32]| planes.put(x, channel, plane);
        for_each_plane(level, number, put, |planes| encoder.take(planes))?;
        levels.push(encoder.finish()?);
        bytes_read += level.volumes.iter().flatten().map(Volume::bytes).sum::<u64>();
        progress.advance(Step::Encode, 1);
    }
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
    };
    let entries = container::write(&head, &levels, output)?;
    let seconds = clock.elapsed().as_secs_f64();
    Ok(BakeReport {
        output_bytes: output.length(),
        levels: level_reports(&metadata, &entries),
        pruned: Vec::new(),
        fitted: None,
        unchanged: false,
        free_space_stored: metadata.free_space,
        nonfinite_values: 0,
        stages: vec![StageReport { name: "encode", seconds, bytes: bytes_read }],
    })
}

/// Makes encodings those with the fewest bits that keep the error, where that is fewer than they have.
fn fit_encodings(
    unpacked: &Unpacked,
    max_errors: MaxErrors,
    metadata: &mut Metadata,
) -> Result<()> {
    let Metadata { levels, activation, features, .. } = metadata;
    let needed: Vec<NodeMask> =
        unpacked.levels.iter().map(|level| stored_nodes(&level.table)).collect();
    let mut spans = Vec::new();
    for (number, (level, of_level)) in unpacked.levels.iter().zip(levels.iter()).enumerate() {
        let of_values = LevelSpans::new(of_level, &needed[number], activation, *features);
        let put = |x, channel, plane: &[f32]| {
            of_values.put(x, channel, plane);
            Ok(())
        };
        for_each_plane(level, number, put, |_| Ok(()))?;
        spans.push(of_values);
    }
    let found = encodings_within(max_errors, levels, activation, &spans)?;
    for (level, found) in levels.iter_mut().zip(found) {
        let present = [&mut level.density, &mut level.diffuse, &mut level.features];
        for (encoding, found) in present.into_iter().zip(found) {
            if let (Some(encoding), Some(found)) = (encoding, found)
                && found.bits < encoding.bits
            {
                *encoding = found;
            }
        }
    }
    Ok(())
}

/// Every node of a stored block: each value counts as it is, whether anybody sees it or not.
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

/// Calls `put(x, channel, plane)` with every plane of a level, from any thread, and tells `take` which have come, a
/// block's thickness at a time.
fn for_each_plane(
    level: &UnpackedLevel,
    number: usize,
    put: impl Fn(usize, usize, &[f32]) -> Result<()> + Sync + Send,
    mut take: impl FnMut(Range<usize>) -> Result<()>,
) -> Result<()> {
    let channels: Vec<(Group, &Volume, usize)> = Group::ALL
        .into_iter()
        .zip(&level.volumes)
        .filter_map(|(group, volume)| volume.as_ref().map(|volume| (group, volume)))
        .flat_map(|(group, volume)| (0..volume.channels).map(move |c| (group, volume, c)))
        .collect();
    let BlockGrid { nodes: Nodes([nx, ny, nz]), edge } = level.table.grid();
    for first in (0..nx).step_by(edge) {
        let planes = first..nx.min(first + edge);
        parallel::map(planes.len() * channels.len(), |i| {
            let (group, volume, channel) = channels[i % channels.len()];
            let x = first + i / channels.len();
            let mut plane = vec![0.0; ny * nz];
            let mut scratch = Vec::new();
            for (y, row) in plane.chunks_exact_mut(nz).enumerate() {
                volume.read_run(channel, [x, y, 0], row, &mut scratch, |_| {})?;
                if let Some(z) = row.iter().position(|value| !value.is_finite()) {
                    let kind = ErrorKind::NonFinite { count: 1, first: [channel, x, y, z] };
                    let name = format!("level{number}.{}", group.name());
                    return Err(Error::new(kind, Place::Tensor(name)));
                }
            }
            put(x, i % channels.len(), &plane)
        })?;
        take(planes)?;
    }
    Ok(())
}
