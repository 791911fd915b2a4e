//! `unpack`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde::Serialize;

use super::common::Common;
use super::field::{FieldArguments, wrong_kind};
use super::outcome::{Outcome, counted, readable};
use super::output::{STANDARD_STREAM, create as create_output, digest};
use super::progress::Bar;
use crate::base::bytes::{ByteSink, remove_stale};
use crate::base::error::{Error, Result};
use crate::base::progress::Step;
use mipvog_outputs::unpack::{SliceFormat, TensorFormat, write_slices, write_tensors};

/// Turn a container back into dense arrays
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  mipvog-bake unpack scene.mipvog -o scene.safetensors
  mipvog-bake unpack scene.mipvog -o scene.npz --levels 1
  mipvog-bake unpack scene.mipvog -o slices/ --slices png")]
pub struct Arguments {
    /// The container, or a glTF asset with one; - means standard input
    file: PathBuf,
    /// The .safetensors or .npz file to write, or a folder for slices (existing, or ending in a
    /// slash); - means standard output, as safetensors
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Levels to unpack; 0 is the finest [default: all]
    #[arg(long, value_name = "K,...", value_delimiter = ',')]
    levels: Vec<usize>,
    /// Format of slices in a folder [default: exr]
    #[arg(long, value_enum)]
    slices: Option<Slices>,
    #[command(flatten)]
    which: FieldArguments,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Slices {
    /// Stored values as float32, one file per plane
    Exr,
    /// Opacity and diffuse colour as 8-bit pictures
    Png,
}

/// The report of `unpack`.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub(super) struct UnpackReport {
    /// Path of the container or asset.
    input: String,
    /// Path of the written file or folder.
    output: String,
    /// Size of the written file in bytes; absent for a folder of slices.
    #[serde(skip_serializing_if = "Option::is_none")]
    output_bytes: Option<u64>,
    /// SHA-256 of the written file in hexadecimal; absent for a folder of slices.
    #[serde(skip_serializing_if = "Option::is_none")]
    sha256: Option<String>,
    /// Number of unpacked levels.
    levels: usize,
}

/// Unpacks a container.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    arguments.which.check(&[&arguments.file])?;
    let container = arguments.which.container(&arguments.file, &common.limits())?;
    let container = container.ok_or_else(|| {
        let expected = "a .mipvog container, or a glTF asset with one";
        wrong_kind(&arguments.file, expected)
    })?;
    let (output, levels) = (&arguments.output, &arguments.levels);
    let in_file = |error: Error| error.in_file(&arguments.file);
    let asked: BTreeSet<usize> = levels.iter().copied().collect();
    let count = if asked.is_empty() { container.metadata().levels.len() } else { asked.len() };
    let input = arguments.file.to_string_lossy().into_owned();
    let shown = output.to_string_lossy().into_owned();
    if is_folder(output) {
        let format = match arguments.slices {
            None | Some(Slices::Exr) => SliceFormat::Exr,
            Some(Slices::Png) => SliceFormat::Png,
        };
        remove_stale(output);
        write_slices(&container, levels, format, output, arguments.force).map_err(in_file)?;
        let (output_bytes, sha256) = (None, None);
        let report = UnpackReport { input, output: shown, output_bytes, sha256, levels: count };
        let text = format!("{}: slices of {}\n", output.display(), counted(count, "level"));
        return Outcome::new("unpack", &report, text);
    }
    if arguments.slices.is_some() {
        let message =
            "--slices needs a folder as --output: an existing one, or a name that ends in /";
        return Err(Error::usage(message));
    }
    let format = format_of(output)?;
    let mut tensors = create_output(output, arguments.force)?;
    let bar = Bar::new(common);
    bar.plan(vec![(Step::Decode, 1.0)]);
    write_tensors(&container, levels, format, &mut tensors, &bar).map_err(in_file)?;
    drop(bar);
    let bytes = tensors.length();
    let sha256 = Some(digest(tensors.written())?);
    tensors.finish()?;
    let output_bytes = Some(bytes);
    let report = UnpackReport { input, output: shown, output_bytes, sha256, levels: count };
    let (levels, bytes) = (counted(count, "level"), readable(bytes));
    let text = format!("{}: {levels}, {bytes}\n", output.display());
    Outcome::new("unpack", &report, text)
}

/// The kind of file, by its name.
fn format_of(path: &Path) -> Result<TensorFormat> {
    let extension = path.extension().and_then(|extension| extension.to_str());
    match extension {
        _ if path == Path::new(STANDARD_STREAM) => Ok(TensorFormat::Safetensors),
        Some("safetensors") => Ok(TensorFormat::Safetensors),
        Some("npz") => Ok(TensorFormat::Npz),
        _ => Err(Error::usage(format!(
            "-o {}: the name must end in .safetensors, in .npz, or in a slash for a folder of \
             slices",
            path.display()
        ))),
    }
}

fn is_folder(path: &Path) -> bool {
    path.is_dir() || path.as_os_str().to_string_lossy().ends_with(['/', '\\'])
}
