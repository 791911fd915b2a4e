//! The files that a command line names.

use std::path::{Component, Path, PathBuf};

use clap::ArgMatches;

use super::inputs::guards;
use super::output::{OUTPUTS, STANDARD_STREAM, refuse_address, refuse_unread_address};
use crate::base::bytes::Guard;
use crate::base::error::{Error, Result};

/// The files that the arguments name.
#[derive(Default)]
pub struct FileNames {
    outputs: Vec<PathBuf>,
    /// True if an output is the standard output.
    pub to_stdout: bool,
    inputs: Vec<PathBuf>,
    /// Inputs, which no output may replace: also those that a verb reads and closes again.
    _guards: Vec<Guard>,
}

impl FileNames {
    /// Of parsed arguments.
    pub fn of(matches: &ArgMatches) -> Self {
        let mut names = Self::default();
        let Some((_, matches)) = matches.subcommand() else { return names };
        for id in matches.ids().map(clap::Id::as_str) {
            // A group of arguments has no values of its own.
            let Ok(Some(values)) = matches.try_get_raw(id) else { continue };
            for value in values.map(Path::new) {
                match OUTPUTS.contains(&id) {
                    true => {
                        names.to_stdout |= value == Path::new(STANDARD_STREAM);
                        names.outputs.push(value.to_owned());
                    }
                    false => {
                        names._guards.extend(guards(value));
                        names.inputs.push(value.to_owned());
                    }
                }
            }
        }
        names
    }

    /// Refuses duplicate outputs and unsupported addresses.
    ///
    /// # Errors
    /// `Usage`, and `Unsupported` for an address that a build with the network supports.
    pub fn check(&self) -> Result<()> {
        self.outputs.iter().try_for_each(|path| refuse_address(path))?;
        self.inputs.iter().try_for_each(|path| refuse_unread_address(path))?;
        let place = |path: &PathBuf| {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            let folder = folder.unwrap_or(Path::new("."));
            (canonical(folder), path.file_name().map(ToOwned::to_owned))
        };
        for (number, path) in self.outputs.iter().enumerate() {
            if self.outputs[..number].iter().any(|other| place(other) == place(path)) {
                let message = format!("two outputs have the name {}", path.display());
                return Err(Error::usage(message));
            }
        }
        Ok(())
    }
}

/// The canonical name of a folder, which may not exist yet.
fn canonical(folder: &Path) -> PathBuf {
    let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    let mut place = PathBuf::new();
    for part in absolute.components() {
        match part {
            Component::ParentDir => drop(place.pop()),
            part => place.push(part),
        }
        // Links above `..` lead elsewhere.
        place = place.canonicalize().unwrap_or(place);
    }
    place
}
