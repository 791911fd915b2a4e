//! `report`.

use std::collections::{BTreeMap, HashMap};
use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::failure::retry;
use super::junit::junit;
use super::layout::{columns, folded};
use super::manifest::{Lines, SceneResult, Status};
use super::outcome::{Outcome, counted, readable};
use super::output::create;
use crate::base::bytes::{ByteSink, Output};
use crate::base::error::{Error, Place, Result};

/// Merge the results of a batch
///
/// Files are read in order. If an output has several results, the last one counts, so pass the
/// results of a retry after those of the first run. The exit code is 1 if a scene failed.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mipvog-bake report results-0.jsonl results-1.jsonl
  mipvog-bake report results-*.jsonl --junit results.xml")]
pub struct Arguments {
    /// Results of `bake --manifest`, or of `python -m mipvog_bake.ray`
    #[arg(required = true, value_name = "RESULTS.jsonl")]
    results: Vec<PathBuf>,
    /// Also write the results as JUnit's XML, for CI systems
    #[arg(long, value_name = "FILE.xml")]
    junit: Option<PathBuf>,
    /// Overwrite the file of --junit if it exists
    #[arg(long)]
    force: bool,
}

/// Failures in the table for people.
const SHOWN: usize = 20;

/// A scene that could not be baked.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
struct Failure {
    /// Path of the input, as in the manifest.
    input: String,
    /// Path of the output, as in the manifest.
    output: String,
    /// Exit code of a bake of this scene alone.
    exit_code: u8,
    /// Reason for the failure, and its remedy.
    error: String,
    /// Advice on retrying.
    retry: &'static str,
}

/// The scenes with one exit code.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
struct ExitCode {
    /// The exit code.
    exit_code: u8,
    /// Number of scenes.
    scenes: u64,
    /// Advice on retrying.
    retry: &'static str,
}

/// The merged results of a batch.
#[derive(Debug, Default, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub(super) struct BatchReport {
    /// Number of files of results.
    files: usize,
    /// Number of scenes.
    scenes: u64,
    /// Number of scenes that were baked.
    baked: u64,
    /// Number of scenes whose container was up to date.
    current: u64,
    /// Number of scenes that could not be baked.
    failed: u64,
    /// Total size of the containers in bytes.
    output_bytes: u64,
    /// Sum of the wall-clock times of all scenes, in seconds.
    seconds: f64,
    /// Lowest PSNR of any scene in dB; null if none was measured.
    least_psnr: Option<f64>,
    /// Numbers of scenes by exit code, lowest code first.
    exit_codes: Vec<ExitCode>,
    /// Scenes that could not be baked.
    failures: Vec<Failure>,
}

/// Merges results.
pub fn run(arguments: &Arguments) -> Result<Outcome> {
    let junit_file = arguments.junit.as_deref();
    let mut junit_file = junit_file.map(|path| create(path, arguments.force)).transpose()?;
    let mut scenes: HashMap<String, (usize, SceneResult)> = HashMap::new();
    for path in &arguments.results {
        let mut lines = Lines::open(path)?;
        while let Some((number, line)) = lines.next_line()? {
            let result: SceneResult = serde_json::from_str(&line).map_err(|error| {
                let found = format!("no result of a scene ({error})");
                let expected = "input, output, status, exit_code, seconds, output_bytes, error";
                Error::malformed(Place::Line(number), found, expected).in_file(path)
            })?;
            // A later result replaces an earlier one.
            let place = scenes.len();
            let entry = scenes.entry(result.output.clone()).or_insert((place, result.clone()));
            entry.1 = result;
        }
    }
    let mut scenes: Vec<_> = scenes.into_values().collect();
    scenes.sort_unstable_by_key(|(place, _)| *place);
    if let Some(file) = &mut junit_file {
        file.append(junit(scenes.iter().map(|(_, scene)| scene)).as_bytes())?;
    }
    junit_file.map_or(Ok(()), Output::finish)?;
    let report =
        BatchReport::of(arguments.results.len(), scenes.into_iter().map(|(_, scene)| scene));
    let failure = (report.failed > 0)
        .then(|| format!("{} of {} scenes could not be baked", report.failed, report.scenes));
    Ok(Outcome { failure, ..Outcome::new("report", &report, report.text())? })
}

impl BatchReport {
    fn of(files: usize, results: impl Iterator<Item = SceneResult>) -> Self {
        let mut report = Self { files, ..Self::default() };
        let mut codes: BTreeMap<u8, u64> = BTreeMap::new();
        for result in results {
            let exit_code = result.exit_code;
            report.scenes += 1;
            report.output_bytes += result.output_bytes.unwrap_or(0);
            report.seconds += result.seconds.unwrap_or(0.0);
            let psnr = [report.least_psnr, result.psnr].into_iter().flatten();
            report.least_psnr = psnr.reduce(f64::min);
            *codes.entry(exit_code).or_default() += 1;
            match result.status {
                Status::Baked => report.baked += 1,
                Status::Current => report.current += 1,
                Status::Forecast => {}
                Status::Failed => {
                    report.failed += 1;
                    let SceneResult { input, output, error, .. } = result;
                    let (error, retry) = (error.unwrap_or_default(), retry(exit_code));
                    report.failures.push(Failure { input, output, exit_code, error, retry });
                }
            }
        }
        let code = |(exit_code, scenes)| ExitCode { exit_code, scenes, retry: retry(exit_code) };
        report.exit_codes = codes.into_iter().map(code).collect();
        report
    }

    fn text(&self) -> String {
        let scenes = counted(usize::try_from(self.scenes).unwrap_or(usize::MAX), "scene");
        let (bytes, seconds) = (readable(self.output_bytes), self.seconds);
        let Self { baked, current, failed, .. } = self;
        let mut text = format!(
            "{scenes}: {baked} baked, {current} unchanged, {failed} failed; {bytes}, {seconds:.1} s"
        );
        if let Some(psnr) = self.least_psnr {
            write!(text, ", at least {psnr:.2} dB").ok();
        }
        text += "\n  exit code     scenes  retry?\n";
        for ExitCode { exit_code, scenes, retry } in &self.exit_codes {
            let retry = if *exit_code == 0 { "" } else { retry };
            text += format!("  {exit_code:9} {scenes:10}  {retry}").trim_end();
            text.push('\n');
        }
        for Failure { output, exit_code, error, .. } in self.failures.iter().take(SHOWN) {
            let line = format!("  {output}: exit code {exit_code}: {error}");
            text += &(folded(&line, columns(), 4) + "\n");
        }
        if let Some(more) = self.failures.len().checked_sub(SHOWN + 1) {
            writeln!(text, "  and {} more; --format json lists all", more + 1).ok();
        }
        text
    }
}
