//! `export`.

use std::path::PathBuf;
use std::time::Instant;

use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::{Args, ValueEnum};

use super::cameras::{CameraArguments, check_memory};
use super::common::Common;
use super::export_report::ExportReport;
use super::export_source::FieldRequest;
use super::field::FieldArguments;
use super::folders::input_path;
use super::outcome::{Outcome, denied};
use super::output::refuse_stdout;
use super::progress::Bar;
use super::scene::SceneArguments;
use super::values::parse_box;
use crate::base::error::{Error, ErrorKind, Result};
use crate::base::limits::LimitName;
use crate::base::progress::Step;
use crate::base::text::parse_bytes;
use crate::formats::{FORMATS, format_of, other_names};
use crate::model::camera::Camera;
use crate::model::grid::Bounds;
use crate::view::{overview, panorama};
use mipvog_outputs::export_files::ExportFiles;
use mipvog_outputs::format::{ExportFormat, ExportOptions, UpAxis};
use mipvog_outputs::measure::export_errors;

/// Pictures that look around inside a world, where no camera is given.
const VIEWS: usize = 4;

/// Write another program's format, and measure the loss
///
/// The written bytes are read back and rendered by the rules of the format's programs. The report
/// states the PSNR against the field's own pictures, and what the format cannot represent.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  mipvog-bake export scene.mipvog --to html -o site/
  mipvog-bake export scene.mipvog -o page.html
  mipvog-bake export scene.mipvog -o scene.vdb --supersample 4
  mipvog-bake export scene.mipvog -o mesh.glb
  mipvog-bake export scene.mipvog -o splats.spz")]
pub struct Arguments {
    /// A container, a glTF asset with one, or anything that can be baked; - means standard input
    #[arg(value_parser = input_path())]
    field: PathBuf,
    /// Format [default: by the extension of the output]
    #[arg(long, value_name = "FORMAT", value_parser = PossibleValuesParser::new(format_names()))]
    to: Option<String>,
    /// File or folder to write. Other files of an export go beside the file; html and snerg also
    /// take a folder
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Level to export; 0 is the finest
    #[arg(long, value_name = "K", default_value_t = 0)]
    level: usize,
    /// Box of a world to export; 0 is the innermost. Larger ones have a hole where the next smaller
    /// box is [default: 0, and all of them for html, glb and splat]
    #[arg(long = "box", value_name = "K")]
    nested_box: Option<usize>,
    /// Points per voxel along each axis, 1 to 16; more keep surfaces sharper [default: the
    /// format's]
    #[arg(long, value_name = "K", conflicts_with = "resolution")]
    supersample: Option<usize>,
    /// Leave out everything outside this box, in world coordinates
    #[arg(long, value_name = "X0,Y0,Z0,X1,Y1,Z1", allow_hyphen_values = true,
          value_parser = parse_box)]
    crop: Option<Bounds>,
    /// Also write coarser levels, for Mip-VoG's viewer
    #[arg(long, help_heading = "SNeRG")]
    mips: bool,
    /// The up axis of the written file; y maps positions from (x, y, z) to (x, z, -y) [default: z]
    #[arg(long, value_enum, value_name = "z|y", help_heading = "OpenVDB and USD")]
    up: Option<Up>,
    /// Write float32 values instead of half floats
    #[arg(long, help_heading = "OpenVDB and USD")]
    float32: bool,
    /// Divide densities by the largest one, and store it in the grid's metadata
    #[arg(long, help_heading = "OpenVDB and USD")]
    normalize_density: bool,
    /// Also write the features of a view network, or harmonics, as grids feature_0, feature_1, ...
    #[arg(long, help_heading = "OpenVDB and USD")]
    features: bool,
    /// Maximum number of Gaussian splats; the most visible ones are kept [default: 100000]
    #[arg(long, value_name = "N", help_heading = "Splats")]
    splats: Option<usize>,
    /// Maximum number of triangles [default: 100000]
    #[arg(long, value_name = "N", help_heading = "Mesh")]
    triangles: Option<usize>,
    /// Write nothing and exit with 1 if the PSNR in dB against the field is below this. The PSNR is
    /// that over the pixels of all cameras
    #[arg(long, value_name = "DB")]
    require_psnr: Option<f64>,
    /// Memory limit for values, such as 500MB or 2GiB [default: --limit memory]
    #[arg(long, value_name = "BYTES", value_parser = parse_bytes)]
    memory: Option<u64>,
    #[command(flatten)]
    which: FieldArguments,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    cameras: CameraArguments,
    #[command(flatten)]
    scene: SceneArguments,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Up {
    /// As in training
    Z,
    /// As in Houdini and most film tools
    Y,
}

/// Exports.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    export(arguments, common).map_err(|error| match error.kind() {
        // The nearer bound is the one to raise.
        ErrorKind::OverLimit { limit: Some(LimitName::Memory), .. }
            if arguments.memory.is_some_and(|own| own < common.limits().memory) =>
        {
            error.advise("raise --memory")
        }
        _ => error,
    })
}

