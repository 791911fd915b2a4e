//! A container from its file.
//!
//! One walk serves the strict reader and the validator: it reports what breaks the specification
//! and goes on where it can. Nothing is allocated before its size was held against the file's
//! length or the limits.

use std::sync::Arc;

use super::json::from_canonical;
use super::layout::{
    ATLASES, ChunkKind, ENTRY_BYTES, Entry, HEADER_BYTES, Header, MASK, META, PROVENANCE, TABLE,
    VMLP, read_directory,
};
use super::runs;
use super::{mask, network, rules};
use crate::base::bytes::{ByteReader, SourceFile};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::finding::{Code, Finding, Report, checked, strict};
use crate::base::limits::{self, Budget, Limits};
use crate::codec::quantize::{Filler, FrameShape};
use crate::model::baked::{
    BakedField, BakedLevel, Codes, Group, LevelMetadata, Metadata, Occupancy, Table,
};
use crate::model::field::FreeSpace;
use crate::model::view_mlp::ViewMlp;

/// An open container: its directory and metadata, checked; levels are read on demand.
#[derive(Debug)]
pub struct Container {
    file: Arc<SourceFile>,
    header: Header,
    entries: Vec<Entry>,
    metadata: Metadata,
    limits: Limits,
    /// Pointer to the value of a document that holds the container, and where it starts in its file.
    inside: Option<(String, u64)>,
}

/// Whether a file starts like a container.
pub fn is_container(file: &SourceFile) -> bool {
    let mut start = [0; 8];
    file.read_into(0, &mut start).is_ok() && start == super::layout::SIGNATURE
}

/// Whether a file is meant as a container, though the signature may be damaged: half of its bytes are there.
pub fn starts_container(file: &SourceFile) -> bool {
    let mut start = [0; 8];
    let read = file.read_into(0, &mut start).is_ok();
    read && start.iter().zip(super::layout::SIGNATURE).filter(|&(&a, b)| a == b).count() >= 4
}

impl Container {
    /// Bounds on what the file may ask for.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Opens a whole container and checks its structure and metadata, not yet its levels.
    ///
    /// # Errors
    /// The first thing that breaks the specification; every proper prefix of a container does.
    pub fn open(file: Arc<SourceFile>, limits: &Limits) -> Result<Self> {
        let path = file.path().to_owned();
        let opened = Self::walk(file, limits, &mut strict).map_err(|error| error.in_file(&path))?;
        // A strict walk ends with an error or a container.
        opened.ok_or_else(|| Error::malformed(Place::File, "no metadata", "a container"))
    }

    /// Opens a container, reporting everything that is wrong with its structure and metadata.
    /// `None` where too little is right to go on.
    pub fn walk(
        file: Arc<SourceFile>,
        limits: &Limits,
        report: &mut Report,
    ) -> Result<Option<Self>> {
        let head = file.read(0, HEADER_BYTES.min(file.length()), HEADER_BYTES);
        let header = head.and_then(|bytes| Header::read(&bytes));
        let Some(header) = checked(header, Code::Header, report)? else { return Ok(None) };
        rules::header(&header, file.length(), report)?;
        let entries = read_entries(&file, &header, limits);
        let Some(entries) = checked(entries, Code::Directory, report)? else { return Ok(None) };
        rules::chunks(&entries, header.file_length, report)?;
        rules::padding(&file, &entries, report)?;
        let Some(meta) = entries.iter().find(|entry| entry.kind == META) else {
            let error = Error::malformed(Place::File, "no chunk META", "one");
            report(Finding { code: Code::ChunkMissing, error })?;
            return Ok(None);
        };
        let bytes = chunk_bytes(&file, meta, limits.header_bytes, report)?;
        let metadata = bytes.map(|bytes| from_canonical::<Metadata>(&bytes, &meta.place()));
        let Some(metadata) = metadata else { return Ok(None) };
        let Some(metadata) = checked(metadata, Code::Metadata, report)? else { return Ok(None) };
        if !rules::metadata(&metadata, limits, &meta.place(), report)? {
            return Ok(None);
        }
        rules::features(&header, &metadata, report)?;
        rules::contents(&entries, &metadata, header.file_length, report)?;
        let limits = limits.clone();
        Ok(Some(Self { file, header, entries, metadata, limits, inside: None }))
    }

