//! `transcode`.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;

use super::bake::{Baked, Work};
use super::common::Common;
use super::field::{FieldArguments, wrong_kind};
use super::outcome::{Outcome, warn};
use super::output::{create_container, digest};
use super::placement::PlacementArguments;
use super::progress::Bar;
use super::thumbnail::ThumbnailArguments;
use super::values::{by_name, parse_box};
use super::view_report::ViewReport;
use crate::bake::{Changes, MaxErrors, repack};
use crate::base::bytes::ByteSink;
use crate::base::error::Result;
use crate::base::text::parse_bytes;
use crate::model::grid::Bounds;
use crate::quantize::Bits;
use crate::unpacked::Unpacked;

/// Make a container smaller, cut it, or move it
///
/// The checkpoint is not needed.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  mipvog-bake transcode scene.mipvog -o small.mipvog --max-bytes 2MB
  mipvog-bake transcode scene.mipvog -o far.mipvog --without-finest 1
  mipvog-bake transcode scene.mipvog -o clean.mipvog --drop-islands 100
  mipvog-bake transcode scene.mipvog -o upright.mipvog --up y --scale 0.5")]
pub struct Arguments {
    /// Container, or a glTF asset with one; - means standard input
    file: PathBuf,
    /// Container to write; - means standard output
    #[arg(short, long, value_name = "OUT.mipvog")]
    output: PathBuf,
    /// Overwrite the output if it exists
    #[arg(long)]
    force: bool,
    /// Remove everything outside this box, in world coordinates; it is widened to whole voxels
    #[arg(long, value_name = "X0,Y0,Z0,X1,Y1,Z1", allow_hyphen_values = true,
          value_parser = parse_box)]
    crop: Option<Bounds>,
    /// Remove floaters: connected parts with fewer visible voxels than this
    #[arg(long, value_name = "VOXELS")]
    drop_islands: Option<u64>,
    #[command(flatten)]
    thumbnail: ThumbnailArguments,
    #[command(flatten)]
    which: FieldArguments,
    #[command(flatten)]
    place: PlacementArguments,
    /// Number of finest levels to drop
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Levels")]
    without_finest: usize,
    /// Number of outermost boxes of a world to drop; the background shows behind the rest
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Levels")]
    without_outermost: usize,
    /// Maximum number of levels to keep; the coarsest are dropped [default: all]
    #[arg(long, value_name = "N", help_heading = "Levels")]
    levels: Option<usize>,
    /// Bits per stored value: 4 to 16, f16 or f32 [default: unchanged]
    #[arg(long, value_name = "BITS", value_parser = by_name::<Bits>(),
          help_heading = "Size and error")]
    bits: Option<Bits>,
    /// Largest error relative to the container's values, as `bake --max-error`; values that already
    /// have no more bits are not changed. Replaces --bits
    #[arg(long, value_name = "ERROR", conflicts_with = "bits", help_heading = "Size and error")]
    max_error: Option<MaxErrors>,
    /// Largest size of the output, such as 3MB or 500KiB; the best quality that fits is chosen, and
    /// the finest levels are dropped if nothing fits. Replaces --bits and --max-error
    #[arg(long, value_name = "BYTES", value_parser = parse_bytes,
          conflicts_with_all = ["bits", "max_error"], help_heading = "Size and error")]
    max_bytes: Option<u64>,
    /// Compression level of zstd, 1 to 22 [default: unchanged]
    #[arg(long, value_name = "LEVEL", help_heading = "Size and error",
          value_parser = clap::value_parser!(i32).range(1..=22))]
    zstd_level: Option<i32>,
}

/// Transcodes a container.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    let clock = Instant::now();
    let limits = common.limits();
    arguments.which.check(&[&arguments.file])?;
    let container = arguments.which.container(&arguments.file, &limits)?;
    let container = container.ok_or_else(|| {
        wrong_kind(&arguments.file, "a .mipvog container, or a glTF asset with one")
    })?;
    let changes = Changes {
        bits: arguments.bits,
        max_error: arguments.max_error,
        max_bytes: arguments.max_bytes,
        without_finest: arguments.without_finest,
        without_outermost: arguments.without_outermost,
        levels: arguments.levels,
        crop: arguments.crop,
        drop_islands: arguments.drop_islands,
        placement: arguments.place.placement(),
        zstd_level: arguments.zstd_level,
        ..Changes::default()
    };
    let mut output = create_container(&arguments.output, arguments.force)?;
    let bar = Bar::new(common);
    let unpacked = Unpacked::of_container(&container)?;
    let report = repack(&unpacked, &changes, &limits, &mut output, &bar);
    let mut report = report.map_err(|error| error.in_file(&arguments.file))?;
    let thumbnail = arguments.thumbnail;
    output = thumbnail.add(output, &arguments.output, arguments.force, &limits, &bar)?;
    report.set_output_bytes(ByteSink::length(&output));
    drop(bar);
    if report.levels.iter().all(|level| level.blocks_stored == 0) {
        warn("nothing is left of the scene: the container is empty", common);
    }
    let sha256 = Some(digest(output.written())?);
    output.finish()?;
    let inputs = vec![arguments.file.clone()];
    let resolved = changes.to_json();
    let view = ViewReport::of(container.metadata().view.as_ref());
    let baked = Baked {
        report,
        resolved,
        settings: Vec::new(),
        view,
        gate: None,
        inputs,
        unmeasured: None,
        input_bytes: container.file().length(),
    };
    let work = Work {
        input: &arguments.file,
        output: &arguments.output,
        seconds: clock.elapsed().as_secs_f64(),
        bytes_read: container.file().bytes_read(),
        sha256,
    };
    baked.outcome("transcode", &work, None, common)
}
