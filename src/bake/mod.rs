//! The whole bake, in order.
//!
//! 1. **Prune** ([`crate::prune`]): one pass over all of density finds, for every level, the nodes
//!    that must be right and the blocks that are kept.
//! 2. **Encode**: a second pass streams density and colour through all levels at once
//!    ([`crate::mips::Cascade`]), reading only what needed nodes reach, and turns each slab of
//!    blocks into compressed runs as it comes ([`encode`]).
//! 3. **Write** ([`crate::container`]): metadata, then the levels, coarse to fine.
//!
//! Nothing depends on the number of threads: runs are cut by frame numbers, not by who is free.

mod encode;
mod filter;
mod origin;
mod preset;
mod rebake;
mod report;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use serde_json::json;

pub use encode::{EncodeOptions, LevelEncoder};
pub use filter::Filter;
pub use origin::Origin;
pub use preset::Preset;
pub use rebake::{Changes, rebake};
use report::prune_reports;
pub use report::{BakeReport, LevelReport, PruneReport, StageReport, level_reports};

use crate::baked::{
    Aside, ColorSpace, Group, LevelMetadata, Metadata, Occupancy, Table, ViewMetadata,
};
use crate::bytes::Output;
use crate::container::{self, EncodedLevel, Head, LARGEST_BLOCK};
use crate::error::{Error, ErrorKind, Place, Result};
use crate::field::{Nonfinite, Planes, RadianceField, verify_crc32};
use crate::fit::{Fitted, fit};
use crate::grid::{BlockGrid, NodeMask, Nodes};
use crate::limits::Limits;
use crate::mips::{Cascade, Regions, Settler};
use crate::progress::{Progress, Step};
use crate::prune::{self, DensityFilter, Pruned};
use crate::quantize::{Bits, color_encoding, density_encoding};

/// Compression level of zstd where nobody says another: the last that is fast enough to be no
/// bottleneck.
const DEFAULT_ZSTD_LEVEL: i32 = 1;

/// More steps than any fit needs by far.
const MOST_FIT_STEPS: usize = 100_000;

/// What a bake makes of a field.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct BakeOptions {
    /// How coarser levels are made. Default: [`Filter::RateTent`], which looks right from
    /// afar
    pub filter: Filter,
    /// Levels in all, at most. Default: down to 4 nodes along the longest axis
    pub levels: Option<usize>,
    /// Bits of a code. Default: 8
    pub bits: Bits,
    /// Opacity over one interval up to which blocks are dropped. Default: 1e-3
    pub alpha_threshold: f32,
    /// Nodes along a block's edge. Default: 8
    pub block_size: usize,
    /// Compression level of zstd, 1 to 22. Default: 1
    pub zstd_level: i32,
    /// Multiplies the filter's level-of-detail factor. Default: 1
    pub lod_scale: f32,
    /// Steps of a fit for each level; only [`Filter::Fit`] takes any. Default: 150
    pub fit_steps: usize,
    /// What happens to values that are not finite. Default: refuse
    pub nonfinite: Nonfinite,
}

impl Default for BakeOptions {
    fn default() -> Self {
        Self {
            filter: Filter::RateTent,
            levels: None,
            bits: Bits::Integer(8),
            alpha_threshold: 1e-3,
            block_size: 8,
            zstd_level: DEFAULT_ZSTD_LEVEL,
            lod_scale: 1.0,
            fit_steps: 150,
            nonfinite: Nonfinite::Refuse,
        }
    }
}

impl BakeOptions {
    /// The options that made a container, as far as its metadata and provenance tell.
    pub fn of_container(metadata: &Metadata, provenance: &serde_json::Value) -> Self {
        let mut options = Self::default();
        options.filter = metadata.filter.parse().unwrap_or(options.filter);
        options.levels = Some(metadata.levels.len());
        options.alpha_threshold = metadata.alpha_threshold;
        if let Some(finest) = metadata.levels.first() {
            options.block_size = finest.block_size;
            options.bits = finest.diffuse.as_ref().map_or(options.bits, Bits::of);
        }
        let zstd_level = provenance["options"]["zstd_level"].as_i64();
        let zstd_level = zstd_level.and_then(|level| i32::try_from(level).ok());
        options.zstd_level = zstd_level.unwrap_or(options.zstd_level);
        options
    }

