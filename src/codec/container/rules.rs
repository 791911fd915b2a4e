//! What a container must obey beyond its records: `formats/mipvog.md`, sections 2 to 5.

use std::fmt;

use super::layout::{
    ALIGNMENT, ATLASES, ChunkKind, ENTRY_BYTES, Entry, FILLED_BLOCKS, HEADER_BYTES, Header, MASK,
    META, PROVENANCE, TABLE, VMLP,
};
use super::read::unknown_features;
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::finding::{Code, Finding, Report, checked, strict};
use crate::base::limits::{self, Limits};
use crate::model::baked::{Blend, Decode, Encoding, Group, LevelMetadata, Metadata, NumberType};
use crate::model::grid::Nodes;

/// Nodes along a block's edge, at most.
pub const LARGEST_BLOCK: usize = 64;

/// Whether this build knows the chunk type.
pub fn is_known(kind: ChunkKind) -> bool {
    [META, VMLP, MASK, PROVENANCE, TABLE].contains(&kind) || ATLASES.contains(&kind)
}

/// Features, length and the directory's place.
pub fn header(header: &Header, file_length: u64, report: &mut Report) -> Result<()> {
    if let Some(error) = unknown_features(header) {
        report(Finding { code: Code::Feature, error })?;
    }
    if header.file_length > file_length {
        let kind = ErrorKind::Truncated { wanted: header.file_length, left: file_length };
        report(Finding { code: Code::Length, error: Error::new(kind, Place::File) })?;
    } else if header.file_length < file_length {
        let found = format!("{} bytes after the end", file_length - header.file_length);
        let place = Place::Offset(header.file_length);
        let error = Error::malformed(place, found, "nothing there");
        report(Finding { code: Code::Length, error })?;
    }
    if header.directory_offset != HEADER_BYTES {
        let found = format!("a directory at byte {}", header.directory_offset);
        let error = Error::malformed(Place::Offset(32), found, "one right after the header");
        report(Finding { code: Code::Directory, error })?;
    }
    Ok(())
}

