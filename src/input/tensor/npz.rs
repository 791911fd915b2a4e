//! NumPy archives: a zip file of `.npy` arrays, as `numpy.savez` and `savez_compressed` write.
//!
//! ```text
//! 93 "NUMPY" major minor, header length (2 bytes in version 1, else 4),
//! {'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }, then the numbers
//! ```

use std::sync::Arc;

use super::array::Tensor;
use super::digest::Digest;
use super::file::{FileKind, TensorFile};
use super::value::Value;
use super::zip::{Archive, Data, Entry};

use crate::base::bytes::{ByteReader, SourceFile, Storage};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, Limits};
use crate::model::grid::Element;

/// Signature, version and the longest header length.
const PREFIX: u64 = 12;

/// What the names of arrays end with inside the archive.
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
    digest.directory(archive.entries());
    let mut root = Vec::with_capacity(archive.entries().len());
    for (number, entry) in archive.entries().iter().enumerate() {
        let Some(name) = entry.name.strip_suffix(EXTENSION) else {
            return Err(Error::unsupported(
                Place::Entry(entry.name.clone()),
                "a zip entry that is no array",
                "a PyTorch checkpoint (with data.pkl) or a NumPy archive (.npy entries only)",
            ));
        };
        let (value, header) = read_array(archive, number, entry, name, limits)?;
        digest.bytes(&header);
        root.push((name.to_owned(), value));
    }
    Ok(TensorFile {
        kind: FileKind::Npz,
        root: Value::Dict(root),
        digest: digest.finish(),
        file: Arc::clone(file),
    })
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
    limits::check("bytes of a header", length, limits.header_bytes, &place)?;
    let skip = before + length;
    let header = archive.head(number, skip)?;
    let mut reader = ByteReader::new(&header, entry.offset);
    let whole = reader.take(usize::try_from(skip).unwrap_or(usize::MAX))?;
    let literal = whole.get(usize::try_from(before).unwrap_or(0)..).unwrap_or_default();
    let described = Literal { bytes: literal, at: 0 }.read().ok_or_else(|| {
        let found = format!("the header {:?}", String::from_utf8_lossy(literal).trim());
        Error::malformed(place.clone(), found, "{'descr': .., 'fortran_order': .., 'shape': ..}")
    })?;
    if described.shape.iter().all(|&size| size == 1) && described.descr.starts_with("<U") {
        let whole = archive.read(number, limits.header_bytes)?;
        let skip = header.len().min(whole.len());
        let text = text(whole.split_at(skip).1).ok_or_else(|| {
            Error::malformed(place, "text that is not Unicode", "UTF-32, little-endian")
        })?;
        return Ok((Value::Text(text), header));
    }
    let element = element(&described.descr, name)?;
    let data = match archive.data(number)? {
        Data::Stored(Storage::File { file, range, .. }) => Data::Stored(Storage::File {
            file,
            range: range.start + skip..range.end,
            crc32: Some(checksum_after(entry, &header)),
        }),
        Data::Deflated { archive, entry, .. } => Data::Deflated { archive, entry, skip },
        stored => stored,
    };
    let held = data.length();
    let make = if described.fortran { Tensor::fortran } else { Tensor::dense };
    let tensor = make(name.to_owned(), element, described.shape, data)?;
    if tensor.bytes() != held {
        let found = format!("{held} bytes after the header");
        let expected = format!("{} for shape {:?}", tensor.bytes(), tensor.shape());
        return Err(Error::malformed(place, found, expected));
    }
    Ok((Value::Tensor(tensor), header))
}

/// A NumPy text: four bytes a character, zeros at the end.
fn text(bytes: &[u8]) -> Option<String> {
    let (characters, rest) = bytes.as_chunks::<4>();
    let text: Option<String> =
        characters.iter().map(|&bytes| char::from_u32(u32::from_le_bytes(bytes))).collect();
    text.filter(|_| rest.is_empty()).map(|text| text.trim_end_matches('\0').to_owned())
}

/// The checksum of what follows `head` in an entry. CRC-32 is linear: the sum over both parts is
/// the head's sum, shifted over the rest, xor the rest's sum.
fn checksum_after(entry: &Entry, head: &[u8]) -> u32 {
    let mut shifted = crc32fast::Hasher::new();
    shifted.update(head);
    let rest = entry.length.saturating_sub(head.len() as u64);
    shifted.combine(&crc32fast::Hasher::new_with_initial_len(0, rest));
    shifted.finalize() ^ entry.crc32
}

fn element(descr: &str, name: &str) -> Result<Element> {
    let unsupported = || {
        Error::unsupported(
            Place::Tensor(name.into()),
            format!("elements of type {descr}"),
            "little-endian f2, f4, f8, or b1, u1, i1, i2, i4, i8",
        )
    };
    Element::from_numpy(descr.trim_start_matches(['<', '|', '='])).ok_or_else(unsupported)
}

