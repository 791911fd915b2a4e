//! Tells the kind of a file by its first bytes.

use super::msgpack::packing;
use super::parameters::is_parameters;
use super::vdb::is_vdb;
use crate::base::bytes::SourceFile;
use crate::base::error::Result;

/// True if a file starts like one of tensors.
///
/// # Errors
/// If its start cannot be read.
pub fn is_tensors(file: &SourceFile) -> Result<bool> {
    let start = start(file)?;
    let known =
        is_zip(&start) || is_safetensors(&start) || packing(&start).is_some() || is_vdb(&start);
    Ok(known || is_parameters(file)?)
}

/// Names the kind of a file, as far as its start tells.
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
        start if is_vdb(start) => "an OpenVDB file",
        start if packing(start).is_some() => "a MessagePack document",
        start if is_text(start) => match start.trim_ascii_start().first() {
            Some(b'{') => "a JSON text",
            _ => "a text file",
        },
        _ => "a file of unknown kind",
    }))
}

/// As many bytes as tell a file's kind.
pub(super) fn start(file: &SourceFile) -> Result<Vec<u8>> {
    let count = file.length().min(264);
    file.read(0, count, count)
}

pub(super) fn is_zip(start: &[u8]) -> bool {
    start.starts_with(b"PK\x03\x04") || start.starts_with(b"PK\x05\x06")
}

/// Eight bytes of header length, then the header, a JSON object.
pub(super) fn is_safetensors(start: &[u8]) -> bool {
    start.get(8) == Some(&b'{') && !start.get(..8).is_some_and(is_text)
}

/// True if bytes are text; the last character may be cut.
fn is_text(bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes).map_or_else(|error| error.error_len().is_none(), |_| true)
        && !bytes.iter().any(|&byte| byte < b' ' && !b"\t\n\r\x0c".contains(&byte))
}

/// A checkpoint in a format that PyTorch has left, if a file starts so.
pub(super) fn old_checkpoint(start: &[u8]) -> Option<&'static str> {
    // The number that torch.save pickled first before version 1.6.
    const LEGACY: &[u8] = b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19";
    Some(match start {
        _ if start.starts_with(LEGACY) => {
            "a checkpoint in the format of PyTorch before 1.6 (load and save it again with \
             torch.save of any newer version)"
        }
        _ if start.get(257..262) == Some(b"ustar") => {
            "a tar file (the first checkpoints of PyTorch were; load and save it again with \
             torch.save of a version since 1.6)"
        }
        [0x80, 2..=5, ..] => "a bare pickle without tensors",
        _ => return None,
    })
}

/// The format of a file that starts so, if it is one that people mistake for a scene.
fn other_format(start: &[u8]) -> Option<&'static str> {
    Some(match start {
        [0x89, b'M', b'V', b'G', ..] => "a .mipvog container",
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => "a single NumPy array (save it as .npz)",
        [0x89, b'H', b'D', b'F', ..] => "an HDF5 file",
        [0x1f, 0x8b, ..] => "a gzip file (unpack it first)",
        [0x28, 0xb5, 0x2f, 0xfd, ..] => "a zstd file (unpack it first)",
        [b'g', b'l', b'T', b'F', ..] => "a glTF binary",
        [0x89, b'P', b'N', b'G', ..] => "a PNG picture",
        [0xff, 0xd8, 0xff, ..] => "a JPEG picture",
        [b'G', b'I', b'F', b'8', ..] => "a GIF picture",
        [0x76, 0x2f, 0x31, 0x01, ..] => "an OpenEXR picture",
        [b'p', b'l', b'y', b'\n' | b'\r', ..] => "a PLY file",
        _ => return None,
    })
}