/// Chunks follow each other without holes, are known if critical, and each is there once.
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
            let error = Error::unsupported(entry.place(), found, "critical chunks of version 1.1");
            report(Finding { code: Code::ChunkUnknown, error })?;
        }
        let twin = |other: &&Entry| other.kind == entry.kind && other.level == entry.level;
        if is_known(entry.kind) && entries.iter().take(i).any(|other| twin(&other)) {
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

/// The bytes between chunks are zero.
pub fn padding(file: &SourceFile, entries: &[Entry], report: &mut Report) -> Result<()> {
    for entry in entries {
        let start = entry.offset.saturating_add(entry.length);
        let count = entry.padded_end().min(file.length()).saturating_sub(start);
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

/// The header says just whether there are filled blocks.
pub fn features(header: &Header, metadata: &Metadata, report: &mut Report) -> Result<()> {
    let filled = metadata.levels.iter().any(|level| level.blocks_filled > 0);
    if filled == (header.features & FILLED_BLOCKS != 0) {
        return Ok(());
    }
    let found = format!("required features {:#x}", header.features);
    let expected = if filled { "bit 0: blocks are filled" } else { "no bit 0: no block is filled" };
    let error = Error::malformed(Place::Offset(16), found, expected);
    report(Finding { code: Code::Header, error })
}

/// Holds values of the metadata to their rules.
struct Judge<'a, 'b> {
    /// Whether all were kept so far.
    sound: bool,
    report: &'a mut Report<'b>,
}

impl Judge<'_, '_> {
    fn refuse(&mut self, key: &str, kind: ErrorKind) -> Result<()> {
        self.sound = false;
        let error = Error::new(kind, Place::Key(key.to_owned()));
        (self.report)(Finding { code: Code::MetadataValue, error })
    }

    fn require(
        &mut self,
        key: &str,
        holds: bool,
        found: &dyn fmt::Debug,
        expected: &str,
    ) -> Result<()> {
        if holds {
            return Ok(());
        }
        let (found, expected) = (format!("{found:?}"), expected.to_owned());
        self.refuse(key, ErrorKind::Malformed { found, expected })
    }

    fn positive(&mut self, key: &str, value: f32) -> Result<()> {
        self.require(key, is_positive(value), &value, "a positive number")
    }

    fn share(&mut self, key: &str, value: f32) -> Result<()> {
        self.require(key, (0.0..1.0).contains(&value), &value, "0 to below 1")
    }

    /// A count that the caller's limits bound: one above is over that limit, and not malformed.
    fn limited<T>(&mut self, key: &str, checked: Result<T>) -> Result<Option<T>> {
        match checked {
            Ok(value) => Ok(Some(value)),
            Err(error) => self.refuse(key, error.into_kind()).map(|()| None),
        }
    }
}

fn is_positive(value: f32) -> bool {
    value > 0.0 && value.is_finite()
}

/// Values of the metadata are in range and agree. `false` where levels could not be read by them.
pub fn metadata(
    metadata: &Metadata,
    limits: &Limits,
    place: &Place,
    report: &mut Report,
) -> Result<bool> {
    let mut judge = Judge { sound: true, report };
    let march = &metadata.march;
    let (bounds, activation) = (&metadata.bounds, &metadata.activation);
    let (shift, interval) = (activation.shift, activation.interval);
    judge.require(
        "bounds",
        bounds.check(place).is_ok(),
        bounds,
        "finite corners, min below max",
    )?;
    judge.require("activation.shift", shift.is_finite(), &shift, "a finite number")?;
    judge.positive("activation.interval", interval)?;
    judge.positive("march.stepsize", march.stepsize)?;
    judge.positive("march.voxel_size", march.voxel_size)?;
    let near_fits = march.near >= 0.0 && march.near.is_finite();
    judge.require("march.near", near_fits, &march.near, "a number from 0")?;
    let far_fits = march.far.is_none_or(|far| far.is_finite() && far > march.near);
    judge.require("march.far", far_fits, &march.far, "a number above near, or null")?;
    judge.share("march.color_threshold", march.color_threshold)?;
    judge.share("march.alpha_threshold", march.alpha_threshold)?;
    judge.share("alpha_threshold", metadata.alpha_threshold)?;
    let finite = metadata.background.iter().all(|value| value.is_finite());
    judge.require("background", finite, &metadata.background, "finite numbers")?;
    let lod = &metadata.level_of_detail;
    let lod_fits = is_positive(lod.factor)
        && lod.bias.is_finite()
        && lod.most.is_none_or(|most| most >= 0.0 && most.is_finite());
    judge.require(
        "level_of_detail",
        lod_fits,
        lod,
        "a positive factor, a finite bias and bound",
    )?;
    let channels = (metadata.features as u64).saturating_add(3);
    let fits = limits::check("channels", channels, limits.channels, place);
    judge.limited("features", fits)?;
    let layers = metadata.view.as_ref().map(|view| &view.widths);
    let wide = layers.is_none_or(|w| (2..=32).contains(&w.len()) && w.iter().all(|&w| w <= 4096));
    judge.require("view.widths", wide, &layers, "2 to 32 widths of at most 4096")?;
    let octaves = metadata.view.as_ref().map(|view| view.frequencies);
    judge.require("view.frequencies", octaves.is_none_or(|o| o <= 32), &octaves, "at most 32")?;
    let count = metadata.levels.len();
    judge.require("levels", (1..=32).contains(&count), &count, "1 to 32 levels")?;
    let mut finer: Option<[usize; 3]> = None;
    for (number, level) in metadata.levels.iter().enumerate() {
        let key = |name: &str| format!("levels[{number}].{name}");
        let nodes = Nodes::checked(level.dimensions.map(|size| size as u64), limits, place);
        let shrinks = finer.is_none_or(|finer| {
            level.dimensions.iter().zip(finer).all(|(&size, finer)| size <= finer)
        });
        let sizes_fit = judge.limited(&key("dimensions"), nodes)?.is_some() && shrinks;
        let sizes = &level.dimensions;
        judge.require(&key("dimensions"), shrinks, sizes, "no more than the finer level")?;
        let block = (1..=LARGEST_BLOCK).contains(&level.block_size);
        judge.require(&key("block_size"), block, &level.block_size, "1 to 64")?;
        let stored = block && sizes_fit && level.blocks_stored <= level.grid().total();
        judge.require(&key("blocks_stored"), stored, &level.blocks_stored, "at most all blocks")?;
        let fills = metadata.levels.get(number + 1).is_some_and(LevelMetadata::has_integer_colors)
            && level.has_integer_colors()
            && level.blocks_filled <= level.blocks_stored;
        judge.require(
            &key("blocks_filled"),
            level.blocks_filled == 0 || fills,
            &level.blocks_filled,
            "at most the stored blocks, of a level with a coarser one, both with colours in integers",
        )?;
        judge.require(&key("diffuse"), level.diffuse.is_some(), &level.diffuse, "an encoding")?;
        let has_features = level.features.is_some() == (metadata.features > 0);
        judge.require(
            &key("features"),
            has_features,
            &level.features,
            "an encoding just where there are features",
        )?;
        for group in Group::ALL {
            let Some(encoding) = level.encoding(group) else { continue };
            judge.require(
                &key(group.name()),
                encoding_is_sound(encoding) && decodes(metadata.blend, group, encoding.decode),
                encoding,
                "a type with as many bits, a finite range",
            )?;
        }
        finer = Some(level.dimensions);
    }
    // Optical depths can only be mixed where every level has its own.
    let own = metadata.levels.iter().all(|level| level.density.is_some());
    let mixed = metadata.blend == Blend::BeforeActivation || own;
    judge.require(
        "blend",
        mixed,
        &metadata.blend,
        "before_activation where a level has no density",
    )?;
    let first = metadata.levels.first().map(|level| &level.density);
    let present = first.is_none_or(Option::is_some);
    judge.require("levels[0].density", present, &first, "an encoding")?;
    Ok(judge.sound)
}

/// [`metadata`] for strict readers: the first thing that is wrong is the error.
pub fn check_metadata(sound: &Metadata, limits: &Limits, place: &Place) -> Result<()> {
    metadata(sound, limits, place, &mut strict).map(|_| ())
}

/// Whether values of a group can mean this. Levels that are mixed before they are activated must mean
/// the same.
fn decodes(blend: Blend, group: Group, decode: Decode) -> bool {
    match (group, blend) {
        (Group::Density, Blend::BeforeActivation) => decode == Decode::RawDensity,
        (Group::Density, Blend::AfterActivation) => decode.is_density(),
        (Group::Diffuse | Group::Features, _) => decode == Decode::Logit,
    }
}

fn encoding_is_sound(encoding: &Encoding) -> bool {
    let bits = match encoding.number {
        NumberType::U8 => 1..=8,
        NumberType::U16 => 9..=16,
        NumberType::F16 => 16..=16,
        NumberType::F32 => 32..=32,
    };
    let range = if encoding.number.is_float() {
        let [center, step, curve] = [encoding.center, encoding.step, encoding.curve];
        center == 0.0 && step == 0.0 && curve == 0.0 && !encoding.empty_code
    } else {
        // The bits were checked first: there are at most 2^16 codes.
        bits.contains(&encoding.bits)
            && encoding.values().all(f32::is_finite)
            && encoding.values().is_sorted_by(|low, high| low < high)
    };
    let rest = encoding.empty.is_finite() && encoding.max_error >= 0.0;
    bits.contains(&encoding.bits) && range && rest && encoding.max_error.is_finite()
}

/// Every chunk that the metadata announces is there and no other, in order, coarse to fine, with
/// the right prefix.
pub fn contents(
    entries: &[Entry],
    metadata: &Metadata,
    file_length: u64,
    report: &mut Report,
) -> Result<()> {
    let mut expected = vec![(META, None)];
    expected.extend(metadata.view.iter().map(|_| (VMLP, None)));
    expected.extend(metadata.free_space.then_some((MASK, None)));
    for (number, level) in metadata.levels.iter().enumerate().rev() {
        let number = u32::try_from(number).ok();
        expected.push((TABLE, number));
        let groups = Group::ALL.into_iter().zip(ATLASES);
        let present = groups.filter(|&(group, _)| level.encoding(group).is_some());
        expected.extend(present.map(|(_, kind)| (kind, number)));
    }
    if entries.first().is_none_or(|entry| entry.kind != META) {
        let error = Error::malformed(Place::File, "another chunk first", "chunk META");
        report(Finding { code: Code::ChunkUnexpected, error })?;
    }
    // Ancillary chunks may stand anywhere after that; of levels that there are. Critical ones that nobody
    // knows were reported.
    let ancillary = |entry: &&Entry| {
        let fits = match entry.kind {
            PROVENANCE => entry.level.is_none(),
            _ => entry.level.is_none_or(|level| (level as usize) < metadata.levels.len()),
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

/// Bytes from the file's start after which a level renders: its own chunks and all coarser ones;
/// where coarser levels hold no density, the whole file.
pub fn level_prefix(entries: &[Entry], metadata: &Metadata, level: u32, file_length: u64) -> u64 {
    if metadata.levels.iter().any(|level| level.density.is_none()) {
        return file_length;
    }
    let own = entries.iter().filter(|entry| entry.level == Some(level));
    own.map(Entry::padded_end).max().unwrap_or(file_length)
}
