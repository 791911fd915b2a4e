//! NumPy archives: a zip file of `.npy` arrays, as `numpy.savez` and `savez_compressed` write.
//!
//! ```text
//! 93 "NUMPY" major minor, header length (2 bytes in version 1, else 4),
//! {'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }, then the numbers
//! ```

use std::sync::Arc;

use serde::Deserialize;

use super::array::Tensor;
use super::digest::{Digest, add_directory};
use super::file::{FileKind, TensorFile};
use super::value::Value;
use super::zip::{Archive, Data, Entry};

use crate::base::bytes::{ByteReader, SourceFile, Storage};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::model::grid::Element;

/// Signature, version and the longest header length.
const PREFIX: u64 = 12;

/// Extension of arrays inside the archive.
const EXTENSION: &str = ".npy";

/// Opens a zip file of arrays: reads their headers.
pub(super) fn open(
    file: &Arc<SourceFile>,
    archive: &Arc<Archive>,
    limits: &Limits,
) -> Result<TensorFile> {
    if archive.entries().is_empty() {
        let expected = "a PyTorch checkpoint or a NumPy archive";
        return Err(Error::unsupported(Place::File, "an empty zip file", expected));
    }
    let mut digest = Digest::new("npz");
    add_directory(&mut digest, archive.entries());
    let names: Vec<Option<&str>> =
        archive.entries().iter().map(|entry| array_name(&entry.name)).collect();
    let folder = common_folder(names.iter().copied().flatten());
    let mut root = Vec::with_capacity(archive.entries().len());
    for (number, (entry, name)) in archive.entries().iter().zip(names).enumerate() {
        let Some(name) = name.and_then(|name| name.get(folder..)) else { continue };
        let (value, header) = read_array(archive, number, entry, name, limits)?;
        digest.bytes(&header);
        root.push((name.to_owned(), value));
    }
    if root.is_empty() {
        return Err(without_arrays(archive));
    }
    Ok(TensorFile {
        kind: FileKind::Npz,
        has_checksums: archive.states_sums(),
        root: Value::Dict(root),
        digest: digest.finish(),
        file: Arc::clone(file),
    })
}

/// The name of an array; none for other entries, such as notes, folders and macOS metadata
/// (`__MACOSX/._NAME`).
fn array_name(entry: &str) -> Option<&str> {
    let name = entry.strip_suffix(EXTENSION)?;
    let is_mac = name.split('/').any(|part| part == "__MACOSX" || part.starts_with("._"));
    (!is_mac && !name.is_empty()).then_some(name)
}

/// Length of the common folder's name, for archives that were packed from a folder.
fn common_folder<'a>(mut names: impl Iterator<Item = &'a str> + Clone) -> usize {
    let first = names.clone().next().unwrap_or_default();
    let ends = first.match_indices('/').map(|(at, _)| at + 1);
    let mut shared = ends.filter(|&end| names.clone().all(|name| name.starts_with(&first[..end])));
    let end = shared.next_back().unwrap_or(0);
    match names.any(|name| name.len() == end) {
        true => 0,
        false => end,
    }
}

/// The error for a zip file of other things.
fn without_arrays(archive: &Archive) -> Error {
    let expected = "a PyTorch checkpoint (with data.pkl) or a NumPy archive (with .npy entries)";
    let files = archive.entries().iter().filter(|entry| !entry.name.ends_with('/'));
    let first = files.map(|entry| entry.name.as_str()).next().unwrap_or_default();
    let found = format!("a zip file without arrays, with {first}");
    let error = Error::unsupported(Place::File, found, expected);
    error.advise("unpack it, and name the file in it")
}

