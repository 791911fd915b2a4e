//! The format `splat`.

use std::path::Path;

use serde_json::{Map, Value, json};

use super::files::{FileKind, Origin};
use super::optimize::{Fit, STEPS, Target, visible};
use super::place::{self, BoxPoints};
use super::project::{FAINT, GaussianSplat, OPACITY};
use super::shown::ShownSplats;
use super::spz;
use super::targets::targets;
use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::base::progress::{Progress, Step};
use crate::export_files::{ExportFiles, WrittenFiles};
use crate::format::{ExportFormat, ExportOptions, ExportSource, Exported, Shown};
use crate::model::activate::lanes;

/// Default maximum number of splats.
const SPLATS: usize = 100_000;
/// Splats with at most this share of every pixel's light are useless.
const UNSEEN: f32 = 0.02;

/// Gaussian splats, in the kind of file that the output's name says.
#[derive(Debug)]
pub struct Splat;

impl ExportFormat for Splat {
    fn name(&self) -> &'static str {
        "splat"
    }

    fn options(&self) -> &'static [&'static str] {
        &["supersample", "resolution", "crop", "splats"]
    }

    fn holds_boxes(&self) -> bool {
        true
    }

    /// Larger, because renderers widen splats by a part of a pixel: half the size would lose 5 dB.
    fn side(&self) -> usize {
        400
    }

    fn check(&self, source: &ExportSource, options: &ExportOptions, output: &Path) -> Result<()> {
        let kind = FileKind::of(output)?;
        let splats = options.splats.unwrap_or(SPLATS);
        Error::require_option(splats > 0, "splats", splats, "1 or more")?;
        let boxes = place::points(source, options)?;
        if kind == FileKind::Spz {
            position_bits(source, &boxes)?;
        }
        Ok(())
    }

    fn write(
        &self,
        source: &ExportSource,
        options: &ExportOptions,
        files: &mut ExportFiles,
        progress: &dyn Progress,
    ) -> Result<Exported> {
        let kind = FileKind::of(files.output())?;
        let boxes = place::points(source, options)?;
        let level = options.level;
        let placed = place::splats(&source.field, &boxes, level, &options.limits, progress)?;
        let placed_count = placed.len();
        let targets = targets(source, options, progress)?;
        let fitted = fit(source, options, placed, &targets, progress)?;
        let bits = if kind == FileKind::Spz { position_bits(source, &boxes)? } else { 0 };
        let origin = Origin { name: &source.name, sha256: &source.sha256 };
        kind.write(&fitted, bits, &origin, files)?;
        let mut details = Map::new();
        let mut tell = |name: &str, value: Value| details.insert(name.to_owned(), value);
        tell("file_format", json!(kind.name()));
        tell("splats", json!(fitted.len()));
        tell("placed", json!(placed_count));
        tell("targets", json!(targets.len()));
        tell("boxes", json!(boxes.len()));
        let mut lost =
            vec!["density: splats are surfaces, as seen from the cameras of the fit".to_owned()];
        if kind == FileKind::Spz {
            let step = libm::ldexp(1.0, -bits);
            tell("position_step", json!(step));
            lost.push(format!(
                "precision: .spz rounds positions to {step:.2e} world units, sizes by up to 3 %, \
                 colours and opacities to 8 bits"
            ));
        }
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
        let kind = FileKind::of(files.first())?;
        let splats = kind.read(files, limits)?;
        let background = source.field.view().background;
        Ok(Box::new(ShownSplats { splats, rules: kind.rules(), background }))
    }
}

/// Bits after the point of positions in `.spz`.
fn position_bits(source: &ExportSource, boxes: &[BoxPoints]) -> Result<i32> {
    let bounds = &source.field.view().bounds;
    let farthest = bounds.min.iter().chain(&bounds.max).fold(0.0f32, |most, at| most.max(at.abs()));
    let [smallest, largest] = place::sizes(boxes);
    spz::check_sizes(smallest, largest)?;
    spz::bits(f64::from(farthest) + largest, smallest)
}

/// The splats that show, fitted to the pictures.
fn fit(
    source: &ExportSource,
    options: &ExportOptions,
    placed: Vec<(GaussianSplat, [f32; 3])>,
    targets: &[Target],
    progress: &dyn Progress,
) -> Result<Vec<GaussianSplat>> {
    let all: Vec<GaussianSplat> = placed.iter().map(|(splat, _)| *splat).collect();
    let kept = visible(&all, targets, options.splats.unwrap_or(SPLATS), UNSEEN)?;
    let mut placed: Vec<_> = kept.into_iter().map(|number| placed[number]).collect();
    place::color(&source.field, &mut placed, options.level, progress)?;
    let mut fit = Fit::new(placed, source.field.view().background);
    progress.begin(Step::Fit, STEPS as u64);
    fit.run(targets, progress)?;
    // Removes splats that are too faint to be drawn.
    fit.splats.retain(|splat| lanes::sigmoid(splat[OPACITY]) > FAINT);
    Ok(fit.splats)
}
