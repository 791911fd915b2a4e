//! Writes a container from its parts, coarse to fine.

use super::json::to_canonical;
use super::layout::{
    ALIGNMENT, ATLASES, ChunkKind, ENTRY_BYTES, Entry, HEADER_BYTES, Header, MASK, META,
    PROVENANCE, TABLE, THUMBNAIL, VMLP, content_checksum,
};
use super::metadata_rules::check_metadata;
use super::open::Container;
use super::rules::{level_prefix, required_features};
use super::runs::EncodedAtlas;
use super::thumbnail::thumbnail_size;
use super::{mask, network, table};
use crate::base::bytes::{ByteSink, SourceFile};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::Limits;
use crate::model::baked::{GROUPS, Group, Metadata, Table};
use crate::model::scene::{FreeSpace, Lookup};
use crate::model::view_mlp::ViewMlp;

/// An encoded level.
#[derive(Debug)]
pub struct EncodedLevel {
    /// The indirection table.
    pub table: Table,
    /// Atlases by [`Group`].
    pub atlases: [Option<EncodedAtlas>; GROUPS],
}

/// An ancillary chunk that this version does not know.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OtherChunk {
    /// Type of the chunk: four letters.
    pub kind: ChunkKind,
    /// Level that the chunk belongs to, if any; 0 is the finest.
    pub level: Option<u32>,
    /// Content of the chunk.
    pub bytes: Vec<u8>,
}

/// All parts of a container except the levels.
#[derive(Debug)]
pub struct Head<'a> {
    /// Everything except bulk data.
    pub metadata: &'a Metadata,
    /// View-dependent colour.
    pub view_mlp: Option<&'a ViewMlp>,
    /// The free-space mask, if visible.
    pub free_space: Option<&'a FreeSpace>,
    /// Origin of the content.
    pub provenance: &'a serde_json::Value,
    /// Unknown chunks of the original container, unchanged.
    pub others: &'a [OtherChunk],
    /// Compression level of zstd.
    pub zstd_level: i32,
    /// Limits for the metadata.
    pub limits: &'a Limits,
}

struct Chunk<'a> {
    kind: ChunkKind,
    level: Option<u32>,
    content: Content<'a>,
}

enum Content<'a> {
    Bytes(Vec<u8>),
    Atlas(&'a EncodedAtlas),
    /// An unchanged chunk of this file.
    Copied(&'a SourceFile, &'a Entry),
}

/// Number of bytes copied at once.
const COPIED: u64 = 1 << 20;

impl Content<'_> {
    fn length_and_checksum(&self) -> Result<(u64, u32)> {
        match self {
            Self::Bytes(bytes) => Ok((bytes.len() as u64, crc32fast::hash(bytes))),
            Self::Atlas(atlas) => atlas.length_and_checksum(),
            Self::Copied(_, entry) => Ok((entry.length, entry.checksum)),
        }
    }

    fn for_each_piece(&self, mut take: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        match self {
            Self::Bytes(bytes) => take(bytes),
            Self::Atlas(atlas) => atlas.for_each_piece(take),
            Self::Copied(file, entry) => {
                let mut done = 0;
                while done < entry.length {
                    let count = (entry.length - done).min(COPIED);
                    take(&file.read(entry.offset + done, count, COPIED)?)?;
                    done += count;
                }
                Ok(())
            }
        }
    }
}

/// Writes a container to `output` and returns its directory. `levels` are the levels, finest first,
/// then the shells.
pub fn write(
    head: &Head,
    levels: &[EncodedLevel],
    output: &mut dyn ByteSink,
) -> Result<Vec<Entry>> {
    check(head)?;
    write_chunks(&chunks(head, levels)?, head.metadata, output)
}

/// Rewrites a container with this thumbnail instead of its own. All other chunks are copied.
///
/// # Errors
/// Errors of reading and writing, and a thumbnail that [`thumbnail_size`] refuses.
pub fn with_thumbnail(
    container: &Container,
    png: Vec<u8>,
    output: &mut dyn ByteSink,
) -> Result<Vec<Entry>> {
    thumbnail_size(&png, &Place::Chunk { kind: THUMBNAIL, level: None })?;
    let others = container.entries().iter().filter(|entry| entry.kind != THUMBNAIL);
    let mut chunks: Vec<Chunk> = others
        .map(|entry| Chunk {
            kind: entry.kind,
            level: entry.level,
            content: Content::Copied(container.file(), entry),
        })
        .collect();
    // Before the levels, so that readers of the picture need only the start of the file.
    let at = chunks.iter().position(|chunk| chunk.level.is_some()).unwrap_or(chunks.len());
    chunks.insert(at, Chunk { kind: THUMBNAIL, level: None, content: Content::Bytes(png) });
    write_chunks(&chunks, container.metadata(), output)
}