fn export(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    let clock = Instant::now();
    refuse_stdout(&arguments.output, "an export may have several files")?;
    let format = format_of(arguments.to.as_deref(), &arguments.output)?;
    if arguments.require_psnr.is_some_and(|least| !least.is_finite()) {
        return Err(Error::usage("--require-psnr must be a finite number of dB"));
    }
    arguments.check_options(format)?;
    let mut options = arguments.options(common);
    let bar = Bar::new(common);
    bar.plan(vec![
        (Step::Encode, 1.0),
        (Step::Targets, 1.0),
        (Step::Fit, 5.0),
        (Step::Write, 0.3),
        (Step::Render, 1.0),
    ]);
    let camera_file = arguments.cameras.file();
    let request = FieldRequest {
        path: &arguments.field,
        which: arguments.which,
        nested_box: arguments.nested_box,
        scene: &arguments.scene,
        cameras: camera_file.as_ref(),
    };
    let (source, mut lost) = request.open(format, &options, common)?;
    let levels = source.field.levels();
    let expected = format!("a level below {levels}");
    Error::require_option(options.level < levels, "level", options.level, &expected)?;
    let cameras = match arguments.cameras.given() {
        true => arguments.cameras.cameras(&source.field.view().bounds, common)?,
        false => Vec::new(),
    };
    check_memory(&cameras, 1, &options.limits)?;
    options.cameras.clone_from(&cameras);
    format.check(&source, &options, &arguments.output)?;
    let mut files = ExportFiles::new(&arguments.output, arguments.force);
    let in_file = |error: Error| error.in_file(&arguments.field);
    let exported = format.write(&source, &options, &mut files, &bar).map_err(in_file)?;
    lost.extend(exported.lost);
    let size = arguments.cameras.size().unwrap_or([format.side(); 2]);
    let cameras = match cameras.is_empty() {
        true if source.world.is_some() => panorama(&source.field, VIEWS, size, &bar)?,
        true => vec![overview(&source.field, size, &bar)?],
        false => cameras,
    };
    let written = files.written();
    let shown = format.read_back(&source, &written, &options.limits)?;
    let errors = export_errors(&source.field, &*shown, &cameras, options.level, &bar)?;
    drop(shown);
    let reached = arguments.require_psnr.is_none_or(|least| errors.pooled_psnr >= least);
    let denied = denied(common);
    let passed = reached && denied.is_none();
    let reports = if passed { written.report()? } else { Vec::new() };
    bar.check()?;
    if passed {
        files.finish()?;
    }
    drop(bar);
    let report = ExportReport {
        input: arguments.field.to_string_lossy().into_owned(),
        output: arguments.output.to_string_lossy().into_owned(),
        format: format.name(),
        level: options.level,
        seconds: clock.elapsed().as_secs_f64(),
        output_bytes: reports.iter().map(|file| file.bytes).sum(),
        files: reports,
        psnr: Some(errors.psnr),
        pooled_psnr: Some(errors.pooled_psnr),
        cameras: cameras.len(),
        picture_size: cameras.first().map_or(size, |Camera { lens, .. }| [lens.width, lens.height]),
        required_psnr: arguments.require_psnr,
        passed,
        lost,
        details: exported.details,
    };
    let output = arguments.output.display();
    let missed = arguments.require_psnr.filter(|_| !reached).map(|least| {
        let psnr = errors.pooled_psnr;
        format!("{output}: not written: {psnr:.2} dB against the field, {least} dB required")
    });
    let failure = missed.or_else(|| Some(format!("{output}: not written: {}", denied?)));
    let outcome = Outcome::new("export", &report, report.text())?;
    Ok(Outcome { failure, ..outcome })
}

/// The formats, with other names that are understood.
fn format_names() -> Vec<PossibleValue> {
    let named = |format: &dyn ExportFormat| {
        PossibleValue::new(format.name()).aliases(other_names(format.name()))
    };
    FORMATS.into_iter().map(named).collect()
}

impl Arguments {
    /// Refuses options that the format does not take.
    fn check_options(&self, format: &dyn ExportFormat) -> Result<()> {
        let given = [
            ("supersample", self.supersample.is_some()),
            ("resolution", self.scene.resolution.is_some()),
            ("crop", self.crop.is_some()),
            ("mips", self.mips),
            ("up", self.up.is_some()),
            ("float32", self.float32),
            ("normalize_density", self.normalize_density),
            ("features", self.features),
            ("splats", self.splats.is_some()),
            ("triangles", self.triangles.is_some()),
        ];
        let refused = given.iter().find(|(name, given)| *given && !format.options().contains(name));
        match refused {
            None => Ok(()),
            Some((name, _)) => {
                let option = name.replace('_', "-");
                let takers = FORMATS.into_iter().filter(|other| other.options().contains(name));
                let takers: Vec<&str> = takers.map(|other| other.name()).collect();
                let (own, takers) = (format.name(), takers.join(", "));
                Err(Error::usage(format!("--{option} belongs to --to {takers}, not to {own}")))
            }
        }
    }

    fn options(&self, common: &Common) -> ExportOptions {
        let mut limits = common.limits();
        limits.memory = self.memory.unwrap_or(limits.memory).min(limits.memory);
        ExportOptions {
            level: self.level,
            supersample: self.supersample,
            resolution: self.scene.resolution,
            crop: self.crop,
            mips: self.mips,
            up: if self.up == Some(Up::Y) { UpAxis::Y } else { UpAxis::Z },
            float32: self.float32,
            normalize_density: self.normalize_density,
            features: self.features,
            splats: self.splats,
            triangles: self.triangles,
            limits,
            ..ExportOptions::default()
        }
    }
}