    /// Refuses values that no bake can follow.
    pub fn check(&self) -> Result<()> {
        let bits_fit = match self.bits {
            Bits::Integer(bits) => (4..=16).contains(&bits),
            Bits::F16 | Bits::F32 => true,
        };
        let rules = [
            (bits_fit, "--bits must be 4 to 16, f16 or f32"),
            (self.levels.is_none_or(|levels| levels >= 1), "--levels must be at least 1"),
            (
                self.alpha_threshold >= 1e-9 && self.alpha_threshold < 1.0,
                "--alpha-threshold must be from 1e-9 to below 1",
            ),
            ((1..=LARGEST_BLOCK).contains(&self.block_size), "--block-size must be 1 to 64"),
            ((1..=22).contains(&self.zstd_level), "--zstd-level must be 1 to 22"),
            (self.fit_steps <= MOST_FIT_STEPS, "--fit-steps must be at most 100000"),
            (self.lod_scale > 0.0 && self.lod_scale.is_finite(), "--lod-scale must be above 0"),
        ];
        rules.iter().find(|(holds, _)| !holds).map_or(Ok(()), |(_, rule)| Err(Error::usage(*rule)))
    }

    /// Options as provenance and reports name them.
    pub fn to_json(&self) -> serde_json::Value {
        let mut options = json!({
            "filter": self.filter.name(),
            "levels": self.levels,
            "bits": self.bits.to_string(),
            "alpha_threshold": self.alpha_threshold,
            "block_size": self.block_size,
            "zstd_level": self.zstd_level,
            "lod_scale": self.lod_scale,
            "nonfinite": match self.nonfinite {
                Nonfinite::Refuse => "refuse",
                Nonfinite::Empty => "empty",
            },
        });
        if self.filter == Filter::Fit {
            options["fit_steps"] = self.fit_steps.into();
        }
        options
    }
}

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

    let sizes = options.filter.level_sizes(field.scene.nodes, options.levels);
    let planes = prune::masked_planes(field, options.nonfinite)?;
    let (filter, activation) = (options.filter, &field.scene.activation);
    let density_filter = filter
        .filters_density()
        .then(|| DensityFilter { kernel: filter.kernel(), matter: filter.matter(activation) });
    let pruned = prune::prune(&planes, &sizes, density_filter, options.alpha_threshold, progress)?;
    stage("prune", field.density.bytes());

    let fitted = match options.filter {
        Filter::Fit => {
            let fitted = fit_levels(field, options, &sizes, &pruned, progress)?;
            stage("fit", 0);
            Some(fitted)
        }
        _ => None,
    };
    let tables = tables(&pruned, options.block_size)?;
    let metadata = metadata(field, options, &sizes, &tables, pruned.keeps_mask);
    let encoded =
        encode_levels(&planes, options, &metadata, &pruned, tables, fitted.as_ref(), progress)?;
    let nonfinite = pruned.nonfinite + planes.take_nonfinite()?.count;
    stage("encode", encoded.bytes_read);
    let digest = origin.digest(&pruned.density_checksums, &encoded.checksums);

    progress.begin(Step::Write, 1);
    let head = Head {
        metadata: &metadata,
        view_mlp: field.view_mlp.as_ref(),
        free_space: field.free_space.as_ref().filter(|_| pruned.keeps_mask),
        provenance: &origin.provenance(&digest, options.to_json()),
        zstd_level: options.zstd_level,
    };
    let entries = container::write(&head, &encoded.levels, output)?;
    progress.advance(Step::Write, 1);
    stage("write", output.length());
    let levels = level_reports(&metadata, &entries);
    Ok(BakeReport {
        output_bytes: output.length(),
        levels,
        pruned: prune_reports(&pruned),
        free_space_stored: pruned.keeps_mask,
        nonfinite_values: nonfinite,
        stages,
    })
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
    levels.level_of_detail = options.filter.level_of_detail(Aside::SameDistance, options.lod_scale);
    let needed: Vec<&NodeMask> = pruned.levels.iter().map(|level| &level.needed).collect();
    fit(field, levels, &needed, pruned.keeps_mask, options.fit_steps, &Limits::default(), progress)
}

