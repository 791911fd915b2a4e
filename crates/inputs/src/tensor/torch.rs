//! PyTorch checkpoints: a zip file with a pickle of the structure and an entry for each storage.
//!
//! ```text
//! ROOT/data.pkl        the pickle
//! ROOT/byteorder       "little"; older versions leave it out
//! ROOT/data/KEY        the bytes of storage KEY
//! ```

use std::sync::Arc;

use super::digest::{Digest, add_directory};
use super::file::{FileKind, TensorFile};
use super::pickle::{self, Storages};
use super::zip::{Archive, Data};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::model::grid::Element;

/// The pickle's name in the archive's folder.
const PICKLE: &str = "data.pkl";

/// The archive's folder with its slash, if it holds a checkpoint.
pub(super) fn find_pickle(archive: &Archive) -> Result<Option<String>> {
    let roots: Vec<&str> = archive
        .entries()
        .iter()
        .filter_map(|entry| entry.name.strip_suffix(PICKLE))
        .filter(|root| root.is_empty() || root.ends_with('/'))
        .collect();
    match roots.as_slice() {
        [] => Ok(None),
        [root] => Ok(Some((*root).to_owned())),
        _ => {
            let found = format!("{} entries {PICKLE}", roots.len());
            Err(Error::malformed(Place::File, found, "one"))
        }
    }
}

/// Opens a checkpoint: reads its pickle.
pub(super) fn open(
    file: &Arc<SourceFile>,
    archive: &Arc<Archive>,
    root: &str,
    limits: &Limits,
) -> Result<TensorFile> {
    check_byte_order(archive, root)?;
    let name = format!("{root}{PICKLE}");
    let number = archive.find(&name).unwrap_or(usize::MAX);
    let bytes = archive.read(number, limits.header_bytes)?;
    // Offsets in errors count from the file's start, in a deflated pickle from its own.
    let base = archive.entries().get(number).filter(|entry| !entry.is_deflated);
    let base = base.map_or(0, |entry| entry.offset);
    let storages = Entries { archive, folder: format!("{root}data/") };
    let root = pickle::read(&bytes, base, &storages, limits)?;
    // The file would have no usable content.
    if let Some(error) = root.unread_error(Place::Offset(base)) {
        return Err(error);
    }
    let mut digest = Digest::new("torch");
    add_directory(&mut digest, archive.entries());
    digest.bytes(&bytes);
    Ok(TensorFile {
        kind: FileKind::Torch,
        root,
        has_checksums: archive.states_sums(),
        digest: digest.finish(),
        file: Arc::clone(file),
    })
}

fn check_byte_order(archive: &Archive, root: &str) -> Result<()> {
    let name = format!("{root}byteorder");
    let Some(number) = archive.find(&name) else { return Ok(()) };
    let order = archive.read(number, 16)?;
    if order == b"little" {
        return Ok(());
    }
    let found = format!("byte order {:?}", String::from_utf8_lossy(&order));
    Err(Error::unsupported(Place::Entry(name), found, "\"little\" (save it again on x86 or Arm)"))
}

/// The archive's storages.
struct Entries<'a> {
    archive: &'a Arc<Archive>,
    folder: String,
}

impl Storages for Entries<'_> {
    fn find(&self, key: &str, element: Option<Element>, count: u64) -> Result<Data> {
        let name = format!("{}{key}", self.folder);
        let Some(number) = self.archive.find(&name) else {
            let found = "no such entry, though the pickle names it";
            return Err(Error::malformed(Place::Entry(name), found, "every storage"));
        };
        let data = self.archive.data(number)?;
        // Untyped storages count bytes.
        let size = element.map_or(1, Element::size) as u64;
        let stated = count.checked_mul(size);
        if stated.is_none_or(|stated| stated > data.length()) {
            let found = format!("{} bytes", data.length());
            let expected = format!("{count} elements of {size} bytes");
            return Err(Error::malformed(Place::Entry(name), found, expected));
        }
        Ok(data)
    }
}
