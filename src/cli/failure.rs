//! The message and the exit code of an error, for users of the command line.

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

use super::folders;
use super::interrupt;
use super::outcome::{assumed, readable};
use super::shell;
use super::stdin::named;
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, ErrorKind, Place};
use crate::base::error_class::ErrorClass;
use crate::base::file_kind::{no_download, start};
use crate::base::limits::Limits;
use mipvog_inputs::{UNPACKED, tensor};
use mipvog_outputs::gltf::asset::{Asset, EXTENSION};
use mipvog_outputs::gltf::attach::companions;

/// The place of the fault of a JSON text that is not a glTF asset.
const NO_ASSET: &str = "/asset/version";
/// The use of JSON texts of other kinds.
const OTHER_JSON: &str = "pass a camera file with --cameras; settings belong in scene.json";

/// The place of the fault of an asset without fields.
fn no_field() -> Place {
    Place::Pointer(format!("/extensions/{EXTENSION}"))
}

/// The error with the names of the command line, where the library's options are flags.
pub(super) fn message(error: &Error) -> String {
    let option = match error.kind() {
        ErrorKind::InvalidOption { option, .. } => option,
        ErrorKind::Unsupported { .. } => return named(&assumed(&error.to_string())),
        // Verbs take more than models.
        ErrorKind::WrongKind { expected, .. } if *expected == tensor::expected() => {
            let all = format!("a .mipvog container, a glTF asset with one, {expected}");
            return named(&error.to_string().replacen(expected, &all, 1));
        }
        _ => return named(&error.to_string()),
    };
    named(&error.to_string()).replacen(
        &format!("option {option}: "),
        &format!("--{}: ", flag(option)),
        1,
    )
}

/// The flag of an option of the library.
fn flag(option: &str) -> String {
    match option {
        "seen_from" => "cameras".to_owned(),
        _ => option.replace('_', "-"),
    }
}

/// The remedy, by the names of options and verbs.
pub(super) fn remedy(error: &Error) -> Cow<'static, str> {
    if let Some(advice) = error.advice() {
        return named(advice).into();
    }
    match error.kind() {
        ErrorKind::OverLimit { limit: Some(limit), .. } => {
            format!("raise --limit {} if this input is trusted", limit.name()).into()
        }
        ErrorKind::OverLimit { limit: None, .. } => "no option allows more".into(),
        ErrorKind::TooLittleMemory { least, .. } => {
            let shown = readable(*least);
            format!("pass --memory {least} ({shown}) or more, or fewer --threads").into()
        }
        ErrorKind::NonFinite { .. } => {
            "retrain, or bake with --nonfinite empty, which treats these values as empty".into()
        }
        ErrorKind::Usage { .. } | ErrorKind::InvalidOption { .. } => "see --help".into(),
        ErrorKind::Io(io) if io.kind() == std::io::ErrorKind::IsADirectory => {
            error.file().map_or_else(|| error.remedy(), |folder| folders::of_folder(folder).into())
        }
        ErrorKind::Exists => "pass --force to overwrite it".into(),
        ErrorKind::IsInput => {
            "choose another name for the output; --force does not replace an input".into()
        }
        ErrorKind::WrongKind { found, .. } => {
            let next = error.file().and_then(|path| next_command(path, found));
            next.map_or_else(|| error.remedy(), |next| named(&next).into())
        }
        ErrorKind::Malformed { .. }
            if !matches!(error.place(), Place::Line(_))
                && error
                    .file()
                    .is_some_and(|file| file.extension().is_some_and(|e| e == "jsonl")) =>
        {
            "a list of scenes is the manifest of a bake: bake --manifest".into()
        }
        ErrorKind::Malformed { .. } if *error.place() == Place::Pointer(NO_ASSET.to_owned()) => {
            format!("if this is no glTF asset: {OTHER_JSON}").into()
        }
        ErrorKind::Malformed { .. } if *error.place() == no_field() => {
            "put a container in with mipvog-bake attach, or name a container".into()
        }
        ErrorKind::Malformed { .. } if matches!(error.place(), Place::Line(_)) => {
            "correct this line".into()
        }
        _ => error.remedy(),
    }
}

/// The command for a file of a kind that the verb does not accept.
fn next_command(path: &Path, found: &str) -> Option<String> {
    let file = Arc::new(SourceFile::open(path).ok()?);
    let shown = path.display();
    let kind = tensor::describe(&file).ok()?;
    let own = path.as_os_str();
    let of = |verb: &str, extension: &str| {
        let output = path.with_extension(extension);
        shell::command([verb.as_ref(), own, "-o".as_ref(), output.as_os_str()])
    };
    Some(match kind {
        "a .mipvog container" => format!(
            "{} shows it, {} unpacks it",
            shell::command(["view".as_ref(), own]),
            of("unpack", "safetensors")
        ),
        "a glTF binary" => {
            let inspect = shell::command(["inspect".as_ref(), own]);
            format!("{inspect} lists its radiance fields")
        }
        "a JSON text" => {
            let asset = Asset::open(file, &Limits::default());
            let names = asset.and_then(|asset| companions(&asset)).unwrap_or_default();
            let is_container = |name: &&String| name.ends_with(".mipvog");
            match names.iter().find(is_container) {
                Some(name) => {
                    format!("name its container, {}", path.with_file_name(name).display())
                }
                None => OTHER_JSON.to_owned(),
            }
        }
        _ if found == UNPACKED => format!("pack it first: {}", of("bake", "mipvog")),
        // The verb recognized the file, but found the wrong tensors.
        _ if found != kind => return None,
        _ if tensor::is_tensors(&file).is_ok_and(|is_tensors| is_tensors) => {
            format!("if this is a trained scene, bake it first: {}", of("bake", "mipvog"))
        }
        _ if kind.contains("unpack it first") => format!("unpack {shown}, then name the result"),
        _ => {
            let [_, remedy] = no_download(&start(&file).ok()?)?;
            remedy.to_owned()
        }
    })
}

/// True if a run with this exit code is worth retrying.
pub(super) fn retry(exit_code: u8) -> &'static str {
    match exit_code {
        5 => "yes, unless the file is missing",
        130 | 143 => "yes",
        6 | 137 => "with more memory",
        _ => "no",
    }
}

/// The exit code of an error.
pub(super) fn exit_code(kind: &ErrorKind) -> u8 {
    match kind.class() {
        ErrorClass::Usage => 2,
        ErrorClass::Malformed => 3,
        ErrorClass::Unsupported => 4,
        ErrorClass::InputOutput => 5,
        ErrorClass::Limit => 6,
        ErrorClass::Exists => 7,
        ErrorClass::Cancelled => interrupt::cancelled(),
    }
}
