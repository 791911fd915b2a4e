//! `render`.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde::Serialize;

use super::common::Common;
use super::field::FieldArguments;
use super::outcome::Outcome;
use super::output::{create as create_output, refuse_stdout};
use super::progress::Bar;
use super::scene::SceneArguments;
use crate::bake::Filter;
use crate::base::bytes::ByteSink;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::Limits;
use crate::base::picture;
use crate::base::progress::{Progress, Step};
use crate::model::camera::{self, Camera};
use crate::model::grid::Bounds;
use crate::view::render::{Frame, FrameOptions, LevelChoice, Statistics, render};

/// Render a container or a trained scene with the reference renderer
#[derive(Debug, Args)]
pub struct Arguments {
    /// A container, a glTF asset with one, or anything that can be baked
    field: PathBuf,
    #[command(flatten)]
    cameras: CameraArguments,
    /// The folder to write pictures into
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Picture sizes: full, a half, a quarter and so on, with one ray a pixel
    #[arg(long, value_name = "S,...", value_delimiter = ',', default_value = "1")]
    scales: Vec<usize>,
    /// Rays along each side of a pixel
    #[arg(long, value_name = "N", default_value_t = 1,
          value_parser = clap::value_parser!(u8).range(1..=16))]
    supersample: u8,
    /// Coarser levels for a trained input, as `bake --filter` [default: level 0 alone]
    #[arg(long, value_name = "NAME")]
    filter: Option<Filter>,
    /// Which level samples read: auto (the file's rule), off (level 0), or a level's number
    #[arg(long, value_name = "auto|off|K", default_value = "auto", value_parser = parse_levels)]
    level_of_detail: LevelChoice,
    /// Write float32 EXR files too: R, G, B, A, Z (distance), L (level)
    #[arg(long)]
    exr: bool,
    /// Write a contact sheet of all scales for each frame
    #[arg(long)]
    sheet: bool,
    #[command(flatten)]
    which: FieldArguments,
    #[command(flatten)]
    scene: SceneArguments,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
}

/// The cameras to render from.
#[derive(Debug, Clone, Args)]
pub struct CameraArguments {
    /// A camera file: NeRF-synthetic's transforms.json or nerfstudio's
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,
    /// Instead of a camera file, this many cameras on a circle around the box
    #[arg(long, value_name = "N", conflicts_with = "cameras",
          value_parser = clap::value_parser!(u16).range(1..))]
    turntable: Option<u16>,
    /// Picture size in pixels; overrides the camera file's and its pictures'
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<Size>,
    /// Frames, by name or index [default: all]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    frames: Vec<String>,
}

/// Pixels along a row, and rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size([usize; 2]);

impl CameraArguments {
    /// True if there is a camera file or a turntable.
    pub fn given(&self) -> bool {
        self.cameras.is_some() || self.turntable.is_some()
    }

    /// True if a size or frames are given.
    pub fn selects(&self) -> bool {
        self.size.is_some() || !self.frames.is_empty()
    }

    /// The camera file, if there is one.
    pub fn file(&self) -> Option<PathBuf> {
        self.cameras.clone()
    }

    /// Reads or makes the cameras; refuses to without a file or a turntable.
    pub fn cameras(&self, bounds: &Bounds, limits: &Limits) -> Result<Vec<Camera>> {
        let size = self.size.map(|Size(size)| size);
        let cameras = match (&self.cameras, self.turntable) {
            (Some(path), _) => camera::read(path, size, limits)?.cameras,
            (None, Some(count)) => {
                let size = size.unwrap_or([800; 2]);
                camera::turntable(bounds, count.into(), size)
            }
            (None, None) => {
                return Err(Error::usage("--cameras FILE or --turntable N must say from where"));
            }
        };
        camera::pick(cameras, &self.frames)
    }
}

#[derive(Debug, Serialize)]
struct Report {
    input: String,
    output: String,
    seconds: f64,
    rays_per_second: f64,
    /// Samples read between the rays' entry and exit.
    samples_per_ray: f64,
    skipped_share: f64,
    frames: Vec<FrameReport>,
}