/// Reads an array's header.
fn read_array(
    archive: &Arc<Archive>,
    number: usize,
    entry: &Entry,
    name: &str,
    limits: &Limits,
) -> Result<(Value, Vec<u8>)> {
    let place = Place::Entry(entry.name.clone());
    let prefix = archive.head(number, PREFIX)?;
    let mut reader = ByteReader::new(&prefix, entry.offset);
    if reader.take(6)? != b"\x93NUMPY" {
        return Err(Error::malformed(place, "no NumPy signature", "a .npy array"));
    }
    let (major, minor) = (reader.u8()?, reader.u8()?);
    let (before, length) = match major {
        1 => (10, u64::from(reader.u16()?)),
        2 | 3 => (12, u64::from(reader.u32()?)),
        _ => {
            let found = format!("version {major}.{minor} of the array format");
            return Err(Error::unsupported(place, found, "1.0, 2.0 or 3.0"));
        }
    };
    limits::check(
        LimitName::HeaderBytes,
        "bytes of a header",
        length,
        limits.header_bytes,
        &place,
    )?;
    let skip = before + length;
    let header = archive.head(number, skip)?;
    let mut reader = ByteReader::new(&header, entry.offset);
    let whole = reader.take(usize::try_from(skip).unwrap_or(usize::MAX))?;
    let literal = whole.get(usize::try_from(before).unwrap_or(0)..).unwrap_or_default();
    let described = read_header(literal).ok_or_else(|| {
        let found = format!("the header {:?}", String::from_utf8_lossy(literal).trim());
        Error::malformed(place.clone(), found, "{'descr': .., 'fortran_order': .., 'shape': ..}")
    })?;
    let is_text = described.descr.as_str().is_some_and(|descr| descr.starts_with("<U"));
    if is_text && described.shape.iter().all(|&size| size == 1) {
        let whole = archive.read(number, limits.header_bytes)?;
        let skip = header.len().min(whole.len());
        let text = text(whole.split_at(skip).1).ok_or_else(|| {
            Error::malformed(place, "text that is not Unicode", "UTF-32, little-endian")
        })?;
        return Ok((Value::Text(text), header));
    }
    let Some(element) = element(&described.descr) else {
        let kind = format!("a NumPy array of type {}", described.descr);
        let tensor = Tensor::unread(name.to_owned(), described.shape, kind)?;
        return Ok((Value::Tensor(tensor), header));
    };
    let data = match archive.data(number)? {
        Data::Stored(Storage::File { file, range, .. }) => Data::Stored(Storage::File {
            file,
            range: range.start + skip..range.end,
            crc32: archive.states_sums().then(|| checksum_after(entry, &header)),
        }),
        Data::Deflated { archive, entry, .. } => Data::Deflated { archive, entry, skip },
        stored => stored,
    };
    let held = data.length();
    let make = if described.fortran_order { Tensor::fortran } else { Tensor::dense };
    let tensor = make(name.to_owned(), element, described.shape, data)?;
    if tensor.bytes() != held {
        let found = format!("{held} bytes after the header");
        let expected = format!("{} for shape {:?}", tensor.bytes(), tensor.shape());
        return Err(Error::malformed(place, found, expected));
    }
    Ok((Value::Tensor(tensor), header))
}

/// A NumPy text: four bytes per character, zeros at the end.
fn text(bytes: &[u8]) -> Option<String> {
    let (characters, rest) = bytes.as_chunks::<4>();
    let text: Option<String> =
        characters.iter().map(|&bytes| char::from_u32(u32::from_le_bytes(bytes))).collect();
    text.filter(|_| rest.is_empty()).map(|text| text.trim_end_matches('\0').to_owned())
}

/// The checksum of the bytes behind `head` in an entry. CRC-32 is linear: the checksum of both
/// parts is the head's checksum, shifted over the rest, xor the rest's checksum.
fn checksum_after(entry: &Entry, head: &[u8]) -> u32 {
    let mut shifted = crc32fast::Hasher::new();
    shifted.update(head);
    let rest = entry.length.saturating_sub(head.len() as u64);
    shifted.combine(&crc32fast::Hasher::new_with_initial_len(0, rest));
    shifted.finalize() ^ entry.crc32
}

/// The supported number type.
fn element(descr: &serde_json::Value) -> Option<Element> {
    let plain = descr.as_str().map(|descr| descr.trim_start_matches(['<', '|', '=']));
    plain.and_then(Element::from_numpy)
}

/// The header of an array.
#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    /// Its type: a text, or the list of a structured one.
    descr: serde_json::Value,
    fortran_order: bool,
    shape: Vec<u64>,
}

/// Reads the Python dictionary of a header, which is JSON except for quotes, brackets, capitals,
/// the `L` of Python 2 and trailing commas.
fn read_header(literal: &[u8]) -> Option<Header> {
    let words: Vec<&str> = std::str::from_utf8(literal).ok()?.split_whitespace().collect();
    let mut json = words.join(" ");
    for (python, plain) in [
        ("'", "\""),
        ("(", "["),
        (")", "]"),
        ("True", "true"),
        ("False", "false"),
        ("L,", ","),
        ("L]", "]"),
        (",]", "]"),
        (", ]", "]"),
        (",}", "}"),
        (", }", "}"),
    ] {
        json = json.replace(python, plain);
    }
    serde_json::from_str(&json).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Option<(String, bool, Vec<u64>)> {
        let header = read_header(text.as_bytes())?;
        let descr = header.descr.as_str().map_or_else(|| header.descr.to_string(), str::to_owned);
        Some((descr, header.fortran_order, header.shape))
    }

    #[test]
    fn headers_are_python_literals() {
        let found = read("{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }  \n");
        assert_eq!(found, Some(("<f4".to_owned(), false, vec![3, 4])));
        let found = read("{\"shape\":(7L,),\"fortran_order\":True,\"descr\":'|b1'}");
        assert_eq!(found, Some(("|b1".to_owned(), true, vec![7])));
        let found = read("{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': ()}");
        assert_eq!(found, Some((r#"[["a","<f4"]]"#.to_owned(), false, vec![])));
        for broken in [
            "",
            "{}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4)} x",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), 'shape': ()}",
            "{'descr': '<f4', 'fortran_order': 0, 'shape': (3, 4)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (-3, 4)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (4 5 6)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999,)}",
            "{'descr': [[[, 'fortran_order': False",
            "{'descr': '<f4",
        ] {
            assert_eq!(read(broken), None, "{broken}");
        }
    }
}
