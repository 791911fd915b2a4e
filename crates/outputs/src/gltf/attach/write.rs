//! Writes an edited asset in its own kind.

use std::path::PathBuf;

use super::tree::Tree;
use crate::base::bytes::{ByteSink, Output};
use crate::base::error::Result;
use crate::gltf::asset::{Asset, Fields, Piece, uri, write_glb};

/// Alignment of containers in the chunk BIN, the same as that of their chunks.
pub(super) const ALIGNMENT: u64 = 64;

/// The unchanged chunk BIN; empty if there is none.
pub(super) fn chunk_pieces(asset: &Asset) -> Result<Vec<Piece>> {
    let bin = asset.chunks().and_then(|chunks| chunks.bin.clone());
    bin.map(|bin| Ok(Piece::File(asset.file().part(bin)?))).into_iter().collect()
}

/// Writes the document. In a GLB `bin` is the new chunk BIN, and other chunks stay.
pub(super) fn write_edited(
    asset: &Asset,
    document: &Tree,
    bin: &[Piece],
    output: &mut Output,
) -> Result<()> {
    let text = document.text()?;
    match asset.chunks() {
        Some(chunks) => {
            let others = asset.file().part(chunks.others.clone())?;
            write_glb(&text, bin, Some(&others), output)
        }
        None => output.append(text.as_bytes()),
    }
}

/// Paths of the files that the document names by relative URIs.
///
/// # Errors
/// Documents that break their rules.
pub fn companion_paths(asset: &Asset) -> Result<Vec<PathBuf>> {
    let names = companions(asset)?;
    Ok(names.iter().filter_map(|name| uri::path(name, asset.path())).collect())
}

/// Files that the document names by relative URIs, which do not move with the asset to another
/// folder.
///
/// # Errors
/// Documents that break their rules.
pub fn companions(asset: &Asset) -> Result<Vec<String>> {
    let root = asset.document()?.members()?;
    let mut objects = Fields::read(asset, &root)?.objects;
    for list in ["buffers", "images"] {
        objects.extend(asset.list(&root, list)?);
    }
    let mut names = Vec::new();
    for object in objects {
        if let Some(found) = object.get("uri")? {
            let name: String = found.parse("a URI")?;
            names.extend((!uri::is_data(&name) && !name.contains("://")).then_some(name));
        }
    }
    Ok(names)
}
