//! The pictures of a folder.

use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use crate::base::bytes::{ByteReader, SourceFile};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::Limits;
use crate::picture::{self, Rgba};
use crate::source::SideFile;

/// The first bytes of a PNG.
const SIGNATURE: [u8; 8] = [0x89, b'P', b'N', b'G', 0x0d, 0x0a, 0x1a, 0x0a];
/// The colour type of red, green and blue.
pub const RGB: u8 = 2;
/// The colour type of red, green, blue and alpha.
pub const RGBA: u8 = 6;

/// A folder whose pictures are checked before they are read.
#[derive(Debug, Clone)]
pub struct Folder(PathBuf);

impl Folder {
    /// The folder of a file.
    pub fn of(file: &Path) -> Self {
        Self(file.parent().unwrap_or(Path::new("")).to_owned())
    }

    /// Checks a picture's size and colour type, and that it is complete. Its digest covers its
    /// checksums.
    ///
    /// # Errors
    /// `Io` if it is missing, `Malformed` for another size, `Unsupported` for another colour type,
    /// `Truncated` if it ends early.
    pub fn look(
        &self,
        role: &'static str,
        name: String,
        size: [usize; 2],
        types: &[u8],
    ) -> Result<SideFile> {
        let path = self.0.join(name);
        let digest = look_at(&path, size, types).map_err(|error| error.in_file(&path))?;
        Ok(SideFile { role, path, digest })
    }

    /// Reads a picture with a checked size.
    ///
    /// # Errors
    /// Those of the picture, and `Malformed` for another size.
    pub fn read(&self, name: &str, size: [usize; 2], limits: &Limits) -> Result<Rgba> {
        let path = self.0.join(name);
        let read = picture::read(&path, limits.memory)?;
        match [read.width, read.height] == size {
            true => Ok(read),
            false => Err(other_size([read.width, read.height], size).in_file(&path)),
        }
    }
}

fn other_size([width, height]: [usize; 2], [w, h]: [usize; 2]) -> Error {
    let found = format!("{width} x {height} pixels");
    Error::malformed(Place::File, found, format!("{w} x {h}, as {} says", "scene_params.json"))
}

/// Checks a PNG's header, and follows its chunks to the last one.
fn look_at(path: &Path, size: [usize; 2], types: &[u8]) -> Result<[u8; 32]> {
    let file = SourceFile::open(path)?;
    let header = file.read(0, 33, 33).map_err(|error| match error.kind() {
        ErrorKind::Truncated { .. } => Error::wrong_kind("too short a file", "a PNG"),
        _ => error,
    })?;
    let mut reader = ByteReader::new(&header, 0);
    if reader.take(8)? != SIGNATURE {
        return Err(Error::wrong_kind("a file of another kind", "a PNG"));
    }
    // Length and name of the first chunk.
    reader.take(8)?;
    let side = |bytes: &[u8]| bytes.iter().fold(0usize, |sum, &byte| sum << 8 | usize::from(byte));
    let found = [side(reader.take(4)?), side(reader.take(4)?)];
    if found != size {
        return Err(other_size(found, size));
    }
    let (depth, kind) = (reader.u8()?, reader.u8()?);
    if depth != 8 || !types.contains(&kind) {
        let found = format!("{depth} bits of colour type {kind}");
        return Err(Error::unsupported(Place::File, found, "8 bits of red, green, blue and alpha"));
    }
    let (mut digest, mut at) = (Sha256::new(), 8);
    loop {
        let head = file.read(at, 8, 8)?;
        let (length, name) = head.split_at(4);
        let length = side(length) as u64;
        let end = at + 12 + length;
        if end > file.length() {
            let kind = ErrorKind::Truncated { wanted: 12 + length, left: file.length() - at };
            return Err(Error::new(kind, Place::Offset(at)));
        }
        digest.update(&head);
        digest.update(file.read(end - 4, 4, 4)?);
        if name == b"IEND" {
            return Ok(digest.finalize().into());
        }
        at = end;
    }
}
