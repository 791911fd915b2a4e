//! The words and the exit code of an error, for users of the command line.

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

use super::interrupt;
use super::outcome::readable;
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, ErrorKind};
use crate::base::limits::Limits;
use crate::input::tensor;
use crate::output::gltf::asset::Asset;
use crate::output::gltf::attach::companions;

/// The error by the names of the command line: the library's options have flags here.
pub(super) fn message(error: &Error) -> String {
    let ErrorKind::InvalidOption { option, .. } = error.kind() else { return error.to_string() };
    error.to_string().replacen(
        &format!("option {option}: "),
        &format!("--{}: ", option.replace('_', "-")),
        1,
    )
}

/// The remedy, by the names of options and verbs.
pub(super) fn remedy(error: &Error) -> Cow<'static, str> {
    match error.kind() {
        ErrorKind::OverLimit { .. } => format!("{}: see --limit", error.remedy()).into(),
        ErrorKind::TooLittleMemory { least, .. } => {
            let shown = readable(*least);
            format!("pass --memory {least} ({shown}) or more, or fewer --threads").into()
        }
        ErrorKind::NonFinite { .. } => {
            "retrain, or pass --nonfinite empty to treat these values as empty".into()
        }
        ErrorKind::Usage { .. } | ErrorKind::InvalidOption { .. } => "see --help".into(),
        ErrorKind::Exists => "pass --force to overwrite it".into(),
        ErrorKind::IsInput => {
            "choose another name for the output; --force does not replace an input".into()
        }
        ErrorKind::WrongKind { .. } => {
            error.file().and_then(next_command).map_or_else(|| error.remedy(), Into::into)
        }
        _ => error.remedy(),
    }
}

/// The command for a file of a kind that the verb does not take.
fn next_command(path: &Path) -> Option<String> {
    let file = Arc::new(SourceFile::open(path).ok()?);
    let shown = path.display();
    let found = tensor::describe(&file).ok()?;
    Some(match found {
        "a .mipvog container" => format!(
            "mipvog-bake view {shown} shows it, mipvog-bake unpack {shown} -o {} takes it apart",
            path.with_extension("safetensors").display()
        ),
        "a glTF binary" => format!("mipvog-bake inspect {shown} lists its radiance fields"),
        "a JSON text" => {
            let asset = Asset::open(file, &Limits::default());
            let names = asset.and_then(|asset| companions(&asset)).unwrap_or_default();
            let is_container = |name: &&String| name.ends_with(".mipvog");
            match names.iter().find(is_container) {
                Some(name) => {
                    format!("name its container, {}", path.with_file_name(name).display())
                }
                None => "a camera file belongs to --cameras, settings to scene.json".to_owned(),
            }
        }
        _ if tensor::is_tensors(&file).is_ok_and(|is_tensors| is_tensors) => format!(
            "if this is a trained scene, bake it first: mipvog-bake bake {shown} -o {}",
            path.with_extension("mipvog").display()
        ),
        _ if found.contains("unpack it first") => format!("unpack {shown}, then name the result"),
        _ => return None,
    })
}

/// The exit code of an error.
pub(super) fn exit_code(kind: &ErrorKind) -> u8 {
    match kind {
        ErrorKind::Usage { .. } | ErrorKind::InvalidOption { .. } => 2,
        ErrorKind::Truncated { .. }
        | ErrorKind::Overflow { .. }
        | ErrorKind::Checksum { .. }
        | ErrorKind::Malformed { .. }
        | ErrorKind::WrongKind { .. }
        | ErrorKind::NonFinite { .. } => 3,
        ErrorKind::Unsupported { .. } => 4,
        ErrorKind::Io(_) => 5,
        ErrorKind::OverLimit { .. } | ErrorKind::TooLittleMemory { .. } => 6,
        ErrorKind::Exists | ErrorKind::IsInput => 7,
        ErrorKind::Cancelled => interrupt::cancelled(),
    }
}
