//! Bakes the scenes of a manifest, one after another.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Instant;

use super::super::common::Common;
use super::super::outcome::{Outcome, say, write_stdout};
use super::super::output::{create, refuse_file_name, refuse_stdout};
use super::arguments::{ExplicitOptions, ManifestArguments};
use super::options::OptionKind;
use super::part::Part;
use super::read::{CheckScene, Lines, Manifest};
use super::result::SceneResult;
use super::words::Words;
use crate::base::bytes::{ByteSink, Output};
use crate::base::error::{Error, ErrorKind, Result};

/// Settings of the command line for all scenes.
pub struct BatchOptions<'a> {
    /// The manifest.
    pub manifest: &'a Path,
    /// Its scenes to bake.
    pub arguments: &'a ManifestArguments,
    /// Options of every scene.
    pub given: &'a ExplicitOptions,
    /// The folder of the outputs, if `given` has one; else it is the manifest's.
    pub outputs: &'a Path,
    /// True if a file other than results may be replaced.
    pub force: bool,
    /// Refuses values of a scene's words.
    pub check: CheckScene<'a>,
}

/// Bakes the part of a manifest that the arguments choose. `scene` runs the words of one bake.
///
/// A single scene's error is that of the program, so that schedulers see its exit code.
///
/// # Errors
/// Errors of the manifest and of the results' file; a scene's error only if it was selected by
/// number.
pub fn run(
    batch: &BatchOptions,
    known: &[OptionKind],
    common: &Common,
    scene: &dyn Fn(Vec<OsString>) -> Result<Outcome>,
) -> Result<Outcome> {
    let &BatchOptions { manifest, arguments, given, outputs, force, check } = batch;
    refuse_stdout(outputs, "--output is a folder beside --manifest")?;
    refuse_file_name(outputs, "name a folder, such as -o baked/")?;
    let part = Part::of(arguments)?;
    let outputs = match given.has("output") {
        true => absolute(outputs)?,
        false => PathBuf::new(),
    };
    let words = Words { given, known, outputs: &outputs };
    let results = arguments.results.as_deref().map(absolute).transpose()?;
    let mut lines = Manifest::open(manifest, &words, results.as_deref(), check)?;
    let count = lines.scenes;
    if let Part::Scene(number) = part
        && number >= count
    {
        let message = format!("found scene {number}, expected one of 0 to {}", count - 1);
        return Err(Error::usage(message).in_file(manifest));
    }
    let mut results = Results::create(arguments, force)?;
    // All paths of a line are relative to the manifest.
    let folder = manifest.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder {
        std::env::set_current_dir(folder).map_err(|error| Error::io(error, folder))?;
    }
    let (mut done, mut failed, mut number) = (0, 0, 0);
    while let Some((at, line)) = lines.next_scene()? {
        number += 1;
        if !part.has(number - 1) {
            continue;
        }
        let clock = Instant::now();
        common.warnings.begin(&line.input);
        let outcome = scene(words.of(&line));
        if let Err(error) = &outcome
            && matches!(error.kind(), ErrorKind::Cancelled)
        {
            return outcome;
        }
        let result = SceneResult::of(&line, &outcome, clock.elapsed().as_secs_f64(), common);
        results.add(&result)?;
        done += 1;
        failed += u64::from(result.is_failed());
        if let Part::Scene(_) = part {
            results.finish()?;
            return outcome.map(|outcome| Outcome::reported(outcome.failure));
        }
        if let Some(reason) = result.error.filter(|_| !common.quiet) {
            say(&format!("{} line {at}: {reason}", manifest.display()));
        }
    }
    results.finish()?;
    let failure = format!("{failed} of {done} scenes could not be baked");
    Ok(Outcome::reported((failed > 0).then_some(failure)))
}

/// A path that does not depend on the working folder.
fn absolute(path: &Path) -> Result<PathBuf> {
    std::path::absolute(path).map_err(|error| Error::io(error, path))
}

/// The results, on stdout and in a file if requested.
struct Results(Option<Output>);

impl Results {
    fn create(arguments: &ManifestArguments, force: bool) -> Result<Self> {
        let Some(path) = &arguments.results else { return Ok(Self(None)) };
        refuse_stdout(path, "results are on the standard output anyway")?;
        create(&absolute(path)?, force || is_results(path)).map(|file| Self(Some(file)))
    }

    fn add(&mut self, result: &SceneResult) -> Result<()> {
        let line = result.line()?;
        if let Some(file) = &mut self.0 {
            file.append(line.as_bytes())?;
        }
        write_stdout(line.as_bytes())
    }

    fn finish(self) -> Result<()> {
        self.0.map_or(Ok(()), Output::finish)
    }
}

/// True for results of an earlier run, and for an empty file.
fn is_results(path: &Path) -> bool {
    let first = Lines::open(path).and_then(|mut lines| lines.next_line());
    match first {
        Ok(Some((_, line))) => serde_json::from_str::<SceneResult>(&line).is_ok(),
        Ok(None) => true,
        Err(_) => false,
    }
}