    /// Says that a value of a document holds this container, `offset` bytes from its file's start: errors of
    /// strict reads tell places in that file.
    #[must_use]
    pub fn inside(mut self, pointer: &str, offset: u64) -> Self {
        self.inside = Some((pointer.to_owned(), offset));
        self
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The file.
    pub fn file(&self) -> &SourceFile {
        &self.file
    }

    /// Every chunk, in the order of the file.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// All that is not bulk.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Reads and decodes everything.
    pub fn read(&self) -> Result<BakedField> {
        let read = || {
            let mut budget = Budget::new(&self.limits);
            let (view_mlp, free_space) = self.head(&mut budget, &mut strict)?;
            let mut levels = Vec::<BakedLevel>::new();
            for level in (0..self.metadata.levels.len()).rev() {
                let read = self.level(level, levels.last(), &mut budget, &mut strict)?;
                levels.extend(read);
            }
            levels.reverse();
            if levels.len() < self.metadata.levels.len() {
                return Err(Error::malformed(Place::File, "missing chunks", "a whole container"));
            }
            let metadata = self.metadata.clone();
            Ok(BakedField { metadata, view_mlp, free_space, levels })
        };
        self.in_file(read())
    }

    /// Decodes everything, coarse to fine, and keeps nothing but what one level needs, reporting what is wrong.
    pub fn check_contents(&self, report: &mut Report) -> Result<()> {
        self.head(&mut Budget::new(&self.limits), report)?;
        let mut coarser = None;
        for level in (0..self.metadata.levels.len()).rev() {
            let mut budget = Budget::new(&self.limits);
            coarser = self.level(level, coarser.as_ref(), &mut budget, report)?;
        }
        Ok(())
    }

    /// Reads everything level by level: `visit` gets each level in turn, coarsest first, so that
    /// only one is in memory, and the coarser one that filled blocks need. Chunks outside the levels are verified first.
    pub fn for_each_level(
        &self,
        mut visit: impl FnMut(usize, &BakedLevel) -> Result<()>,
    ) -> Result<()> {
        let mut coarser = None;
        for level in (0..self.metadata.levels.len()).rev() {
            let mut budget = Budget::new(&self.limits);
            let read = self.level(level, coarser.as_ref(), &mut budget, &mut strict);
            coarser = self.in_file(read)?;
            coarser.as_ref().map_or(Ok(()), |read| visit(level, read))?;
        }
        Ok(())
    }

    /// Reads and decodes one level, 0 being the finest.
    pub fn read_level(&self, number: usize) -> Result<BakedLevel> {
        // Filled blocks are made of the coarser levels, as far as those have filled blocks too.
        let levels = &self.metadata.levels;
        let filled = |level: &usize| levels.get(*level).is_some_and(|of| of.blocks_filled > 0);
        let last = (number..levels.len()).find(|level| !filled(level)).unwrap_or(number);
        let mut read = None;
        for level in (number..=last).rev() {
            let mut budget = Budget::new(&self.limits);
            read = self.in_file(self.level(level, read.as_ref(), &mut budget, &mut strict))?;
        }
        read.ok_or_else(|| Error::malformed(Place::File, "no such level", "one of the metadata"))
    }

    /// The network and the free-space mask; verifies every other chunk that belongs to no level.
    pub fn read_head(&self) -> Result<(Option<ViewMlp>, Option<FreeSpace>)> {
        self.in_file(self.head(&mut Budget::new(&self.limits), &mut strict))
    }

    /// Holds every chunk against its checksum.
    pub fn verify(&self) -> Result<()> {
        let verify = |entry| self.chunk(entry, &mut strict).map(|_| ());
        self.in_file(self.entries.iter().try_for_each(verify))
    }

    /// The provenance, if there is any.
    pub fn provenance(&self) -> Result<Option<serde_json::Value>> {
        let Some(entry) = self.entry(PROVENANCE, None) else { return Ok(None) };
        let bytes = self.in_file(self.chunk(entry, &mut strict))?;
        self.in_file(bytes.map(|bytes| from_canonical(&bytes, &entry.place())).transpose())
    }

    fn in_file<T>(&self, result: Result<T>) -> Result<T> {
        result.map_err(|error| {
            let error = error.in_file(self.file.path());
            match &self.inside {
                Some((pointer, offset)) => error.within(pointer, *offset),
                None => error,
            }
        })
    }

    fn head(
        &self,
        budget: &mut Budget,
        report: &mut Report,
    ) -> Result<(Option<ViewMlp>, Option<FreeSpace>)> {
        let (mut view_mlp, mut free_space) = (None, None);
        let bulk = |entry: &&Entry| entry.level.is_some() && rules::is_known(entry.kind);
        for entry in self.entries.iter().filter(|entry| !bulk(entry)) {
            let Some(bytes) = self.chunk(entry, report)? else { continue };
            let mut reader = ByteReader::new(&bytes, entry.offset);
            let place = entry.place();
            match (entry.kind, &self.metadata.view) {
                (VMLP, Some(view)) => {
                    let read = network::read(view, &self.metadata, &mut reader, &place);
                    view_mlp = checked(read, Code::Network, report)?;
                }
                (MASK, _) => {
                    let read = mask::read(&mut reader, &place, &self.limits, budget);
                    free_space = checked(read, Code::FreeSpace, report)?;
                }
                (PROVENANCE, _) => {
                    let read = from_canonical::<serde_json::Value>(&bytes, &place);
                    checked(read, Code::Provenance, report)?;
                }
                _ => {}
            }
        }
        Ok((view_mlp, free_space))
    }

    /// A level, whose filled blocks are made of the `coarser` one.
    fn level(
        &self,
        number: usize,
        coarser: Option<&BakedLevel>,
        budget: &mut Budget,
        report: &mut Report,
    ) -> Result<Option<BakedLevel>> {
        let Some(level) = self.metadata.levels.get(number) else { return Ok(None) };
        let Some(entry) = self.entry(TABLE, Some(number)) else { return Ok(None) };
        let Some(bytes) = self.chunk(entry, report)? else { return Ok(None) };
        let (asked, place) = (level.grid().total() as u64, entry.place());
        let table = limits::check("blocks", asked, self.limits.blocks, &place)
            .and_then(|()| read_table(level, &bytes, &place, budget));
        let Some(table) = checked(table, Code::Table, report)? else { return Ok(None) };
        let mut atlases = [None, None, None];
        let mut whole = true;
        for ((group, kind), atlas) in Group::ALL.into_iter().zip(ATLASES).zip(&mut atlases) {
            if level.encoding(group).is_some() {
                let filled = if group == Group::Density { 0 } else { table.filled() };
                let frames = table.frames() - filled;
                *atlas = self.atlas(number, group, kind, frames, budget, report)?;
                if let Some(stored) = atlas.take_if(|_| filled > 0) {
                    *atlas = self.fill(number, group, (&table, &stored), coarser, budget)?;
                }
                whole &= atlas.is_some();
            }
        }
        Ok(whole.then_some(BakedLevel { table, atlases }))
    }

    fn atlas(
        &self,
        number: usize,
        group: Group,
        kind: ChunkKind,
        frames: usize,
        budget: &mut Budget,
        report: &mut Report,
    ) -> Result<Option<Codes>> {
        let level = self.metadata.levels.get(number);
        let Some((level, encoding)) = level.and_then(|l| l.encoding(group).map(|e| (l, e))) else {
            return Ok(None);
        };
        let Some(entry) = self.entry(kind, Some(number)) else { return Ok(None) };
        let Some(bytes) = self.chunk(entry, report)? else { return Ok(None) };
        let shape = FrameShape {
            number: encoding.number,
            channels: group.channels(self.metadata.features),
            edge: level.block_size,
        };
        let codes =
            runs::decode(shape, encoding, frames, &bytes, &entry.place(), entry.offset, budget);
        checked(codes, Code::Atlas, report)
    }

    /// The codes of all blocks from those of the ones that are stored; none where the coarser level is missing.
    fn fill(
        &self,
        number: usize,
        group: Group,
        (table, stored): (&Table, &Codes),
        coarser: Option<&BakedLevel>,
        budget: &mut Budget,
    ) -> Result<Option<Codes>> {
        let of = |number: usize| self.metadata.levels.get(number);
        let (Some(level), Some(of_coarser), Some(coarser)) = (of(number), of(number + 1), coarser)
        else {
            return Ok(None);
        };
        let channels = group.channels(self.metadata.features);
        let bytes = level.encoding(group).map_or(0, |encoding| encoding.number.bytes());
        let size = (table.frames() * channels * bytes) as u64 * level.grid().block_nodes() as u64;
        let place = Place::Chunk { kind: TABLE, level: u32::try_from(number).ok() };
        budget.spend(size, "bytes of codes", &place)?;
        let filler = Filler::new(level, (of_coarser, coarser), group, channels);
        Ok(filler.map(|filler| filler.fill(table, stored)))
    }

    fn entry(&self, kind: ChunkKind, level: Option<usize>) -> Option<&Entry> {
        self.entries
            .iter()
            .find(|entry| entry.kind == kind && entry.level.map(|level| level as usize) == level)
    }

    fn chunk(&self, entry: &Entry, report: &mut Report) -> Result<Option<Vec<u8>>> {
        chunk_bytes(&self.file, entry, self.limits.memory, report)
    }
}

fn read_entries(file: &SourceFile, header: &Header, limits: &Limits) -> Result<Vec<Entry>> {
    let place = Place::Offset(HEADER_BYTES);
    limits::check("chunks", header.entries.into(), limits.chunks, &place)?;
    let length = HEADER_BYTES + ENTRY_BYTES * u64::from(header.entries);
    let bytes = file.read(0, length, length)?;
    read_directory(header, &bytes)
}

/// A chunk's bytes, held against their checksum.
fn chunk_bytes(
    file: &SourceFile,
    entry: &Entry,
    allowed: u64,
    report: &mut Report,
) -> Result<Option<Vec<u8>>> {
    let bytes = file.read(entry.offset, entry.length, allowed);
    let Some(bytes) = checked(bytes, Code::ChunkBounds, report)? else { return Ok(None) };
    let found = crc32fast::hash(&bytes);
    if found == entry.checksum {
        return Ok(Some(bytes));
    }
    let kind =
        ErrorKind::Checksum { what: "the chunk".to_owned(), found, expected: entry.checksum };
    report(Finding { code: Code::ChunkChecksum, error: Error::new(kind, entry.place()) })?;
    Ok(None)
}

fn read_table(
    level: &LevelMetadata,
    bytes: &[u8],
    place: &Place,
    budget: &mut Budget,
) -> Result<Table> {
    let grid = level.grid();
    budget.spend(2 * grid.total() as u64, "bytes of tables", place)?;
    let ids = runs::decompress(bytes, grid.total(), place)?;
    let mut occupancy = Vec::with_capacity(ids.len());
    for (block, id) in ids.into_iter().enumerate() {
        occupancy.push(Occupancy::from_id(id).ok_or_else(|| {
            let found = format!("occupancy {id} of block {block}");
            Error::malformed(place.clone(), found, "0 (empty), 1 (stored) or 2 (filled)")
        })?);
    }
    let table = Table::new(grid, occupancy)?;
    if table.frames() == level.blocks_stored && table.filled() == level.blocks_filled {
        return Ok(table);
    }
    let found = format!("{} stored blocks, {} of them filled", table.frames(), table.filled());
    let expected = format!("{}, {} of them filled", level.blocks_stored, level.blocks_filled);
    Err(Error::malformed(place.clone(), found, expected))
}
