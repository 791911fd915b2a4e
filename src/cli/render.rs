//! `render`.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde::Serialize;

use super::cameras::{CameraArguments, check_memory, checked_scales};
use super::common::Common;
use super::destination::Destination;
use super::detail::{check_levels, parse_levels};
use super::field::FieldArguments;
use super::folders::input_path;
use super::layout::{Table, columns, folded};
use super::outcome::{Outcome, counted, readable};
use super::output::digest;
use super::pictures::{PictureOptions, Pictures};
use super::progress::Bar;
use super::scene::SceneArguments;
use super::settings::Settings;
use super::viewpoints::ViewpointArguments;
use crate::bake::Filter;
use crate::base::error::Result;
use crate::base::progress::{Progress, Step};
use crate::model::camera::Camera;
use crate::view::render::{FrameOptions, LevelChoice, Renderer, Statistics, render, tiles};

/// Render pictures or a film
///
/// The name of the output decides its kind: a folder of pictures, one picture (.png, .exr), or a
/// film (.gif, .webp; .mp4, .webm and .mov need ffmpeg). Without cameras, one picture of the whole
/// scene is rendered. A failed run leaves no new files.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mipvog-bake render scene.mipvog -o scene.png --alpha
  mipvog-bake render scene.mipvog --turntable 75 --size 400 -o spin.gif
  mipvog-bake render scene.mipvog --cameras transforms.json --scales 1,2,4,8 --sheet -o pictures/")]
pub struct Arguments {
    /// A container, a glTF asset with one, or anything that can be baked
    #[arg(value_parser = input_path())]
    field: PathBuf,
    /// A folder, or a file: .png, .exr, .gif, .webp, .mp4, .webm, .mov
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Transparent background
    #[arg(long)]
    alpha: bool,
    /// Scales to render: 1 is full size, 2 a half, 4 a quarter; one ray per pixel
    #[arg(long, value_name = "S,...", value_delimiter = ',', default_value = "1",
          value_parser = clap::value_parser!(u16).range(1..=1024))]
    scales: Vec<u16>,
    /// Rays along each side of a pixel
    #[arg(long, value_name = "N", default_value_t = 1,
          value_parser = clap::value_parser!(u8).range(1..=16))]
    supersample: u8,
    /// Frames per second of a film [default: 25]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=120))]
    fps: Option<u8>,
    /// Also write float32 EXR files: R, G, B, A, Z (distance), L (level)
    #[arg(long)]
    exr: bool,
    /// Also write a contact sheet of all scales for each frame
    #[arg(long)]
    sheet: bool,
    /// The level to read: auto (the file's rule), off (level 0), or a number
    #[arg(long, value_name = "auto|off|K", default_value = "auto", value_parser = parse_levels)]
    level_of_detail: LevelChoice,
    /// Make coarser levels for a trained input, as `bake --filter` [default: only level 0]
    #[arg(long, value_name = "NAME")]
    filter: Option<Filter>,
    #[command(flatten)]
    which: FieldArguments,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    cameras: CameraArguments,
    #[command(flatten)]
    viewpoints: ViewpointArguments,
    #[command(flatten)]
    scene: SceneArguments,
}

/// The report of `render`.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub(super) struct RenderReport {
    /// Path of the rendered field.
    input: String,
    /// Path of the folder, picture or film.
    output: String,
    /// Total size of the written files in bytes.
    output_bytes: u64,
    /// Total wall-clock time in seconds.
    seconds: f64,
    /// Rays divided by the rendering time in seconds.
    rays_per_second: f64,
    /// Mean number of samples per ray between its entry and exit, without skipped ones.
    samples_per_ray: f64,
    /// Share of the samples between entry and exit that were skipped as empty space, 0 to 1.
    skipped_share: f64,
    /// Settings that the pictures were rendered with.
    settings: Settings,
    /// Rendered pictures, one entry per frame and scale.
    frames: Vec<FrameReport>,
}

/// One rendered picture.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
struct FrameReport {
    /// Name of the camera.
    frame: String,
    /// Factor by which the picture is smaller than full size along each side; 1 is full size.
    scale: usize,
    /// Width in pixels.
    width: usize,
    /// Height in pixels.
    height: usize,
    /// Rendering time in seconds.
    seconds: f64,
    /// Paths of the written files.
    files: Vec<String>,
    /// SHA-256 of each file in hexadecimal.
    sha256: Vec<String>,
}

