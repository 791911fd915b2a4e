//! Rules of a container's header and chunks: presence, order and places. See `formats/mipvog.md`,
//! sections 2 and 3. [`super::metadata_rules`] has the rules of the metadata.

use super::layout::{
    ALIGNMENT, ANISOTROPY, ATLASES, BENT_RULE, CHUNKS, ChunkKind, DIRECTIONAL, ENTRY_BYTES, Entry,
    HEADER_BYTES, Header, INHERITED_BLOCKS, KNOWN_FEATURE_BITS, KNOWN_FEATURES, LINEAR_VALUES,
    MASK, META, NESTED_BOXES, PROVENANCE, TABLE, THUMBNAIL, VERSION, VMLP,
};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, ErrorKind, NEWER, Place, Result};
use crate::base::finding::{Code, Finding, Report, checked};
use crate::model::baked::{Group, Metadata, ViewMetadata};
use crate::model::scene::{ColorDomain, DensityFunction};

/// True if this build knows the chunk type.
pub fn is_known(kind: ChunkKind) -> bool {
    CHUNKS.contains(&kind) || ATLASES.contains(&kind)
}

/// Checks the features and the place of the directory.
pub fn header(header: &Header, report: &mut Report) -> Result<()> {
    let unknown = header.features & !KNOWN_FEATURES;
    if unknown != 0 {
        let found = format!("required features {unknown:#x}");
        let error = Error::unsupported(Place::Offset(16), found, KNOWN_FEATURE_BITS).advise(NEWER);
        report(Finding { code: Code::Feature, error })?;
    }
    if header.directory_offset != HEADER_BYTES {
        let found = format!("a directory at byte {}", header.directory_offset);
        let error = Error::malformed(Place::Offset(32), found, "one right after the header");
        report(Finding { code: Code::Directory, error })?;
    }
    Ok(())
}

/// Checks that the file is as long as its header states.
pub fn length(header: &Header, file_length: u64, report: &mut Report) -> Result<()> {
    if header.file_length > file_length {
        let kind = ErrorKind::Truncated { wanted: header.file_length, left: file_length };
        report(Finding { code: Code::Length, error: Error::new(kind, Place::File) })?;
    } else if header.file_length < file_length {
        let found = format!("{} bytes after the end", file_length - header.file_length);
        let place = Place::Offset(header.file_length);
        let error = Error::malformed(place, found, "nothing there");
        report(Finding { code: Code::Length, error })?;
    }
    Ok(())
}

/// Checks that chunks are contiguous and unique, and that critical chunks are known.
pub fn chunks(entries: &[Entry], file_length: u64, report: &mut Report) -> Result<()> {
    let mut next = HEADER_BYTES + ENTRY_BYTES * entries.len() as u64;
    for (i, entry) in entries.iter().enumerate() {
        let end = entry.offset.checked_add(entry.length).filter(|&end| end <= file_length);
        if entry.offset != next || end.is_none() {
            let found = format!("{} bytes at byte {}", entry.length, entry.offset);
            let expected = format!("a chunk at byte {next} that ends by byte {file_length}");
            let error = Error::malformed(entry.place(), found, expected);
            report(Finding { code: Code::ChunkBounds, error })?;
        }
        next = entry.padded_end();
        if !is_known(entry.kind) && entry.is_critical() {
            let found = format!("the critical chunk {}", entry.kind.escape_ascii());
            let expected = format!("critical chunks of version {}.{}", VERSION[0], VERSION[1]);
            let error = Error::unsupported(entry.place(), found, expected).advise(NEWER);
            report(Finding { code: Code::ChunkUnknown, error })?;
        }
        let same = |other: &&Entry| other.kind == entry.kind && other.level == entry.level;
        if is_known(entry.kind) && entries.iter().take(i).any(|other| same(&other)) {
            let error = Error::malformed(entry.place(), "the chunk a second time", "it once");
            report(Finding { code: Code::ChunkUnexpected, error })?;
        }
    }
    if next != file_length {
        let found = format!("chunks that end at byte {next}");
        let error = Error::malformed(Place::File, found, format!("byte {file_length}"));
        report(Finding { code: Code::ChunkBounds, error })?;
    }
    Ok(())
}

/// Checks that the bytes between chunks are zero.
pub fn padding(file: &SourceFile, entries: &[Entry], report: &mut Report) -> Result<()> {
    for entry in entries {
        let start = entry.offset.saturating_add(entry.length);
        let count = entry.padded_end().min(file.length()).saturating_sub(start);
        if count == 0 {
            continue;
        }
        let bytes = file.read(start, count, ALIGNMENT);
        let Some(bytes) = checked(bytes, Code::ChunkBounds, report)? else { continue };
        if let Some(at) = bytes.iter().position(|&byte| byte != 0) {
            let place = Place::Offset(start + at as u64);
            let error = Error::malformed(place, "a padding byte that is set", "zeros");
            report(Finding { code: Code::Padding, error })?;
        }
    }
    Ok(())
}

