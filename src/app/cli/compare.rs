//! `compare`.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::common::Common;
use super::field::FieldArguments;
use super::outcome::Outcome;
use super::output::create as create_output;
use super::progress::Bar;
use super::render::CameraArguments;
use super::scene::SceneArguments;
use super::values::Background;
use crate::bake::Filter;
use crate::base::bytes::ByteSink;
use crate::base::error::{Error, Result};
use crate::base::picture;
use crate::base::progress::{Progress, Step};
use crate::model::camera::Camera;
use crate::view::compare::{FrameErrors, Reference, ScaleErrors, compare};

/// An error of this much is white in heat maps.
const FULL_HEAT: f32 = 0.25;

/// Measure a field against another one, or against a folder of pictures, at every scale
#[derive(Debug, Args)]
pub struct Arguments {
    /// The right pictures: a container, a glTF asset, a trained input, or a folder of pictures
    reference: PathBuf,
    /// The field to measure: a container, a glTF asset or a trained input
    field: PathBuf,
    #[command(flatten)]
    cameras: CameraArguments,
    /// Scales to measure: full size, a half, a quarter and so on
    #[arg(long, value_name = "S,...", value_delimiter = ',', default_value = "1,2,4,8",
          value_parser = clap::value_parser!(u16).range(1..=1024))]
    scales: Vec<u16>,
    /// Rays along each side of a pixel of the reference
    #[arg(long, value_name = "N", default_value_t = 1,
          value_parser = clap::value_parser!(u8).range(1..=16))]
    supersample: u8,
    /// Coarser levels for a trained field, as `bake --filter` [default: level 0 alone]
    #[arg(long, value_name = "NAME")]
    filter: Option<Filter>,
    /// Write heat maps of the error into this folder: black is none, white 0.25 or more
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    which: FieldArguments,
    #[command(flatten)]
    scene: SceneArguments,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
}

#[derive(Debug, Serialize)]
struct Report {
    reference: String,
    field: String,
    supersample: u8,
    scales: Vec<ScaleErrors>,
}

/// Compares.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    let scene = &arguments.scene;
    let field = scene.open(&arguments.field, arguments.which, arguments.filter, common)?;
    let reference = if arguments.reference.is_dir() {
        let folder = arguments.reference.clone();
        let background = scene.background.map_or(field.view().background, |Background(b)| b);
        Reference::Pictures { folder, background, limits: common.limits() }
    } else {
        Reference::Field(Box::new(scene.open(
            &arguments.reference,
            arguments.which,
            None,
            common,
        )?))
    };
    let cameras = arguments.cameras.cameras(&field.view().bounds, &common.limits())?;
    let scales = checked_scales(&arguments.scales, &cameras)?;
    if let Some(folder) = &arguments.output {
        std::fs::create_dir_all(folder).map_err(|error| Error::io(error, folder))?;
    }
    let bar = Bar::new(common);
    bar.begin(Step::Render, (cameras.len() * (1 + scales.len())) as u64);
    let supersample = arguments.supersample.into();
    let heat = |frame: &FrameErrors| arguments.write_heat_map(frame);
    let errors = compare(&reference, &field, &cameras, &scales, supersample, &bar, heat)?;
    drop(bar);
    let text = errors_text(&errors);
    let report = Report {
        reference: arguments.reference.to_string_lossy().into_owned(),
        field: arguments.field.to_string_lossy().into_owned(),
        supersample: arguments.supersample,
        scales: errors,
    };
    Outcome::new("compare", &report, text)
}

/// Scales at which every picture has a pixel left, each once.
pub fn checked_scales(asked: &[u16], cameras: &[Camera]) -> Result<Vec<usize>> {
    let mut scales: Vec<usize> = Vec::new();
    for scale in asked.iter().copied().map(usize::from) {
        if !scales.contains(&scale) {
            scales.push(scale);
        }
    }
    let smallest = cameras.iter().flat_map(|camera| [camera.lens.width, camera.lens.height]).min();
    if scales.iter().any(|&scale| smallest.is_some_and(|side| scale > side)) {
        return Err(Error::usage("--scales leaves no pixel of the pictures"));
    }
    Ok(scales)
}

/// A table of errors.
pub fn errors_text(errors: &[ScaleErrors]) -> String {
    let number = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
    };
    let mut text =
        String::from("  scale      PSNR      SSIM   largest      99 %   diffuse   opacity\n");
    for error in errors {
        writeln!(
            text,
            "  1/{:<4} {:>8.2} {:>9} {:>9.4} {:>9.4} {:>9} {:>9}",
            error.scale,
            error.psnr,
            number(error.ssim, 4),
            error.max_abs,
            error.p99_abs,
            number(error.psnr_diffuse, 2),
            number(error.psnr_opacity, 2),
        )
        .ok();
    }
    text
}

impl Arguments {
    fn write_heat_map(&self, errors: &FrameErrors) -> Result<()> {
        let Some(folder) = &self.output else { return Ok(()) };
        let path = folder.join(format!("{}.s{}.error.png", errors.frame, errors.scale));
        let map = errors.want.heat_map(errors.got, FULL_HEAT);
        let mut output = create_output(&path, self.force)?;
        output.append(&picture::png(errors.want.width, errors.want.height, &map)?)?;
        output.finish()
    }
}
