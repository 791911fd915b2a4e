//! Output files of the program.

use std::ffi::OsStr;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use crate::base::bytes::{self, Output, SourceFile, hex, remove_stale, sha256};
use crate::base::error::{Error, Place, Result};
use mipvog_inputs::tensor::extensions;

/// The name of the standard input or output.
pub const STANDARD_STREAM: &str = "-";

/// Arguments that name output files. All other file arguments are inputs.
pub const OUTPUTS: [&str; 5] = ["output", "gltf", "depfile", "results", "junit"];

/// The scheme of an address, such as `s3` of `s3://bucket/key`.
fn scheme(path: &Path) -> Option<&str> {
    let (scheme, _) = path.to_str()?.split_once("://")?;
    let is_scheme = |letter: char| letter.is_ascii_alphanumeric() || "+-.".contains(letter);
    (scheme.starts_with(|letter: char| letter.is_ascii_alphabetic())
        && scheme.chars().all(is_scheme))
    .then_some(scheme)
}

/// The reason to refuse an output's path that is an address: a folder of that name would look like
/// an upload.
pub fn address_reason(path: &Path) -> Option<String> {
    let scheme = scheme(path)?;
    Some(format!(
        "the output is an address, {scheme}://, and outputs are local files: write to a folder and \
         copy it from there, or let python -m mipvog_bake.ray write to a store"
    ))
}

/// Refuses an output that is an address.
///
/// # Errors
/// `Usage`.
pub fn refuse_address(path: &Path) -> Result<()> {
    let reason = address_reason(path).map(Error::usage);
    reason.map_or(Ok(()), |error| Err(error.in_file(&shown(path))))
}

/// An address without its secrets.
fn shown(path: &Path) -> PathBuf {
    bytes::shown(&path.to_string_lossy())
}

/// Refuses an input that is an unsupported address.
///
/// # Errors
/// `Usage`, and `Unsupported` if a build with the network would read it.
pub fn refuse_unread_address(path: &Path) -> Result<()> {
    match scheme(path) {
        Some("https" | "http") if !cfg!(feature = "network") => {
            let found = "an address, and this program was built without the network";
            let error = Error::unsupported(Place::File, found, "a file");
            let advice = "build the program with --features network, or fetch the file first";
            Err(error.advise(advice).in_file(&shown(path)))
        }
        None | Some("https" | "http") => Ok(()),
        Some(scheme) => {
            let message = format!(
                "the input is an address, {scheme}://: files and https:// addresses are read; copy \
                 the file, or let python -m mipvog_bake.ray read from a store"
            );
            Err(Error::usage(message).in_file(&shown(path)))
        }
    }
}

/// SHA-256 of a file, in hexadecimal digits.
pub fn digest(path: &Path) -> Result<String> {
    Ok(hex(&sha256(&SourceFile::open(path)?)?))
}

/// Starts writing `path`, or to the standard output for `-`; an existing file is refused unless
/// `force`. Leftover files of killed runs in its folder are removed first.
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

/// Extensions of files other than containers, beside those of trained models.
const OTHER_KINDS: [&str; 12] =
    ["exr", "gif", "glb", "gltf", "html", "jpeg", "jpg", "mp4", "npy", "png", "webp", "zip"];

/// Starts writing a container.
///
/// # Errors
/// Errors of [`check_container_name`] and of [`create`].
pub fn create_container(path: &Path, force: bool) -> Result<Output> {
    check_container_name(path)?;
    create(path, force)
}

/// Refuses names with the extension of another format.
///
/// # Errors
/// `Usage`.
pub fn check_container_name(path: &Path) -> Result<()> {
    let extension = path.extension().and_then(|extension| extension.to_str());
    match extension.filter(|own| OTHER_KINDS.into_iter().chain(extensions()).any(|of| of == *own)) {
        Some(extension) => {
            let shown = path.display();
            let message =
                format!("-o {shown}: this verb writes a .mipvog container, not .{extension}");
            Err(Error::usage(message).advise(match extension {
                "glb" | "gltf" => {
                    format!("bake --gltf {shown} writes an asset beside the container")
                }
                "html" | "ply" | "vdb" => format!("bake to a .mipvog, then export it: -o {shown}"),
                _ => "end the name in .mipvog".to_owned(),
            }))
        }
        None => Ok(()),
    }
}

/// The reason why a path cannot be a file.
pub fn no_file_reason(path: &Path) -> Option<&'static str> {
    let name = path.as_os_str().as_encoded_bytes();
    if name.contains(&0) {
        return Some("a name with a NUL character");
    }
    (name.ends_with(b"/") || path.file_name().is_none()).then_some("a folder")
}

/// Extensions that nobody gives a folder.
const OF_FILES: [&str; 18] = [
    "csv",
    "exr",
    "glb",
    "gltf",
    "html",
    "jpeg",
    "jpg",
    "json",
    "jsonl",
    "mipvog",
    "npz",
    "ply",
    "png",
    "safetensors",
    "tar",
    "txt",
    "vdb",
    "webp",
];

/// Refuses the name of a file for a new folder that a verb writes.
pub fn refuse_file_name(folder: &Path, remedy: &'static str) -> Result<()> {
    let extension = folder.extension().and_then(OsStr::to_str).map(str::to_lowercase);
    if folder.exists() || !extension.is_some_and(|own| OF_FILES.contains(&&*own)) {
        return Ok(());
    }
    let message = format!("-o {}: found the name of a file, not of a folder", folder.display());
    Err(Error::usage(message).advise(remedy))
}

/// Refuses the standard output if a verb writes a folder, or a file whose name others refer to.
pub fn refuse_stdout(path: &Path, reason: &str) -> Result<()> {
    match path == Path::new(STANDARD_STREAM) {
        true => Err(Error::usage(format!("-o - is not possible here: {reason}"))),
        false => Ok(()),
    }
}