/// Renders.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    let destination = Destination::of(&arguments.output)?;
    let bar = Bar::new(common);
    bar.plan(vec![(Step::Render, 1.0)]);
    let mut field = arguments.open(common)?;
    let cameras = arguments.viewpoints.cameras(&arguments.cameras, &mut field, common, &bar)?;
    let scales = &checked_scales(&arguments.scales, &cameras)?;
    check_memory(&cameras, arguments.supersample, &common.limits())?;
    let options = PictureOptions {
        without_background: arguments.alpha.then_some(field.view().background),
        exr: arguments.exr,
        sheet: arguments.sheet,
        rate: arguments.fps,
        force: arguments.force,
    };
    let mut pictures = Pictures::begin(destination, &cameras, scales, options)?;
    let shrunk =
        |camera: &Camera, scale| Camera { lens: camera.lens.shrunk(scale), ..camera.clone() };
    let planned: Vec<(&Camera, usize)> = cameras
        .iter()
        .flat_map(|camera| scales.iter().map(move |&scale| (camera, scale)))
        .collect();
    let supersample = arguments.supersample.into();
    let work =
        planned.iter().map(|(camera, scale)| tiles(&camera.lens.shrunk(*scale), supersample));
    bar.begin(Step::Render, work.sum());
    let options = FrameOptions { levels: arguments.level_of_detail, supersample };
    let (mut frames, mut written) = (Vec::new(), Vec::new());
    let mut statistics = Statistics::default();
    let clock = Instant::now();
    let mut rendering = 0.0;
    for (number, &(camera, scale)) in planned.iter().enumerate() {
        bar.part(Step::Render, &format!("picture {}/{}", number + 1, planned.len()));
        let start = Instant::now();
        let frame = render(&field, &shrunk(camera, scale), &options, &bar)?;
        let seconds = start.elapsed().as_secs_f64();
        rendering += seconds;
        statistics += frame.statistics;
        let (width, height) = (frame.width, frame.height);
        let files = pictures.add(&camera.name, scale, frame)?;
        let names = files.iter().map(|file| file.to_string_lossy().into_owned()).collect();
        written.push(files);
        frames.push(FrameReport {
            frame: camera.name.clone(),
            scale,
            width,
            height,
            seconds,
            files: names,
            sha256: Vec::new(),
        });
    }
    bar.check()?;
    let output_bytes = pictures.finish()?;
    drop(bar);
    for (frame, files) in frames.iter_mut().zip(&written) {
        frame.sha256 = files.iter().map(|file| digest(file)).collect::<Result<_>>()?;
    }
    let report = RenderReport {
        input: arguments.field.to_string_lossy().into_owned(),
        output: arguments.output.to_string_lossy().into_owned(),
        output_bytes,
        seconds: clock.elapsed().as_secs_f64(),
        rays_per_second: statistics.rays as f64 / rendering,
        samples_per_ray: statistics.samples as f64 / statistics.rays.max(1) as f64,
        skipped_share: match statistics.steps {
            0 => 0.0,
            steps => 1.0 - statistics.samples as f64 / steps as f64,
        },
        settings: Settings::of(field.view()),
        frames,
    };
    Outcome::new("render", &report, report.text(common))
}

impl Arguments {
    /// Opens the field, with near and far for the requested cameras.
    fn open(&self, common: &Common) -> Result<Renderer> {
        let cameras = self.cameras.file();
        let (which, filter) = (self.which, self.filter);
        which.check(&[&self.field])?;
        let mut field =
            self.scene.open_or_prefix(&self.field, which, filter, cameras.as_ref(), common)?;
        check_levels(self.level_of_detail, &field)?;
        if self.viewpoints.makes(&self.cameras) {
            self.scene.see_all(&mut field);
        }
        Ok(field)
    }
}

impl RenderReport {
    fn text(&self, common: &Common) -> String {
        let (output, bytes, seconds) = (&self.output, readable(self.output_bytes), self.seconds);
        let mut sizes: Vec<String> =
            self.frames.iter().map(|frame| format!("{} x {}", frame.width, frame.height)).collect();
        sizes.dedup();
        let count = counted(self.frames.len(), "picture");
        let size = match &*sizes {
            [size] => format!(" of {size}"),
            _ => String::new(),
        };
        let line = format!("{output}: {count}{size}, {bytes} in {seconds:.2} s");
        let mut text = folded(&line, columns(), 4) + "\n";
        if common.verbose {
            let mut table = Table::new(["picture", "pixels", "seconds"], 1);
            for frame in &self.frames {
                let FrameReport { frame, scale, width, height, seconds, .. } = frame;
                let pixels = format!("{width} x {height}");
                table.add([format!("{frame}.s{scale}"), pixels, format!("{seconds:.3}")]);
            }
            text += &table.text(columns());
            let (rays, samples) = (self.rays_per_second, self.samples_per_ray);
            let line = format!(
                "  {rays:.0} rays per second, {samples:.1} samples per ray, {:.1} % of the samples \
                 skipped in empty space",
                100.0 * self.skipped_share
            );
            text += &(folded(&line, columns(), 4) + "\n");
        }
        text + &self.settings.text()
    }
}
