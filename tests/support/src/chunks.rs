//! Containers as lists of chunks, so that tests can write containers that the writer would not. The
//! coding of a chunk's bytes has no place here.

use mipvog::container::layout::{
    ALIGNMENT, ANISOTROPY, BENT_RULE, DIRECTIONAL, ENTRY_BYTES, Entry, HEADER_BYTES, Header,
    INHERITED_BLOCKS, META, NESTED_BOXES,
};

use super::open_bytes;

/// Keys of metadata that ask for a feature.
const FEATURES: [(&str, u64); 5] = [
    ("blocks_filled", INHERITED_BLOCKS),
    ("bends", BENT_RULE),
    ("directional", DIRECTIONAL),
    ("anisotropy", ANISOTROPY),
    ("shells", NESTED_BOXES),
];

/// A chunk without its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Chunk {
    pub kind: [u8; 4],
    pub level: Option<u32>,
    pub bytes: Vec<u8>,
}

/// The chunks of a sound container.
pub fn chunks(container: &[u8]) -> Vec<Chunk> {
    let opened = open_bytes(container).expect("a container");
    let chunk = |entry: &Entry| {
        let start = entry.offset as usize;
        let bytes = container[start..start + entry.length as usize].to_vec();
        Chunk { kind: entry.kind, level: entry.level, bytes }
    };
    opened.entries().iter().map(chunk).collect()
}

/// A directory that fits the chunks; prefixes are those of containers whose levels all hold
/// density.
pub fn entries(chunks: &[Chunk]) -> Vec<Entry> {
    let mut offset = HEADER_BYTES + ENTRY_BYTES * chunks.len() as u64;
    let mut entries = Vec::new();
    for Chunk { kind, level, bytes } in chunks {
        let length = bytes.len() as u64;
        let checksum = crc32fast::hash(bytes);
        let entry = Entry { kind: *kind, level: *level, offset, length, prefix: 0, checksum };
        offset = entry.padded_end();
        entries.push(entry);
    }
    let ends: Vec<_> = entries.iter().map(|entry| (entry.level, entry.padded_end())).collect();
    for entry in entries.iter_mut().filter(|entry| entry.level.is_some()) {
        let own = ends.iter().filter(|(level, _)| *level == entry.level);
        entry.prefix = own.map(|(_, end)| *end).max().expect("its own end");
    }
    entries
}

/// A file of these entries, each with its chunk where it says, padding zero.
pub fn file(entries: &[Entry], chunks: &[Chunk]) -> Vec<u8> {
    let end = entries.iter().map(Entry::padded_end).max().unwrap_or(HEADER_BYTES);
    let metadata = chunks.iter().find(|chunk| chunk.kind == META).map(|chunk| &*chunk.bytes);
    let metadata = String::from_utf8_lossy(metadata.unwrap_or_default());
    let features = FEATURES.iter().filter(|(key, _)| metadata.contains(&format!("\"{key}\":")));
    let features = features.map(|(_, bit)| bit).sum();
    let mut bytes = Header::with_directory(features, end, entries).expect("few entries");
    bytes.resize(end.next_multiple_of(ALIGNMENT) as usize, 0);
    for (entry, chunk) in entries.iter().zip(chunks) {
        let start = entry.offset as usize;
        bytes[start..start + chunk.bytes.len()].copy_from_slice(&chunk.bytes);
    }
    bytes
}

/// The container of these chunks.
pub fn container(chunks: &[Chunk]) -> Vec<u8> {
    file(&entries(chunks), chunks)
}

/// The container with one chunk's bytes changed, everything around them sound.
pub fn with_chunk(
    chunks: &[Chunk],
    kind: &[u8; 4],
    level: Option<u32>,
    change: impl FnOnce(&mut Vec<u8>),
) -> Vec<u8> {
    let mut chunks = chunks.to_vec();
    let own = chunks.iter_mut().find(|chunk| chunk.kind == *kind && chunk.level == level);
    change(&mut own.expect("such a chunk").bytes);
    container(&chunks)
}
