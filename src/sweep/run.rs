//! Runs a sweep and writes its reports.

use std::path::Path;
use std::sync::atomic::AtomicU64;

use super::measure::{Bench, Steps};
use super::options::{Share, SweepOptions};
use super::record::{self, Basis, SettingRecord};
use super::report::{Outcome, SCHEMA, SettingReport, SweepReport, mark_fronts};
use super::setting::Setting;
use super::{csv, page};
use crate::base::bytes::{Provisional, SourceFile, hex, sha256};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::model::camera::Camera;
use crate::view::compare::{Reference, References};
use mipvog_inputs::Source;

/// Bakes `source` with every setting into `folder` and writes the reports there.
pub fn sweep(
    source: &Source,
    cameras: &[Camera],
    options: &SweepOptions,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<SweepReport> {
    let Some(first) = cameras.first() else {
        return Err(Error::invalid_option("cameras", "none", "at least one"));
    };
    if options.repeat == 0 || options.scales.is_empty() || options.settings.is_empty() {
        return Err(Error::invalid_option(
            "repeat",
            "a sweep of nothing",
            "a setting, a scale and a repetition",
        ));
    }
    let basis = Basis::new(source, cameras, options)?;
    let own: Vec<&Setting> = own_settings(options).collect();
    if !options.overwrite {
        record::refuse_foreign(folder, &own, &options.limits)?;
    }
    let results = results(source, cameras, options, &own, folder, &basis, progress)?;
    let settings = own.into_iter().zip(results);
    let mut settings: Vec<SettingReport> = settings
        .map(|(setting, (resumed, result))| SettingReport::new(setting, resumed, result))
        .collect();
    for setting in settings.iter_mut().filter(|setting| setting.failure.is_none()) {
        let container = SourceFile::open(&folder.join(&setting.file))?;
        setting.sha256 = Some(hex(&sha256(&container)?));
    }
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
    if let Share::Shard(_) = options.share {
        return Ok(report);
    }
    let text = serde_json::to_string_pretty(&report)
        .map_err(|error| Error::malformed(Place::File, error.to_string(), "finite numbers"))?;
    // First the report by which a later sweep recognizes all three.
    record::write_file(&folder.join("sweep.json"), format!("{text}\n").as_bytes())?;
    record::write_file(&folder.join("sweep.csv"), csv::csv(&report).as_bytes())?;
    record::write_file(&folder.join("sweep.html"), page::page(&report).as_bytes())?;
    Ok(report)
}

/// The settings in a run's report.
fn own_settings(options: &SweepOptions) -> impl Iterator<Item = &Setting> {
    let numbered = (0..).zip(&options.settings);
    let own = numbered.filter(|(number, _)| match options.share {
        Share::Shard(shard) => shard.has(*number),
        Share::All | Share::Merge => true,
    });
    own.map(|(_, setting)| setting)
}

/// Each setting's outcome, and whether it comes from an earlier sweep.
fn results(
    source: &Source,
    cameras: &[Camera],
    options: &SweepOptions,
    own: &[&Setting],
    folder: &Path,
    basis: &Basis,
    progress: &dyn Progress,
) -> Result<Vec<(bool, Outcome)>> {
    let settings = own.iter().map(|&setting| (setting, basis.digest(setting)));
    let settings = settings.map(|(setting, digest)| {
        let found = record::finished(folder, setting, &digest, &options.limits);
        (setting, digest, found)
    });
    let settings: Vec<_> = settings.collect();
    let missing = settings.iter().filter(|(_, _, found)| found.is_none()).count() as u64;
    if missing == 0 || options.share == Share::Merge {
        let none =
            || "no result of these settings, cameras and threads is in the folder".to_owned();
        let found = settings.into_iter().map(|(_, _, found)| found.ok_or_else(none));
        return Ok(found.map(|result| (true, result)).collect());
    }
    let reference = source
        .renderer(None, &options.limits)
        .map_err(|error| error.in_file(source.file.path()))?;
    let reference = Reference::Field(Box::new(reference));
    // A folder that stays empty is removed.
    let mut made = Provisional::default();
    made.create_folder(folder)?;
    let references = References::new(&reference, cameras, &options.scales, 1).keep(&options.limits);
    let origin = source.origin();
    // A bake counts as much as all pictures of a setting; either may take longer.
    let bake_work = references.field_work();
    let share = (options.repeat as u64 + 1) * bake_work;
    progress.begin(Step::Sweep, missing * share + references.work() - bake_work);
    let steps = Steps { outer: progress, done: AtomicU64::new(0) };
    let mut bench = Bench { source, origin, options, folder, references, steps, bake_work };
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
        let part = format!("setting {} of {missing}: {}", tried + 1, setting.name);
        progress.part(Step::Sweep, &part);
        SettingRecord::new(setting, &digest, None).write(folder, setting)?;
        let result = match bench.measure(setting) {
            Ok(result) => {
                SettingRecord::new(setting, &digest, Some(result.clone()))
                    .write(folder, setting)?;
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

/// True if an error is not caused by the setting.
pub(super) fn ends_sweep(error: &Error) -> bool {
    matches!(error.kind(), ErrorKind::Io(_) | ErrorKind::Cancelled | ErrorKind::Exists)
}