#[derive(Debug, Serialize)]
struct FrameReport {
    frame: String,
    scale: usize,
    width: usize,
    height: usize,
    seconds: f64,
    files: Vec<String>,
}

/// Renders.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    if arguments.scales.iter().any(|&scale| !(1..=1024).contains(&scale)) {
        return Err(Error::usage("--scales must be whole numbers from 1 to 1024"));
    }
    let field = arguments.scene.open_or_prefix(
        &arguments.field,
        arguments.which,
        arguments.filter,
        common,
    )?;
    let cameras = arguments.cameras.cameras(&field.view().bounds, &common.limits())?;
    let folder = &arguments.output;
    refuse_stdout(folder, "render writes a folder")?;
    std::fs::create_dir_all(folder).map_err(|error| Error::io(error, folder))?;
    let mut planned = Vec::new();
    for camera in &cameras {
        for &scale in &arguments.scales {
            planned.push((camera, scale, arguments.files(&camera.name, scale)));
        }
    }
    // Nothing is rendered for files that could not be written.
    refuse_existing(planned.iter().flat_map(|(.., files)| files), arguments.force)?;
    let bar = Bar::new(common);
    bar.begin(Step::Render, planned.len() as u64);
    let options = FrameOptions {
        levels: arguments.level_of_detail,
        supersample: arguments.supersample.into(),
    };
    let mut frames = Vec::new();
    let mut statistics = Statistics::default();
    let mut sheet: Vec<Frame> = Vec::new();
    let clock = Instant::now();
    let mut rendering = 0.0;
    for (camera, scale, files) in planned {
        let small = Camera { lens: camera.lens.shrunk(scale), ..camera.clone() };
        let start = Instant::now();
        let frame = render(&field, &small, &options, &bar)?;
        let seconds = start.elapsed().as_secs_f64();
        rendering += seconds;
        statistics += frame.statistics;
        arguments.write(&frame, &files)?;
        let names = files.iter().map(|file| file.to_string_lossy().into_owned());
        frames.push(FrameReport {
            frame: camera.name.clone(),
            scale,
            width: frame.width,
            height: frame.height,
            seconds,
            files: names.collect(),
        });
        sheet.push(frame);
        if sheet.len() == arguments.scales.len() {
            arguments.write_sheet(&camera.name, &std::mem::take(&mut sheet))?;
        }
    }
    drop(bar);
    let report = Report {
        input: arguments.field.to_string_lossy().into_owned(),
        output: folder.to_string_lossy().into_owned(),
        seconds: clock.elapsed().as_secs_f64(),
        rays_per_second: statistics.rays as f64 / rendering,
        samples_per_ray: statistics.samples as f64 / statistics.rays.max(1) as f64,
        skipped_share: 1.0 - statistics.samples as f64 / statistics.steps.max(1) as f64,
        frames,
    };
    let mut text = String::new();
    for frame in &report.frames {
        let FrameReport { frame, scale, width, height, seconds, .. } = frame;
        writeln!(text, "{frame}.s{scale}: {width} x {height} in {seconds:.3} s").ok();
    }
    let share = 100.0 * report.skipped_share;
    let (rays, samples) = (report.rays_per_second, report.samples_per_ray);
    writeln!(
        text,
        "{rays:.0} rays a second, {samples:.1} samples a ray, {share:.1} % of samples skipped"
    )
    .ok();
    Outcome::new("render", &report, text)
}

impl Arguments {
    fn files(&self, name: &str, scale: usize) -> Vec<PathBuf> {
        let file = |extension: &str| self.output.join(format!("{name}.s{scale}.{extension}"));
        let exr = self.exr.then(|| file("exr"));
        [file("png")].into_iter().chain(exr).collect()
    }

