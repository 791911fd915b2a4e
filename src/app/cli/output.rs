//! Output files of the program.

use std::io::IsTerminal;
use std::path::Path;

use crate::base::bytes::{Output, remove_stale};
use crate::base::error::{Error, Result};

/// The name of the standard input or output.
pub const STANDARD_STREAM: &str = "-";

/// Starts writing `path`, or to the standard output for `-`; an existing file is refused unless
/// `force`. Files that ended runs of the program left in its folder are removed first.
pub fn create(path: &Path, force: bool) -> Result<Output> {
    if path == Path::new(STANDARD_STREAM) {
        if std::io::stdout().is_terminal() {
            let message = "-o - writes the file to the standard output, which is a terminal here";
            return Err(Error::usage(message));
        }
        return Output::stdout();
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    remove_stale(folder.unwrap_or(Path::new(".")));
    Output::create(path, force)
}

/// Extensions of files that are no containers.
const OTHER_KINDS: [&str; 21] = [
    "ckpt",
    "exr",
    "gif",
    "glb",
    "gltf",
    "html",
    "jpeg",
    "jpg",
    "json",
    "mp4",
    "npy",
    "npz",
    "ply",
    "png",
    "pt",
    "pth",
    "safetensors",
    "tar",
    "vdb",
    "webp",
    "zip",
];

/// Starts writing a container, whose name must not say that it is something else.
pub fn create_container(path: &Path, force: bool) -> Result<Output> {
    let extension = path.extension().and_then(|extension| extension.to_str());
    match extension.filter(|extension| OTHER_KINDS.contains(extension)) {
        Some(extension) => Err(Error::usage(format!(
            "-o {}: this verb writes a container, .mipvog, and no .{extension}",
            path.display()
        ))),
        None => create(path, force),
    }
}

/// Refuses the standard output where a verb writes a folder, or a file whose name others refer to.
pub fn refuse_stdout(path: &Path, reason: &str) -> Result<()> {
    match path == Path::new(STANDARD_STREAM) {
        true => Err(Error::usage(format!("-o - is not possible here: {reason}"))),
        false => Ok(()),
    }
}
