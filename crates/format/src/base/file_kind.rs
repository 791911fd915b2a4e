//! Detects the kind of a file from its first bytes.

use crate::base::bytes::SourceFile;
use crate::base::error::Result;
use crate::base::text::without_mark;

/// The name of an unknown kind of file.
pub const UNKNOWN: &str = "a file of unknown kind";

/// Names the kind of a file, if its start reveals it.
///
/// # Errors
/// If its start cannot be read.
pub fn describe(file: &SourceFile) -> Result<&'static str> {
    let start = start(file)?;
    let known = old_checkpoint(&start).or_else(|| other_format(&start));
    Ok(known.unwrap_or(match start.as_slice() {
        [] => "an empty file",
        start if is_zip(start) => "a zip file (a PyTorch checkpoint or an .npz file)",
        start if is_safetensors(start) => "a .safetensors file",
        start if start.starts_with(&VDB_MAGIC) => "an OpenVDB file",
        start if start.starts_with(b"NanoVDB") => "a NanoVDB file",
        start if is_document(start) => "a MessagePack document",
        start if is_text(start) => match start.trim_ascii_start().first() {
            Some(b'{') => "a JSON text",
            _ => "a text file",
        },
        _ => UNKNOWN,
    }))
}

/// Bytes that suffice to detect a file's kind.
pub fn start(file: &SourceFile) -> Result<Vec<u8>> {
    let count = file.length().min(264);
    file.read(0, count, count)
}

/// True for a zip file.
pub fn is_zip(start: &[u8]) -> bool {
    start.starts_with(b"PK\x03\x04") || start.starts_with(b"PK\x05\x06")
}

/// Eight bytes of header length, then the header, a JSON object.
pub fn is_safetensors(start: &[u8]) -> bool {
    start.get(8) == Some(&b'{') && !start.get(..8).is_some_and(is_text)
}

/// True if bytes are text; the last character may be cut.
fn is_text(bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes).map_or_else(|error| error.error_len().is_none(), |_| true)
        && !bytes.iter().any(|&byte| byte < b' ' && !b"\t\n\r\x0c".contains(&byte))
}

/// A checkpoint in an obsolete PyTorch format, if the file starts like one.
pub fn old_checkpoint(start: &[u8]) -> Option<&'static str> {
    // The number that torch.save pickled first before version 1.6.
    const LEGACY: &[u8] = b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19";
    Some(match start {
        _ if start.starts_with(LEGACY) => {
            "a checkpoint in the format of PyTorch before 1.6 (load and save it again with \
             torch.save of any newer version)"
        }
        _ if is_tar(start) && LEGACY_ENTRIES.iter().any(|name| start.starts_with(name)) => {
            "a tar file (the first checkpoints of PyTorch were; load and save it again with \
             torch.save of a version since 1.6)"
        }
        [0x80, 2..=5, ..] => "a bare pickle without tensors",
        _ => return None,
    })
}

/// Entries of the first checkpoints of PyTorch.
const LEGACY_ENTRIES: [&[u8]; 4] = [b"sys_info\0", b"pickle\0", b"storages\0", b"tensors\0"];

fn is_tar(start: &[u8]) -> bool {
    start.get(257..262) == Some(b"ustar")
}

/// The kind of a text that a failed download leaves in place of a file, and the remedy.
pub fn no_download(start: &[u8]) -> Option<[&'static str; 2]> {
    let text = without_mark(start).trim_ascii_start();
    let starts = |with: &str| {
        text.get(..with.len()).is_some_and(|text| text.eq_ignore_ascii_case(with.as_bytes()))
    };
    if starts("version https://git-lfs.github.com/spec/") {
        return Some(["a Git LFS pointer, which stands for the file", "fetch it: git lfs pull"]);
    }
    if ["<!doctype html", "<html", "<head", "<body"].into_iter().any(starts) {
        return Some([
            "a web page",
            "open it in a browser; if a download left it in place of a scene, download the scene \
             again",
        ]);
    }
    starts("<?xml").then_some([
        "an XML text",
        "if a download left it in place of a scene, download the scene again",
    ])
}

/// The format of a file with this start, if people commonly mistake it for a scene.
fn other_format(start: &[u8]) -> Option<&'static str> {
    Some(match start {
        [0x89, b'M', b'V', b'G', ..] => "a .mipvog container",
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => "a single NumPy array (save it as .npz)",
        [0x89, b'H', b'D', b'F', ..] => "an HDF5 file",
        [0x1f, 0x8b, ..] => "a gzip file (unpack it first; splats in .spz have no density to bake)",
        [0x28, 0xb5, 0x2f, 0xfd, ..] => "a zstd file (unpack it first)",
        [b'g', b'l', b'T', b'F', ..] => "a glTF binary",
        [0x89, b'P', b'N', b'G', ..] => "a PNG picture",
        [0xff, 0xd8, 0xff, ..] => "a JPEG picture",
        [b'G', b'I', b'F', b'8', ..] => "a GIF picture",
        [0x76, 0x2f, 0x31, 0x01, ..] => "an OpenEXR picture",
        [b'p', b'l', b'y', b'\n' | b'\r', ..] => "a PLY file",
        _ if is_tar(start) => "a tar file (unpack it first, and name the file in it)",
        _ => return no_download(start).map(|[kind, _]| kind),
    })
}

/// The first bytes of an OpenVDB file.
pub const VDB_MAGIC: [u8; 8] = [0x20, 0x42, 0x44, 0x56, 0, 0, 0, 0];

/// True for the start of a MessagePack document: a map whose first key is a word.
pub fn is_document(start: &[u8]) -> bool {
    let key = match start {
        [0x81..=0x8f, key @ ..] | [0xde, _, _, key @ ..] | [0xdf, _, _, _, _, key @ ..] => key,
        _ => return false,
    };
    let (length, text) = match key {
        [length @ 0xa1..=0xbf, text @ ..] => (length & 31, text),
        [0xd9, length, text @ ..] => (*length, text),
        _ => return false,
    };
    let text = text.get(..text.len().min(length.into())).unwrap_or_default();
    !text.is_empty() && text.iter().all(|byte| byte.is_ascii_alphanumeric() || *byte == b'_')
}
