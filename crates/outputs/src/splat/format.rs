//! The format `splat`.

use std::path::Path;

use serde_json::{Map, json};

use super::optimize::{Fit, STEPS, Target};
use super::shown::ShownSplats;
use super::{place, ply};
use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::base::progress::{Progress, Step};
use crate::export_files::{ExportFiles, WrittenFiles};
use crate::format::{ExportFormat, ExportOptions, ExportSource, Exported, Shown};
use crate::model::camera::{Camera, Lens, Orbit, direction, sphere};
use crate::view::overview;
use crate::view::render::{FrameOptions, LevelChoice, render};
use crate::volume::lattice;

/// Splats at most, where the user does not say.
const SPLATS: usize = 100_000;
/// Targets, and pixels along a side of each. Splats that were fitted to smaller pictures have gaps in
/// larger ones, because renderers widen them by a part of a pixel.
const TARGETS: usize = 40;
const SIDE: usize = 320;
/// Larger pictures of given cameras are made smaller.
const LARGEST_SIDE: usize = 400;
/// Given cameras that become targets, at most.
const MOST_CAMERAS: usize = 60;
/// The largest share of a pixel's light that a splat without use has.
const UNSEEN: f32 = 0.02;

/// A `.ply` of Gaussian splats.
#[derive(Debug)]
pub struct Splat;

impl ExportFormat for Splat {
    fn name(&self) -> &'static str {
        "splat"
    }

    fn options(&self) -> &'static [&'static str] {
        &["supersample", "resolution", "crop", "splats"]
    }

    fn check(&self, source: &ExportSource, options: &ExportOptions, output: &Path) -> Result<()> {
        if output.extension().is_none_or(|extension| extension != "ply") {
            let output = output.display();
            return Err(Error::usage(format!(
                "-o {output}: the name of a file of splats must end in .ply"
            )));
        }
        let splats = options.splats.unwrap_or(SPLATS);
        Error::require_option(splats > 0, "splats", splats, "1 or more")?;
        lattice(source, options, 1).map(drop)
    }

    fn write(
        &self,
        source: &ExportSource,
        options: &ExportOptions,
        files: &mut ExportFiles,
        progress: &dyn Progress,
    ) -> Result<Exported> {
        let lattice = lattice(source, options, 1)?;
        let placed =
            place::splats(&source.field, &lattice, options.level, &options.limits, progress)?;
        let placed_count = placed.len();
        let targets = targets(source, options, progress)?;
        #[expect(clippy::cast_possible_truncation, reason = "splats are float32")]
        let cell = lattice.spacing.map(|edge| edge as f32);
        let background = source.field.view().background;
        let mut fit = Fit::new(placed, cell, background);
        let small: Vec<Target> = targets.iter().map(Target::small).collect();
        fit.prune(&targets, options.splats.unwrap_or(SPLATS), UNSEEN)?;
        progress.begin(Step::Fit, STEPS as u64);
        fit.run([&small, &targets], progress)?;
        // Those that the fit has made useless.
        fit.prune(&targets, usize::MAX, 1.0 / 255.0)?;
        let comment = format!(
            "mipvog-bake {} of {} sha256 {}",
            env!("CARGO_PKG_VERSION"),
            source.name.replace(['\n', '\r'], " "),
            source.sha256
        );
        let path = files.output().to_owned();
        files.add(path, &ply::bytes(&fit.splats, &comment))?;
        let mut details = Map::new();
        details.insert("splats".to_owned(), json!(fit.splats.len()));
        details.insert("placed".to_owned(), json!(placed_count));
        details.insert("targets".to_owned(), json!(targets.len()));
        let mut lost =
            vec!["density: splats are surfaces as seen from the targets' cameras".to_owned()];
        if source.field.has_network() {
            lost.push("colour beyond harmonics of degree 3".to_owned());
        }
        if source.field.levels() > 1 {
            lost.push("other levels".to_owned());
        }
        Ok(Exported { lost, details })
    }

    fn read_back(
        &self,
        source: &ExportSource,
        files: &WrittenFiles,
        limits: &Limits,
    ) -> Result<Box<dyn Shown>> {
        let splats = ply::read(&*files.with_extension("ply")?, limits)?;
        Ok(Box::new(ShownSplats { splats, background: source.field.view().background }))
    }
}

/// Pictures of the field that splats are fitted to.
fn targets(
    source: &ExportSource,
    options: &ExportOptions,
    progress: &dyn Progress,
) -> Result<Vec<Target>> {
    let cameras = match options.cameras.is_empty() {
        true => around(source, progress)?,
        false => given(&options.cameras),
    };
    progress.begin(Step::Targets, cameras.len() as u64);
    let levels = LevelChoice::Fixed(options.level);
    let rules = FrameOptions { levels, supersample: 1 };
    let pictures = cameras.into_iter().map(|camera| {
        let frame = render(&source.field, &camera, &rules, &crate::base::progress::Silent)?;
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
        progress.advance(Step::Targets, 1);
        let color = frame.color.iter().map(|color| color.map(|v| v.clamp(0.0, 1.0))).collect();
        Ok(Target { camera, color })
    });
    pictures.collect()
}

/// Every so many of the given cameras, with smaller pictures.
fn given(cameras: &[Camera]) -> Vec<Camera> {
    let every = cameras.len().div_ceil(MOST_CAMERAS);
    let smaller = |camera: &Camera| {
        let side = camera.lens.width.max(camera.lens.height);
        let factor = side.div_ceil(LARGEST_SIDE).max(1);
        let [width, height] =
            [camera.lens.width, camera.lens.height].map(|side| (side / factor).max(1));
        Camera { lens: camera.lens.resized(width, height), ..camera.clone() }
    };
    cameras.iter().step_by(every).map(smaller).collect()
}

/// Cameras all around what is visible, evenly spread, as far away as the overview's.
fn around(source: &ExportSource, progress: &dyn Progress) -> Result<Vec<Camera>> {
    let bounds = &source.field.view().bounds;
    let orbit = Orbit::default();
    let near = overview(&source.field, [SIDE; 2], progress)?;
    let eye = near.to_world.w_axis.truncate();
    let (middle, radius) = sphere(bounds);
    let forwards = -near.to_world.z_axis.truncate();
    // The overview looks at what is visible: the point of its axis nearest to the box's middle.
    let distance = (middle - eye).dot(forwards).max(0.1 * radius);
    let middle = eye + distance * forwards;
    let lens = Lens::centered([SIDE; 2], 0.5 * orbit.field_of_view);
    let turn = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let cameras = (0..TARGETS).map(|number| {
        let up = 1.0 - (2 * number + 1) as f64 / TARGETS as f64;
        let back = direction(turn * number as f64, libm::asin(up));
        // Every other one is nearer, for detail.
        let distance = if number % 2 == 0 { distance } else { 0.75 * distance };
        Camera::looking_at(middle, back, distance, format!("around_{number:02}"), lens)
    });
    Ok(cameras.collect())
}