/// The features that this metadata requires.
pub fn required_features(metadata: &Metadata) -> u64 {
    let inherits = metadata.parts().any(|level| level.blocks_filled > 0);
    let linear = metadata.color_domain() == ColorDomain::Linear
        || metadata.activation.function != DensityFunction::Softplus
        || metadata.march.sampled.is_some()
        || metadata.march.voxel.is_some()
        || metadata.view.as_ref().and_then(ViewMetadata::harmonics).is_some();
    let bends = !metadata.level_of_detail.bends.is_empty();
    let bits = [
        (inherits, INHERITED_BLOCKS),
        (linear, LINEAR_VALUES),
        (bends, BENT_RULE),
        (metadata.has_directional(), DIRECTIONAL),
        (metadata.has_anisotropy(), ANISOTROPY),
        (!metadata.shells.is_empty(), NESTED_BOXES),
    ];
    bits.into_iter().filter(|&(is_set, _)| is_set).map(|(_, bit)| bit).sum()
}

/// Checks that the header states exactly the features that the metadata requires.
pub fn features(header: &Header, metadata: &Metadata, report: &mut Report) -> Result<()> {
    let required = required_features(metadata);
    if required == header.features & KNOWN_FEATURES {
        return Ok(());
    }
    let found = format!("required features {:#x}", header.features);
    let expected = format!("{required:#x}, as the metadata says");
    let error = Error::malformed(Place::Offset(16), found, expected);
    report(Finding { code: Code::Header, error })
}

/// Checks that exactly the chunks that the metadata implies are present, coarse to fine, with the
/// correct prefixes.
pub fn contents(
    entries: &[Entry],
    metadata: &Metadata,
    file_length: u64,
    report: &mut Report,
) -> Result<()> {
    let mut expected = vec![(META, None)];
    let network = metadata.view.as_ref().and_then(ViewMetadata::network);
    expected.extend(network.map(|_| (VMLP, None)));
    expected.extend(metadata.free_space.then_some((MASK, None)));
    for part in metadata.parts_in_file() {
        let (Some(level), number) = (metadata.part(part), u32::try_from(part).ok()) else {
            continue;
        };
        expected.push((TABLE, number));
        let groups = Group::ALL.into_iter().zip(ATLASES);
        let present = groups.filter(|&(group, _)| level.encoding(group).is_some());
        expected.extend(present.map(|(_, kind)| (kind, number)));
    }
    if entries.first().is_none_or(|entry| entry.kind != META) {
        let error = Error::malformed(Place::File, "another chunk first", "chunk META");
        report(Finding { code: Code::ChunkUnexpected, error })?;
    }
    // Ancillary chunks may be anywhere after that, but only for existing parts. Unknown critical
    // ones are already reported.
    let parts = metadata.parts().count();
    let ancillary = |entry: &&Entry| {
        let fits = match entry.kind {
            PROVENANCE | THUMBNAIL => entry.level.is_none(),
            _ => entry.level.is_none_or(|level| (level as usize) < parts),
        };
        if entry.is_critical() { !is_known(entry.kind) } else { fits }
    };
    let mut found = entries.iter().filter(|entry| !ancillary(entry)).peekable();
    for (kind, level) in expected {
        match found.next_if(|entry| entry.kind == kind && entry.level == level) {
            Some(_) => {}
            None => {
                let name = kind.escape_ascii();
                let place = Place::Chunk { kind, level };
                let error =
                    Error::malformed(place, "another chunk or none", format!("chunk {name}"));
                report(Finding { code: Code::ChunkMissing, error })?;
            }
        }
    }
    for entry in found {
        let error = Error::malformed(entry.place(), "a chunk out of place", "none here");
        report(Finding { code: Code::ChunkUnexpected, error })?;
    }
    prefixes(entries, metadata, file_length, report)
}

fn prefixes(
    entries: &[Entry],
    metadata: &Metadata,
    file_length: u64,
    report: &mut Report,
) -> Result<()> {
    for entry in entries {
        let expected = match entry.level {
            None => 0,
            Some(level) => level_prefix(entries, metadata, level, file_length),
        };
        if entry.prefix != expected {
            let found = format!("a prefix of {} bytes", entry.prefix);
            let error = Error::malformed(entry.place(), found, format!("{expected} bytes"));
            report(Finding { code: Code::Prefix, error })?;
        }
    }
    Ok(())
}

/// Bytes from the start of the file that suffice to render a level: its own chunks and all coarser
/// ones. If coarser levels have no density, the whole file.
pub fn level_prefix(entries: &[Entry], metadata: &Metadata, level: u32, file_length: u64) -> u64 {
    if metadata.parts().any(|level| level.density.is_none()) {
        return file_length;
    }
    let own = entries.iter().filter(|entry| entry.level == Some(level));
    own.map(Entry::padded_end).max().unwrap_or(file_length)
}
