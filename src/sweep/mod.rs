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
mod setting;
mod thumbnail;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use serde::{Deserialize, Serialize};

pub use pareto::{Point, front};
pub use record::RECORD_SCHEMA;
pub use setting::{Grid, Setting};
pub use thumbnail::Thumbnail;

use crate::bake::{Origin, bake};
use crate::bytes::{Output, SourceFile};
use crate::camera::Camera;
use crate::compare::{Reference, References, ScaleErrors};
use crate::container::Container;
use crate::error::{Error, ErrorKind, Place, Result};
use crate::limits::Limits;
use crate::parallel;
use crate::progress::{Progress, Step};
use crate::render::Field;
use crate::source::Source;
use record::{Basis, Record};

/// Schema of the report.
pub const SCHEMA: &str = "mipvog-sweep/1";

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

/// What a setting gave.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// Bytes of the container.
    pub output_bytes: u64,
    /// Wall-clock time of one bake, the median. Opening the input is not counted, nor is waiting for
    /// the disk at the end.
    pub seconds: f64,
    /// Levels of the container.
    pub levels: usize,
    /// Distance from the unbaked input, one for each scale.
    pub errors: Vec<ScaleErrors>,
    /// The first frame at the finest and at the coarsest scale.
    pub thumbnails: Vec<Thumbnail>,
}

/// Whether a result is on the fronts at one scale, of all results of the sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Fronts {
    /// Pixels of the full picture along one of this.
    pub scale: usize,
    /// No other is at most as large, at least as good, and better in one.
    pub bytes: bool,
    /// The same with time in the place of size.
    pub seconds: bool,
}

impl Fronts {
    /// `*` for the front of size, `+` for that of time.
    pub fn marks(self) -> &'static str {
        match (self.bytes, self.seconds) {
            (true, true) => "*+",
            (true, false) => "*",
            (false, true) => "+",
            (false, false) => "",
        }
    }
}

/// One setting of the report.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SettingReport {
    /// Its name.
    pub name: String,
    /// The preset that says the same, if one was asked for.
    pub preset: Option<&'static str>,
    /// Its container's name in the folder.
    pub file: String,
    /// What it was baked with.
    pub options: serde_json::Value,
    /// Whether the result comes from a former sweep.
    pub resumed: bool,
    /// Bytes of the container; null where it failed, as all that follows.
    pub output_bytes: Option<u64>,
    /// Wall-clock time of one bake, the median.
    pub seconds: Option<f64>,
    /// Levels of the container.
    pub levels: Option<usize>,
    /// Distance from the unbaked input, one for each scale; empty where it failed.
    pub errors: Vec<ScaleErrors>,
    /// One for each scale; empty where it failed.
    pub fronts: Vec<Fronts>,
    /// Why there is no result.
    pub failure: Option<String>,
    /// Pictures, for the page only.
    #[serde(skip)]
    pub thumbnails: Vec<Thumbnail>,
}

/// All of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SweepReport {
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// The input's file name.
    pub input: String,
    /// Frames that were compared.
    pub frames: Vec<String>,
    /// Pixels along a row and rows of the first frame at full size.
    pub size: [usize; 2],
    /// Scales that were compared at.
    pub scales: Vec<usize>,
    /// Bakes of a setting.
    pub repeat: usize,
    /// Threads that baked.
    pub threads: usize,
    /// In the order in which they were asked for.
    pub settings: Vec<SettingReport>,
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
    let digests: Vec<String> = options.settings.iter().map(|s| basis.digest(s)).collect();
    let found = options.settings.iter().zip(&digests);
    let found: Vec<_> = found.map(|(s, digest)| record::finished(folder, s, digest)).collect();
    let made = measure_missing(source, cameras, options, folder, &digests, &found, progress)?;
    let results = found.into_iter().zip(made).map(|(found, made)| match (found, made) {
        (Some(result), _) => (true, Ok(result)),
        (None, made) => (false, made.unwrap_or_else(|| Err("not tried".to_owned()))),
    });
    let settings = options.settings.iter().zip(results);
    let mut settings: Vec<SettingReport> =
        settings.map(|(setting, (resumed, result))| report(setting, resumed, result)).collect();
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

/// Results of the settings that have none yet; none for those that have.
fn measure_missing(
    source: &Source,
    cameras: &[Camera],
    options: &SweepOptions,
    folder: &Path,
    digests: &[String],
    found: &[Option<Measured>],
    progress: &dyn Progress,
) -> Result<Vec<Option<std::result::Result<Measured, String>>>> {
    let missing = found.iter().filter(|found| found.is_none()).count() as u64;
    if missing == 0 {
        return Ok(vec![None; found.len()]);
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
    let mut made = Vec::with_capacity(found.len());
    let mut tried = 0;
    for ((setting, digest), found) in options.settings.iter().zip(digests).zip(found) {
        if found.is_some() {
            made.push(None);
            continue;
        }
        if progress.cancelled() {
            return Err(Error::new(ErrorKind::Cancelled, Place::File));
        }
        Record::new(setting, digest, None).write(folder, setting)?;
        let result = match bench.measure(setting) {
            Ok(result) => {
                Record::new(setting, digest, Some(result.clone())).write(folder, setting)?;
                Ok(result)
            }
            Err(error) if ends_sweep(&error) => return Err(error),
            Err(error) => Err(error.to_string()),
        };
        made.push(Some(result));
        tried += 1;
        bench.steps.reach(tried * share);
    }
    Ok(made)
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

fn report(
    setting: &Setting,
    resumed: bool,
    result: std::result::Result<Measured, String>,
) -> SettingReport {
    let (result, failure) = match result {
        Ok(result) => (Some(result), None),
        Err(failure) => (None, Some(failure)),
    };
    SettingReport {
        name: setting.name.clone(),
        preset: setting.preset.map(crate::bake::Preset::name),
        file: format!("{}.mipvog", setting.name),
        options: setting.options.to_json(),
        resumed,
        output_bytes: result.as_ref().map(|result| result.output_bytes),
        seconds: result.as_ref().map(|result| result.seconds),
        levels: result.as_ref().map(|result| result.levels),
        errors: result.as_ref().map(|result| result.errors.clone()).unwrap_or_default(),
        fronts: Vec::new(),
        failure,
        thumbnails: result.map(|result| result.thumbnails).unwrap_or_default(),
    }
}

/// Fills in who is on the fronts, of those that did not fail.
fn mark_fronts(settings: &mut [SettingReport], scales: &[usize]) {
    for (number, &scale) in scales.iter().enumerate() {
        let points = |cost: fn(&SettingReport) -> Option<f64>| -> Vec<Point> {
            let point = |setting: &SettingReport| Point {
                cost: cost(setting).unwrap_or(f64::NAN),
                quality: setting.errors.get(number).map_or(f64::NAN, |errors| errors.psnr),
            };
            settings.iter().map(point).collect()
        };
        let by_bytes = front(&points(|setting| setting.output_bytes.map(|bytes| bytes as f64)));
        let by_seconds = front(&points(|setting| setting.seconds));
        for ((setting, bytes), seconds) in settings.iter_mut().zip(by_bytes).zip(by_seconds) {
            if setting.failure.is_none() {
                setting.fronts.push(Fronts { scale, bytes, seconds });
            }
        }
    }
}
