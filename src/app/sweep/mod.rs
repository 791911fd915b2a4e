//! Bakes over settings: what each costs in time and bytes, what it loses at every scale, and which
//! of them are worth having.
//!
//! 1. **Settings** ([`Grid`]): every combination of the lists that were given, each once, in a stable
//!    order and under a stable name.
//! 2. **Measure**: each setting is baked into `FOLDER/NAME.mipvog`, timed, read back, rendered and
//!    compared with the unbaked input, whose pictures are made once for all settings.
//! 3. **Keep** ([`record`]): a finished setting leaves `FOLDER/NAME.json`. A later sweep takes a
//!    result from there if everything that it follows from is the same, and neither bakes nor renders.
//! 4. **Tell**: the [`front`] of size and of time at each scale; `sweep.json`, `sweep.csv`
//!    ([`csv`]) and `sweep.html` ([`page`]), written anew by every run.
//!
//! A setting that cannot be baked has a failure for a result, and the others go on; an operating
//! system that fails, or a caller who cancels, ends the sweep. What was finished stays.

mod csv;
mod page;
mod pareto;
mod plot;
mod record;
mod report;
mod setting;
mod thumbnail;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

pub use pareto::{Point, front};
pub use record::RECORD_SCHEMA;
use report::mark_fronts;
pub use report::{Fronts, Measured, SCHEMA, SettingReport, SweepReport};
pub use setting::{Grid, Setting};
pub use thumbnail::Thumbnail;

use crate::bake::{Origin, bake};
use crate::base::bytes::{Output, SourceFile};
use crate::base::error::{Error, ErrorKind, Result};
use crate::base::limits::Limits;
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::codec::container::Container;
use crate::input::checkpoint::Source;
use crate::model::camera::Camera;
use crate::view::compare::{Reference, References};
use crate::view::render::Field;
use record::{Basis, Record};

/// What a sweep does.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct SweepOptions {
    /// What to bake with. Default: [`Grid::usual`]'s
    pub settings: Vec<Setting>,
    /// Scales to compare at: pixels of the full picture along one. Default: 1, 2, 4, 8
    pub scales: Vec<usize>,
    /// How often each setting is baked; the median time counts. Default: 3
    pub repeat: usize,
    /// Whether files that no sweep wrote may be replaced. Default: false
    pub overwrite: bool,
}

impl Default for SweepOptions {
    fn default() -> Self {
        let settings = Grid::usual().settings();
        Self { settings, scales: vec![1, 2, 4, 8], repeat: 3, overwrite: false }
    }
}

/// Bakes `source` with every setting into `folder` and writes the reports there.
pub fn sweep(
    source: &Source,
    cameras: &[Camera],
    options: &SweepOptions,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<SweepReport> {
    let Some(first) = cameras.first() else {
        return Err(Error::usage("a sweep needs at least one camera"));
    };
    if options.repeat == 0 || options.scales.is_empty() || options.settings.is_empty() {
        return Err(Error::usage("a sweep needs a setting, a scale and a repetition"));
    }
    let basis = Basis::new(source, cameras, options)?;
    if !options.overwrite {
        record::refuse_foreign(folder, &options.settings)?;
    }
    let results = results(source, cameras, options, folder, &basis, progress)?;
    let settings = options.settings.iter().zip(results);
    let mut settings: Vec<SettingReport> = settings
        .map(|(setting, (resumed, result))| SettingReport::new(setting, resumed, result))
        .collect();
    mark_fronts(&mut settings, &options.scales);
    let name = source.file.path().file_name().unwrap_or_default();
    let report = SweepReport {
        schema: SCHEMA,
        input: name.to_string_lossy().into_owned(),
        frames: cameras.iter().map(|camera| camera.name.clone()).collect(),
        size: [first.lens.width, first.lens.height],
        scales: options.scales.clone(),
        repeat: options.repeat,
        threads: parallel::threads(),
        settings,
    };
    let text = serde_json::to_string_pretty(&report)
        .map_err(|error| Error::usage(format!("the report is no JSON: {error}")))?;
    // First the one by which a later sweep knows all three.
    record::write_file(&folder.join("sweep.json"), format!("{text}\n").as_bytes())?;
    record::write_file(&folder.join("sweep.csv"), csv::csv(&report).as_bytes())?;
    record::write_file(&folder.join("sweep.html"), page::page(&report).as_bytes())?;
    Ok(report)
}

/// What became of a setting: figures, or why there are none.
type Outcome = std::result::Result<Measured, String>;

/// Each setting's outcome, and whether it comes from a former sweep.
fn results(
    source: &Source,
    cameras: &[Camera],
    options: &SweepOptions,
    folder: &Path,
    basis: &Basis,
    progress: &dyn Progress,
) -> Result<Vec<(bool, Outcome)>> {
    let settings = options.settings.iter().map(|setting| (setting, basis.digest(setting)));
    let settings = settings.map(|(setting, digest)| {
        let found = record::finished(folder, setting, &digest);
        (setting, digest, found)
    });
    let settings: Vec<_> = settings.collect();
    let missing = settings.iter().filter(|(_, _, found)| found.is_none()).count() as u64;
    if missing == 0 {
        let found = settings.into_iter().filter_map(|(_, _, found)| found);
        return Ok(found.map(|result| (true, Ok(result))).collect());
    }
    let limits = Limits::default();
    let reference = Field::trained(&source.field, None, &limits)
        .map_err(|error| error.in_file(source.file.path()))?;
    let reference = Reference::Field(Box::new(reference));
    std::fs::create_dir_all(folder).map_err(|error| Error::io(error, folder))?;
    let references = References::new(&reference, cameras, &options.scales, 1).keep(&limits);
    let origin = Origin::of_source(source);
    let share = (options.repeat + cameras.len() * options.scales.len()) as u64;
    progress.begin(Step::Sweep, missing * share + cameras.len() as u64);
    let steps = Steps { outer: progress, done: AtomicU64::new(0) };
    let mut bench = Bench { source, origin, options, folder, references, limits, steps };
    let mut results = Vec::with_capacity(settings.len());
    let mut tried = 0;
    for (setting, digest, found) in settings {
        if let Some(result) = found {
            results.push((true, Ok(result)));
            continue;
        }
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
        Record::new(setting, &digest, None).write(folder, setting)?;
        let result = match bench.measure(setting) {
            Ok(result) => {
                Record::new(setting, &digest, Some(result.clone())).write(folder, setting)?;
                Ok(result)
            }
            Err(error) if ends_sweep(&error) => return Err(error),
            Err(error) => Err(error.to_string()),
        };
        results.push((false, result));
        tried += 1;
        bench.steps.reach(tried * share);
    }
    Ok(results)
}

/// Whether an error is not the setting's own.
fn ends_sweep(error: &Error) -> bool {
    matches!(error.kind(), ErrorKind::Io(_) | ErrorKind::Cancelled | ErrorKind::Exists)
}

/// What all settings are measured on.
struct Bench<'a> {
    source: &'a Source,
    origin: Origin,
    options: &'a SweepOptions,
    folder: &'a Path,
    references: References<'a>,
    limits: Limits,
    steps: Steps<'a>,
}

