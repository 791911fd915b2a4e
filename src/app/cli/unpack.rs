//! `unpack`.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::json;

use super::common::Common;
use super::field::FieldArguments;
use super::outcome::{Outcome, readable};
use super::output::create as create_output;
use super::progress::Bar;
use crate::base::bytes::{ByteSink, remove_stale};
use crate::base::error::{Error, Place, Result};
use crate::base::progress::Step;
use crate::codec::unpack::{SliceFormat, write_slices, write_tensors};

/// Turn a container back into dense arrays
#[derive(Debug, Args)]
pub struct Arguments {
    /// The container, or a glTF asset with one
    file: PathBuf,
    /// The .safetensors file to write, or a folder (existing, or ending in a slash) for slices
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Levels to unpack, 0 being the finest [default: all]
    #[arg(long, value_name = "K,...", value_delimiter = ',')]
    levels: Vec<usize>,
    /// Contents of slices in a folder
    #[arg(long, value_enum, default_value_t = Slices::Exr)]
    slices: Slices,
    #[command(flatten)]
    which: FieldArguments,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Slices {
    /// Stored values as float32, one file a plane.
    Exr,
    /// Opacity and diffuse colour as 8-bit pictures.
    Png,
}

/// Unpacks a container.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    let container = arguments.which.container(&arguments.file, &common.limits())?;
    let container = container.ok_or_else(|| {
        let found = "a file of another kind";
        let error = Error::malformed(Place::File, found, "a container, or a glTF asset with one");
        error.in_file(&arguments.file)
    })?;
    let (output, levels) = (&arguments.output, &arguments.levels);
    let count = if levels.is_empty() { container.metadata().levels.len() } else { levels.len() };
    let input = arguments.file.to_string_lossy();
    if is_folder(output) {
        let format = match arguments.slices {
            Slices::Exr => SliceFormat::Exr,
            Slices::Png => SliceFormat::Png,
        };
        remove_stale(output);
        write_slices(&container, levels, format, output, arguments.force)?;
        let report = json!({ "input": input, "output": output.to_string_lossy(), "levels": count });
        let text = format!("{}: slices of {count} levels\n", output.display());
        return Outcome::new("unpack", &report, text);
    }
    let mut tensors = create_output(output, arguments.force)?;
    let bar = Bar::new(common);
    bar.plan(vec![(Step::Decode, 1.0)]);
    write_tensors(&container, levels, &mut tensors, &bar)?;
    drop(bar);
    let bytes = tensors.length();
    tensors.finish()?;
    let report = json!({
        "input": input, "output": output.to_string_lossy(), "output_bytes": bytes, "levels": count,
    });
    let text = format!("{}: {count} levels, {}\n", output.display(), readable(bytes));
    Outcome::new("unpack", &report, text)
}

fn is_folder(path: &Path) -> bool {
    path.is_dir() || path.as_os_str().to_string_lossy().ends_with(['/', '\\'])
}