fn write_chunks(
    chunks: &[Chunk],
    metadata: &Metadata,
    output: &mut dyn ByteSink,
) -> Result<Vec<Entry>> {
    let (entries, length) = directory(chunks, metadata)?;
    let features = required_features(metadata);
    output.append(&Header::with_directory(features, length, &entries)?)?;
    for chunk in chunks {
        chunk.content.for_each_piece(|piece| output.append(piece))?;
        output.pad(ALIGNMENT)?;
    }
    Ok(entries)
}

/// The [`content_checksum`] of the container that [`write()`] would write.
pub fn content_checksum_of(head: &Head, levels: &[EncodedLevel]) -> Result<u32> {
    let (entries, _) = directory(&chunks(head, levels)?, head.metadata)?;
    Ok(content_checksum(&entries))
}

/// The directory entries in the order of the chunks, and the length of the file.
fn directory(chunks: &[Chunk], metadata: &Metadata) -> Result<(Vec<Entry>, u64)> {
    let mut entries = Vec::with_capacity(chunks.len());
    let mut offset = HEADER_BYTES + ENTRY_BYTES * chunks.len() as u64;
    for chunk in chunks {
        let (length, checksum) = chunk.content.length_and_checksum()?;
        let (kind, level) = (chunk.kind, chunk.level);
        let entry = Entry { kind, level, offset, length, prefix: 0, checksum };
        offset = entry.padded_end();
        entries.push(entry);
    }
    let prefix = |level| level_prefix(&entries, metadata, level, offset);
    let prefixes: Vec<_> = entries.iter().map(|entry| entry.level.map_or(0, prefix)).collect();
    entries.iter_mut().zip(prefixes).for_each(|(entry, prefix)| entry.prefix = prefix);
    Ok((entries, offset))
}

/// Refuses everything that a reader would refuse: values of inputs and options meet here for the
/// first time.
fn check(head: &Head) -> Result<()> {
    check_metadata(head.metadata, head.limits, &Place::File)?;
    let layers = head.view_mlp.iter().flat_map(|network| &network.layers);
    let mut weights = layers.flat_map(|layer| layer.weights.iter().chain(&layer.bias));
    if weights.any(|weight| !weight.is_finite()) {
        let place = Place::Key("view network".to_owned());
        return Err(Error::malformed(place, "a weight that is not finite", "finite weights"));
    }
    let mask_is_finite = head.free_space.is_none_or(|mask| {
        let map = mask.scale.iter().chain(&mask.shift).all(|value| value.is_finite());
        map && match &mask.lookup {
            Lookup::Nearest(_) => true,
            Lookup::Trilinear { values, threshold } => {
                threshold.is_finite() && values.iter().all(|value| value.is_finite())
            }
        }
    });
    if mask_is_finite {
        return Ok(());
    }
    let place = Place::Key("free-space mask".to_owned());
    Err(Error::malformed(place, "a number that is not finite", "finite numbers"))
}

fn chunks<'a>(head: &Head, levels: &'a [EncodedLevel]) -> Result<Vec<Chunk<'a>>> {
    let global = |kind, bytes| Chunk { kind, level: None, content: Content::Bytes(bytes) };
    let mut chunks = vec![global(META, to_canonical(head.metadata)?.into_bytes())];
    if let Some(view_mlp) = head.view_mlp {
        chunks.push(global(VMLP, network::to_bytes(view_mlp)));
    }
    if let Some(free_space) = head.free_space {
        chunks.push(global(MASK, mask::to_bytes(free_space, head.zstd_level)?));
    }
    chunks.push(global(PROVENANCE, to_canonical(head.provenance)?.into_bytes()));
    let others = |level: Option<u32>| {
        let own = head.others.iter().filter(move |chunk| chunk.level == level);
        own.map(|OtherChunk { kind, level, bytes }| Chunk {
            kind: *kind,
            level: *level,
            content: Content::Bytes(bytes.clone()),
        })
    };
    chunks.extend(others(None));
    for part in head.metadata.parts_in_file() {
        let overflow = || Error::new(ErrorKind::Overflow { what: "level" }, Place::File);
        let level = levels.get(part).ok_or_else(overflow)?;
        let number = u32::try_from(part).map_err(|_| overflow())?;
        let level_chunk = |kind, content| Chunk { kind, level: Some(number), content };
        let in_runs = !head.metadata.shells.is_empty();
        let bytes = table::to_bytes(&level.table, in_runs, head.zstd_level)?;
        chunks.push(level_chunk(TABLE, Content::Bytes(bytes)));
        for ((_, kind), atlas) in Group::ALL.iter().zip(ATLASES).zip(&level.atlases) {
            if let Some(atlas) = atlas {
                chunks.push(level_chunk(kind, Content::Atlas(atlas)));
            }
        }
        chunks.extend(others(Some(number)));
    }
    Ok(chunks)
}
