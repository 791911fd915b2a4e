//! The whole bake, in order.
//!
//! 1. **Prune** ([`crate::prune`]): one pass over all of density finds, for every level, the nodes
//!    that must be right and the blocks that are kept.
//! 2. **Encode**: a second pass streams density and colour through all levels at once ([`stream`]),
//!    reading only what needed nodes reach, and turns each slab of blocks into compressed runs as it
//!    comes ([`encode`]). Where an error is asked for instead of bits, a pass like it goes before and
//!    finds what each level holds, lowest to highest ([`ranges`]).
//! 3. **Write** ([`crate::container`]): metadata, then the levels, coarse to fine.
//!
//! Nothing depends on the number of threads: runs are cut by frame numbers, not by who is free.

mod encode;
mod filter;
mod origin;
mod preset;
mod ranges;
mod rebake;
mod report;
mod stream;

use std::time::Instant;

use serde_json::json;

pub use encode::{Check, EncodeOptions, LevelEncoder};
pub use filter::Filter;
pub use origin::Origin;
pub(crate) use origin::hex;
pub use preset::Preset;
use ranges::{LevelSpans, check_max_error, encodings_within};
pub use rebake::{Changes, rebake};
use report::prune_reports;
pub use report::{BakeReport, GroupReport, LevelReport, PruneReport, StageReport, level_reports};
use stream::{Stream, Streamed};

use crate::baked::{
    Aside, ColorSpace, Group, LevelMetadata, Metadata, Occupancy, Table, ViewMetadata,
};
use crate::bytes::Output;
use crate::container::{self, EncodedLevel, Head, LARGEST_BLOCK};
use crate::error::{Error, Result};
use crate::field::{Nonfinite, RadianceField};
use crate::fit::{Fitted, fit};
use crate::grid::{BlockGrid, NodeMask, Nodes};
use crate::limits::Limits;
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
    /// Largest error, at any needed node of any level, of what is decoded from what was to be stored:
    /// in opacity over one interval, in colour and features from 0 to 1. Each group of each level gets
    /// the fewest bits that keep it, whatever `bits` says; 1e-6 to 0.25. Default: none, `bits` count
    pub max_error: Option<f32>,
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
            max_error: None,
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
        let max_error = provenance["options"]["max_error"].as_f64();
        options.max_error = max_error.map(|error| error as f32);
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
        rules
            .iter()
            .find(|(holds, _)| !holds)
            .map_or(Ok(()), |(_, rule)| Err(Error::usage(*rule)))?;
        check_max_error(self.max_error)
    }

    /// Options as provenance and reports name them.
    pub fn to_json(&self) -> serde_json::Value {
        let mut options = json!({
            "filter": self.filter.name(),
            "levels": self.levels,
            "bits": self.max_error.is_none().then(|| self.bits.to_string()),
            "alpha_threshold": self.alpha_threshold,
            "block_size": self.block_size,
            "zstd_level": self.zstd_level,
            "lod_scale": self.lod_scale,
            "nonfinite": match self.nonfinite {
                Nonfinite::Refuse => "refuse",
                Nonfinite::Empty => "empty",
            },
        });
        if let Some(max_error) = self.max_error {
            options["max_error"] = max_error.into();
        }
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
    let mut metadata = metadata(field, options, &sizes, &tables, pruned.keeps_mask);
    let stream = Stream { planes: &planes, options, pruned: &pruned, fitted: fitted.as_ref() };
    if let Some(max_error) = options.max_error {
        let bytes = fit_encodings(&stream, max_error, &mut metadata, progress)?;
        stage("ranges", bytes);
    }
    let (encoded, streamed) = encode_levels(&stream, &metadata, tables, progress)?;
    let nonfinite = pruned.nonfinite + planes.take_nonfinite()?.count;
    stage("encode", streamed.bytes_read);
    let digest = origin.digest(&pruned.density_checksums, &streamed.checksums);

    progress.begin(Step::Write, 1);
    let head = Head {
        metadata: &metadata,
        view_mlp: field.view_mlp.as_ref(),
        free_space: field.free_space.as_ref().filter(|_| pruned.keeps_mask),
        provenance: &origin.provenance(&digest, options.to_json()),
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

/// Makes the levels' encodings those with the fewest bits within an error, by what the levels hold.
/// Returns the bytes that were read.
fn fit_encodings(
    stream: &Stream,
    max_error: f32,
    metadata: &mut Metadata,
    progress: &dyn Progress,
) -> Result<u64> {
    let Metadata { levels, activation, features, .. } = metadata;
    let spans = levels.iter().map(|level| LevelSpans::new(level, activation, *features));
    let mut spans: Vec<LevelSpans> = spans.collect();
    let streamed = stream.run(Step::Ranges, progress, |level, slab| {
        spans[level].take(slab, &stream.pruned.levels[level].needed)
    })?;
    // The pass that encodes finds the same again, and counts it.
    stream.planes.take_nonfinite()?;
    let found = encodings_within(max_error, levels, activation, &spans)?;
    for (level, [density, diffuse, features]) in levels.iter_mut().zip(found) {
        (level.density, level.diffuse, level.features) = (density, diffuse, features);
    }
    Ok(streamed.bytes_read)
}

/// Streams the field through all levels and encodes them.
fn encode_levels(
    stream: &Stream,
    metadata: &Metadata,
    tables: Vec<Table>,
    progress: &dyn Progress,
) -> Result<(Vec<EncodedLevel>, Streamed)> {
    let encode_options = EncodeOptions {
        features: metadata.features,
        activation: metadata.activation,
        zstd_level: stream.options.zstd_level,
        check: None,
    };
    let mut encoders = Vec::new();
    for ((level, pruned), table) in metadata.levels.iter().zip(&stream.pruned.levels).zip(tables) {
        let encodings = Group::ALL.map(|group| level.encoding(group));
        encoders.push(LevelEncoder::new(table, &pruned.needed, encodings, encode_options));
    }
    let streamed = stream.run(Step::Encode, progress, |level, slab| encoders[level].take(slab))?;
    Ok((encoders.into_iter().map(LevelEncoder::finish).collect::<Result<_>>()?, streamed))
}