impl Bench<'_> {
    fn measure(&mut self, setting: &Setting) -> Result<Measured> {
        let path = record::container_path(self.folder, setting);
        let mut seconds = Vec::with_capacity(self.options.repeat);
        let mut last = None;
        for _ in 0..self.options.repeat {
            let mut output = Output::create(&path, true)?;
            let clock = Instant::now();
            let field = &self.source.field;
            let report = bake(field, &setting.options, &self.origin, &mut output, &self.steps)
                .map_err(|error| error.in_file(self.source.file.path()))?;
            seconds.push(clock.elapsed().as_secs_f64());
            last = Some((output, report));
            self.steps.advance(Step::Sweep, 1);
        }
        let Some((output, report)) = last else {
            return Err(Error::usage("a sweep needs a repetition"));
        };
        output.finish()?;
        let container = Container::open(Arc::new(SourceFile::open(&path)?), &self.limits)?;
        let field = Field::baked(&container.read()?, &self.limits)?;
        let mut thumbnails = Vec::new();
        let scales = &self.options.scales;
        let ends = [scales.iter().min(), scales.iter().max()];
        let errors = self.references.compare(&field, &self.steps, |frame| {
            let is_new = thumbnails.iter().all(|t: &Thumbnail| t.scale != frame.scale);
            if is_new && ends.contains(&Some(&frame.scale)) {
                thumbnails.push(Thumbnail::of(frame)?);
            }
            Ok(())
        })?;
        thumbnails.sort_by_key(|thumbnail| thumbnail.scale);
        let levels = report.levels.len();
        let output_bytes = report.output_bytes;
        Ok(Measured { output_bytes, seconds: median(seconds), levels, errors, thumbnails })
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let (low, high) = (values.len().saturating_sub(1) / 2, values.len() / 2);
    let at = |i: usize| values.get(i).copied().unwrap_or_default();
    0.5 * (at(low) + at(high))
}

/// Shows the bakes and renders of a setting as steps of the sweep.
struct Steps<'a> {
    outer: &'a dyn Progress,
    done: AtomicU64,
}

impl Steps<'_> {
    /// Makes up for steps that were left out.
    fn reach(&self, target: u64) {
        let left = target.saturating_sub(self.done.load(Ordering::Relaxed));
        self.advance(Step::Sweep, left);
    }
}

impl Progress for Steps<'_> {
    fn advance(&self, step: Step, by: u64) {
        if matches!(step, Step::Render | Step::Sweep) {
            self.done.fetch_add(by, Ordering::Relaxed);
            self.outer.advance(Step::Sweep, by);
        }
    }

    fn cancelled(&self) -> bool {
        self.outer.cancelled()
    }
}
