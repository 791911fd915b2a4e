//! Incremental bakes: current outputs are skipped, and dependency files list the inputs of a bake.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use serde_json::Value;

use super::output::{create as create_output, refuse_stdout};
use super::thumbnail::ThumbnailArguments;
use crate::bake::{BakeOptions, BakeReport, Origin, is_current, level_reports, shell_reports};
use crate::base::bytes::{Output, SourceFile};
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::container::{Container, is_container};
use crate::model::field::RadianceField;

/// Maximum length of a rule's target.
const LONGEST_TARGET: u64 = 8192;

/// Bytes of two containers that are compared at once.
const COMPARED: u64 = 1 << 20;

/// Conditions of a bake, and outputs for build systems.
#[derive(Debug, Args)]
pub struct IncrementalArguments {
    /// Bake only if the input, the options or the version differ from those of the existing
    /// container, and replace it
    #[arg(long)]
    if_changed: bool,
    /// Write a dependency file for Make or Ninja: the container, and every file that it was made
    /// from
    #[arg(long, value_name = "FILE.d")]
    depfile: Option<PathBuf>,
}

impl IncrementalArguments {
    /// True for incremental bakes if the existing container has the same bytes as the new one.
    ///
    /// # Errors
    /// Errors of reading them.
    pub fn is_same(&self, written: &Path, output: &Path) -> Result<bool> {
        if !self.replaces(output) {
            return Ok(false);
        }
        let files = [SourceFile::open(written)?, SourceFile::open(output)?];
        let length = files[0].length();
        let mut same = files[1].length() == length;
        let mut at = 0;
        while same && at < length {
            let count = (length - at).min(COMPARED);
            same = files[0].read(at, count, COMPARED)? == files[1].read(at, count, COMPARED)?;
            at += count;
        }
        Ok(same)
    }

    /// True if an existing output may be replaced: in incremental bakes, a container may.
    pub fn replaces(&self, output: &Path) -> bool {
        self.if_changed && SourceFile::open(output).is_ok_and(|file| is_container(&file))
    }

    /// Starts writing the dependency file of `output`, if requested. An old dependency file is
    /// always replaced, as build systems expect. Other files are not, unless `force`.
    pub fn create_depfile(&self, output: &Path, force: bool) -> Result<Option<Output>> {
        let Some(path) = &self.depfile else { return Ok(None) };
        refuse_stdout(path, "a dependency file is read by its name")?;
        create_output(path, force || is_depfile(path, output)).map(Some)
    }

    /// The dependency file, if requested.
    pub fn depfile(&self) -> Option<&Path> {
        self.depfile.as_deref()
    }

    /// The existing container's figures, if it is current.
    pub fn current(
        &self,
        output: &Path,
        field: &RadianceField,
        options: &BakeOptions,
        origin: &Origin,
        thumbnail: ThumbnailArguments,
        limits: &Limits,
    ) -> Result<Option<BakeReport>> {
        if !self.replaces(output) {
            return Ok(None);
        }
        // An unreadable container is baked anew.
        let file = Arc::new(SourceFile::open(output)?);
        let Ok(container) = Container::open(Arc::clone(&file), limits) else {
            return Ok(None);
        };
        let current =
            thumbnail.is_in(&container) && is_current(&container, field, options, origin)?;
        let provenance = container.provenance()?;
        let options = provenance.map_or(Value::Null, |of| of["options"].clone());
        let (metadata, entries) = (container.metadata(), container.entries());
        let levels = level_reports(metadata, entries, &options);
        let shells = shell_reports(metadata, entries, &options);
        Ok(current.then(|| BakeReport::unchanged(file.length(), levels, shells)))
    }
}

/// True for an empty file, and for a rule of a container or of `output`.
fn is_depfile(path: &Path, output: &Path) -> bool {
    let Ok(file) = SourceFile::open(path) else { return false };
    let start = file.read(0, file.length().min(LONGEST_TARGET), LONGEST_TARGET);
    let Ok(start) = start else { return false };
    let start = String::from_utf8_lossy(&start);
    let target = start.split_once(": ").map(|(target, _)| target);
    file.length() == 0
        || target.is_some_and(|target| {
            target == escaped(output) || (target.ends_with(".mipvog") && !target.contains('\n'))
        })
}

/// The rule of a dependency file: `output` depends on `inputs`. Spaces, `#` and `$` are escaped for
/// Make and Ninja.
pub fn depfile_rule(output: &Path, inputs: &[PathBuf]) -> String {
    let inputs: Vec<String> = inputs.iter().map(|path| escaped(path)).collect();
    format!("{}: {}\n", escaped(output), inputs.join(" "))
}

fn escaped(path: &Path) -> String {
    let mut escaped = String::new();
    for character in path.to_string_lossy().chars() {
        match character {
            ' ' | '#' => escaped.push('\\'),
            '$' => escaped.push('$'),
            _ => {}
        }
        escaped.push(character);
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_escaped() {
        let inputs = ["a b.tar", "c#1.json", "$d"].map(PathBuf::from);
        let rule = depfile_rule(Path::new("out dir/o.mipvog"), &inputs);
        assert_eq!(rule, "out\\ dir/o.mipvog: a\\ b.tar c\\#1.json $$d\n");
    }
}