fn tables(pruned: &Pruned, edge: usize) -> Result<Vec<Table>> {
    let occupancy = |kept: bool| if kept { Occupancy::Stored } else { Occupancy::Empty };
    let table = |needed: &NodeMask| {
        let blocks = needed.blocks(edge)?.into_iter().map(occupancy).collect();
        Ok(Table::new(BlockGrid { nodes: needed.nodes(), edge }, blocks))
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
    let density = |level: usize| {
        density_encoding(options.bits, options.filter.decode(level), &scene.activation)
    };
    let color = color_encoding(options.bits);
    let level = |(number, (nodes, table)): (usize, (&Nodes, &Table))| {
        let has_density = number == 0 || options.filter.filters_density();
        LevelMetadata {
            dimensions: nodes.0,
            block_size: options.block_size,
            blocks_stored: table.frames(),
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
        level_of_detail: options.filter.level_of_detail(Aside::SameDistance, options.lod_scale),
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

struct Encoded {
    levels: Vec<EncodedLevel>,
    /// Bytes of density and colour that were read.
    bytes_read: u64,
    /// CRC-32 of what was read of each colour channel of each plane.
    checksums: Vec<u32>,
}

/// Streams the field through all levels.
fn encode_levels(
    planes: &Planes,
    options: &BakeOptions,
    metadata: &Metadata,
    pruned: &Pruned,
    tables: Vec<Table>,
    fitted: Option<&Fitted>,
    progress: &dyn Progress,
) -> Result<Encoded> {
    let needed_nodes = planes.field().scene.nodes;
    let matter = options.filter.matter(&planes.field().scene.activation);
    let mut needed = Vec::with_capacity(pruned.levels.len());
    for (level, pruned) in pruned.levels.iter().enumerate() {
        // Matter settles with the colour of the nodes around it.
        needed.push(match matter.is_some() && level > 0 {
            true => pruned.needed.cells_with_a_corner()?.corners()?,
            false => pruned.needed.clone(),
        });
    }
    let regions = Regions::new(needed, options.filter.kernel())?;
    let channels = planes.channels();
    let lift = options.filter.lift(&metadata.activation, channels);
    let encode_options = EncodeOptions {
        features: metadata.features,
        activation: metadata.activation,
        zstd_level: options.zstd_level,
    };
    let mut encoders = Vec::new();
    for ((level, pruned), table) in metadata.levels.iter().zip(&pruned.levels).zip(tables) {
        let encodings = Group::ALL.map(|group| level.encoding(group));
        encoders.push(LevelEncoder::new(table, &pruned.needed, encodings, encode_options));
    }
    let mut settlers: Vec<Option<Settler>> = pruned
        .levels
        .iter()
        .enumerate()
        .map(|(level, pruned)| Some(Settler::new(matter?, &pruned.needed)).filter(|_| level > 0))
        .collect();
    let nx = metadata.levels[0].dimensions[0];
    progress.begin(Step::Encode, nx as u64);
    let bytes_read = AtomicU64::new(0);
    let hashers = Mutex::new(vec![crc32fast::Hasher::new(); nx * (channels - 1)]);
    let whole = reads_whole_color(planes, regions.level(0)).then(|| NodeMask::full(needed_nodes));
    Cascade::new(&regions, channels, lift, options.block_size).run(
        |x, channel, region, plane| {
            let Some(color) = channel.checked_sub(1) else {
                let read = planes.read(channel, x, region, plane)?;
                bytes_read.fetch_add(read.bytes, Ordering::Relaxed);
                return Ok(());
            };
            let region = whole.as_ref().map_or(region, |whole| whole.plane(x));
            let read = planes.read(channel, x, region, plane)?;
            bytes_read.fetch_add(read.bytes, Ordering::Relaxed);
            let mut hashers = hashers.lock().unwrap_or_else(PoisonError::into_inner);
            hashers[color * nx + x] = read.checksum;
            Ok(())
        },
        |level, slab| {
            if level == 0 {
                progress.advance(Step::Encode, slab.count() as u64);
            }
            if progress.cancelled() {
                return Err(Error::new(ErrorKind::Cancelled, Place::File));
            }
            match &mut settlers[level] {
                Some(settler) => settler.take(slab)?.iter_mut().try_for_each(|slab| {
                    if let Some(fitted) = fitted {
                        fitted.replace(level, slab);
                    }
                    encoders[level].take(slab)
                }),
                None => encoders[level].take(slab),
            }
        },
    )?;
    let hashers = hashers.into_inner().unwrap_or_else(PoisonError::into_inner);
    if let (Some(expected), Some(_)) = (planes.color_crc32(), whole) {
        verify_crc32("k0", &hashers, expected)?;
    }
    Ok(Encoded {
        levels: encoders.into_iter().map(LevelEncoder::finish).collect::<Result<_>>()?,
        bytes_read: bytes_read.into_inner(),
        checksums: hashers.into_iter().map(crc32fast::Hasher::finalize).collect(),
    })
}

/// Whether to read all of colour: where nearly all of it is needed anyway, the rest costs little and
/// lets the file's checksum be verified.
fn reads_whole_color(planes: &Planes, region: &NodeMask) -> bool {
    planes.color_crc32().is_some() && 8 * region.count() >= 7 * region.nodes().count() as u64
}