/// What an array's header says.
#[derive(Debug, PartialEq, Eq)]
struct Described {
    /// Its type; of a structured one, the whole literal.
    descr: String,
    fortran: bool,
    shape: Vec<u64>,
}

/// Reads the Python dictionary of a header. Anything else than its three keys is refused.
struct Literal<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Literal<'_> {
    fn read(mut self) -> Option<Described> {
        let (mut descr, mut fortran, mut shape) = (None, None, None);
        self.expect(b'{')?;
        while !self.accept(b'}') {
            let key = self.text()?;
            self.expect(b':')?;
            match key.as_str() {
                "descr" if descr.is_none() => descr = Some(self.descr()?),
                "fortran_order" if fortran.is_none() => fortran = Some(self.boolean()?),
                "shape" if shape.is_none() => shape = Some(self.shape()?),
                _ => return None,
            }
            if !self.accept(b',') {
                self.expect(b'}')?;
                break;
            }
        }
        self.skip_space();
        let ended = self.at == self.bytes.len();
        let described = Described { descr: descr?, fortran: fortran?, shape: shape? };
        ended.then_some(described)
    }

    fn skip_space(&mut self) {
        while self.bytes.get(self.at).is_some_and(u8::is_ascii_whitespace) {
            self.at += 1;
        }
    }

    fn accept(&mut self, byte: u8) -> bool {
        self.skip_space();
        let found = self.bytes.get(self.at) == Some(&byte);
        self.at += usize::from(found);
        found
    }

    fn expect(&mut self, byte: u8) -> Option<()> {
        self.accept(byte).then_some(())
    }

    fn text(&mut self) -> Option<String> {
        self.skip_space();
        let quote = *self.bytes.get(self.at).filter(|byte| b"'\"".contains(byte))?;
        let rest = self.bytes.get(self.at + 1..)?;
        let length = rest.iter().position(|&byte| byte == quote)?;
        self.at += length + 2;
        let text = std::str::from_utf8(rest.get(..length)?).ok()?;
        (!text.contains('\\')).then(|| text.to_owned())
    }

    /// A type's text; the literal of a structured type, which is a list, as it stands.
    fn descr(&mut self) -> Option<String> {
        self.skip_space();
        let rest = self.bytes.get(self.at..)?;
        if rest.first() != Some(&b'[') {
            return self.text();
        }
        let mut depth = 0usize;
        for (length, byte) in rest.iter().enumerate() {
            match byte {
                b'[' => depth += 1,
                b']' => depth -= 1,
                _ => {}
            }
            if depth == 0 {
                self.at += length + 1;
                return Some(String::from_utf8_lossy(rest.get(..=length)?).into_owned());
            }
        }
        None
    }

    fn boolean(&mut self) -> Option<bool> {
        self.skip_space();
        let rest = self.bytes.get(self.at..)?;
        let value = rest.starts_with(b"True");
        if !value && !rest.starts_with(b"False") {
            return None;
        }
        self.at += if value { 4 } else { 5 };
        Some(value)
    }

    fn shape(&mut self) -> Option<Vec<u64>> {
        self.expect(b'(')?;
        let mut sizes = Vec::new();
        while !self.accept(b')') {
            self.skip_space();
            let rest = self.bytes.get(self.at..)?;
            let digits = rest.iter().take_while(|byte| byte.is_ascii_digit()).count();
            sizes.push(std::str::from_utf8(rest.get(..digits)?).ok()?.parse().ok()?);
            self.at += digits;
            // Python 2 wrote long integers.
            if self.bytes.get(self.at) == Some(&b'L') {
                self.at += 1;
            }
            if !self.accept(b',') {
                self.expect(b')')?;
                break;
            }
        }
        Some(sizes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Option<Described> {
        Literal { bytes: text.as_bytes(), at: 0 }.read()
    }

    #[test]
    fn headers_are_python_literals() {
        let found = read("{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }  \n");
        let shape = vec![3, 4];
        assert_eq!(found, Some(Described { descr: "<f4".into(), fortran: false, shape }));
        let found = read("{\"shape\":(7L,),\"fortran_order\":True,\"descr\":'|b1'}");
        assert_eq!(found, Some(Described { descr: "|b1".into(), fortran: true, shape: vec![7] }));
        let found = read("{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': ()}");
        assert_eq!(found.map(|d| d.descr), Some("[('a', '<f4')]".into()));
        for broken in [
            "",
            "{}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4)} x",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), 'shape': ()}",
            "{'descr': '<f4', 'fortran_order': 0, 'shape': (3, 4)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (-3, 4)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999,)}",
            "{'descr': [[[, 'fortran_order': False",
            "{'descr': '<f4",
        ] {
            assert_eq!(read(broken), None, "{broken}");
        }
    }
}