    fn write(&self, frame: &Frame, files: &[PathBuf]) -> Result<()> {
        for file in files {
            let is_exr = file.extension().is_some_and(|extension| extension == "exr");
            let bytes = if is_exr { exr(frame)? } else { png(frame)? };
            write_file(file, &bytes, self.force)?;
        }
        Ok(())
    }

    fn write_sheet(&self, name: &str, frames: &[Frame]) -> Result<()> {
        if !self.sheet {
            return Ok(());
        }
        let (width, height, bytes) = contact_sheet(frames);
        let path = self.output.join(format!("{name}.sheet.png"));
        write_file(&path, &picture::png(width, height, &bytes)?, self.force)
    }
}

fn refuse_existing<'a>(
    files: impl IntoIterator<Item = &'a PathBuf>,
    overwrite: bool,
) -> Result<()> {
    let taken = files.into_iter().find(|file| !overwrite && file.symlink_metadata().is_ok());
    let exists = |file: &PathBuf| Error::new(ErrorKind::Exists, Place::File).in_file(file);
    taken.map_or(Ok(()), |file| Err(exists(file)))
}

fn write_file(path: &Path, bytes: &[u8], overwrite: bool) -> Result<()> {
    let mut output = create_output(path, overwrite)?;
    output.append(bytes)?;
    output.finish()
}

/// As training wrote pictures: clamped, times 255, rounded to nearest.
fn rgb8(frame: &Frame) -> Vec<u8> {
    let byte = |value: &f32| (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    frame.color.as_flattened().iter().map(byte).collect()
}

fn png(frame: &Frame) -> Result<Vec<u8>> {
    picture::png(frame.width, frame.height, &rgb8(frame))
}

fn exr(frame: &Frame) -> Result<Vec<u8>> {
    let color = |channel: usize| frame.color.iter().map(|pixel| pixel[channel]).collect();
    let opacity = frame.transmittance.iter().map(|left| 1.0 - left).collect();
    let channels: [(&str, Vec<f32>); 6] = [
        ("R", color(0)),
        ("G", color(1)),
        ("B", color(2)),
        ("A", opacity),
        ("Z", frame.distance.clone()),
        ("L", frame.level.clone()),
    ];
    let channels = channels.into_iter().map(|(name, values)| (name.to_owned(), values)).collect();
    picture::exr(frame.width, frame.height, channels)
}

/// All scales side by side, each enlarged to the first one's height without smoothing.
fn contact_sheet(frames: &[Frame]) -> (usize, usize, Vec<u8>) {
    let height = frames.iter().map(|frame| frame.height).max().unwrap_or(1);
    let zoom = |frame: &Frame| (height / frame.height).max(1);
    let width: usize = frames.iter().map(|frame| frame.width * zoom(frame)).sum();
    let mut sheet = vec![255; 3 * width * height];
    let mut left = 0;
    for frame in frames {
        let (zoom, pixels) = (zoom(frame), rgb8(frame));
        for y in 0..height.min(frame.height * zoom) {
            for x in 0..frame.width * zoom {
                let from = 3 * (y / zoom * frame.width + x / zoom);
                let to = 3 * (y * width + left + x);
                sheet[to..to + 3].copy_from_slice(&pixels[from..from + 3]);
            }
        }
        left += frame.width * zoom;
    }
    (width, height, sheet)
}

fn parse_size(text: &str) -> std::result::Result<Size, String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    match sides {
        Some(size) if size.iter().all(|side| (1..=camera::LARGEST_SIDE).contains(side)) => {
            Ok(Size(size))
        }
        _ => Err("expected WxH in pixels, such as 400x400".to_owned()),
    }
}

fn parse_levels(text: &str) -> std::result::Result<LevelChoice, String> {
    match text {
        "auto" => Ok(LevelChoice::Auto),
        "off" => Ok(LevelChoice::Fixed(0)),
        _ => match text.parse() {
            Ok(level) => Ok(LevelChoice::Fixed(level)),
            Err(_) => Err("expected auto, off or a level's number".to_owned()),
        },
    }
}
