//! Opening a container: its header, directory and metadata.
//!
//! The strict reader, the prefix reader and the validator share one walk, which reports each
//! violated rule and continues if possible. Before allocation, sizes are checked against the file's
//! length or the limits.

use std::path::Path;
use std::sync::Arc;

use super::json::from_canonical;
use super::layout::{ChunkKind, ENTRY_BYTES, Entry, HEADER_BYTES, Header, META, read_directory};
use super::{metadata_rules, rules};
use crate::base::bytes::{ReadAt, SourceFile};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::file_kind::describe;
use crate::base::finding::{Code, Finding, Report, checked, strict};
use crate::base::limits::{self, Budget, LimitName, Limits};
use crate::model::baked::Metadata;

/// A rule on the length of a file.
type LengthRule = fn(&Header, u64, &mut Report) -> Result<()>;

/// An open container. Its directory and metadata are checked; levels are read on demand.
#[derive(Debug)]
pub struct Container {
    pub(super) file: Arc<SourceFile>,
    pub(super) header: Header,
    pub(super) entries: Vec<Entry>,
    pub(super) metadata: Metadata,
    pub(super) limits: Limits,
    /// JSON pointer to the value of the document that embeds the container, and the container's
    /// offset in the file.
    pub(super) inside: Option<(String, u64)>,
}

/// True if a file starts like a container.
pub fn is_container(file: &SourceFile) -> bool {
    let mut start = [0; 8];
    file.read_into(0, &mut start).is_ok() && start == super::layout::SIGNATURE
}

/// Letters in the signatures of PNG and HDF5, whose other bytes equal those of a container.
const RELATIVES: [&[u8]; 2] = [b"PNG", b"HDF"];

/// True if half of the signature's bytes match, so the file is probably a container with a damaged
/// signature.
pub fn starts_container(file: &SourceFile) -> bool {
    let mut start = [0; 8];
    let read = file.read_into(0, &mut start).is_ok() && !RELATIVES.contains(&&start[1..4]);
    read && start.iter().zip(super::layout::SIGNATURE).filter(|&(&a, b)| a == b).count() >= 4
}

impl Container {
    /// Opens a complete container. Checks its structure and metadata, but not yet its levels.
    ///
    /// # Errors
    /// The first violated rule of the specification. Every proper prefix of a container violates
    /// one.
    pub fn open(file: Arc<SourceFile>, limits: &Limits) -> Result<Self> {
        Self::strictly(file, limits, rules::length)
    }

    /// Opens the container at a path; see [`Self::open`].
    pub fn open_path(path: &Path, limits: &Limits) -> Result<Self> {
        Self::open(Arc::new(SourceFile::open(path)?), limits)
    }

    /// Opens a container in memory; see [`Self::open`]. A slice is copied once.
    ///
    /// ```
    /// use mipvog_format::{Container, ErrorKind, Limits};
    ///
    /// let error = Container::from_bytes(vec![0; 99], &Limits::default()).expect_err("no container");
    /// assert!(matches!(error.kind(), ErrorKind::WrongKind { .. }), "{error}");
    /// ```
    pub fn from_bytes(bytes: impl Into<Vec<u8>>, limits: &Limits) -> Result<Self> {
        Self::open(Arc::new(SourceFile::decoded(bytes.into(), Path::new("memory"))), limits)
    }

    /// Opens a container through positioned reads; see [`Self::open`]. Messages name it `path`.
    pub fn from_reads(bytes: Arc<dyn ReadAt>, path: &Path, limits: &Limits) -> Result<Self> {
        Self::open(Arc::new(SourceFile::held(bytes, path)?), limits)
    }

    /// Opens a container with at least one complete level: the file ends where the header says, or
    /// at a level's prefix. [`Prefix`](super::Prefix) wraps it.
    pub(super) fn open_prefix(file: Arc<SourceFile>, limits: &Limits) -> Result<Self> {
        Self::strictly(file, limits, |_, _, _| Ok(()))
    }

    fn strictly(file: Arc<SourceFile>, limits: &Limits, length: LengthRule) -> Result<Self> {
        let path = file.path().to_owned();
        // A file that ends within the signature may be the start of a container.
        let start = file.read(0, file.length().min(8), 8)?;
        if !starts_container(&file) && !super::layout::SIGNATURE.starts_with(&start) {
            let found = describe(&file)?;
            return Err(Error::wrong_kind(found, "a .mipvog container").in_file(&path));
        }
        let opened = Self::walk_with(file, limits, length, &mut strict);
        // A strict walk ends with an error or a container.
        let opened = opened.map_err(|error| error.in_file(&path))?;
        opened.ok_or_else(|| Error::malformed(Place::File, "no metadata", "a container"))
    }

    /// Opens a container and reports all faults of its structure and metadata. Returns `None` if
    /// reading cannot continue.
    #[doc(hidden)]
    pub fn walk(
        file: Arc<SourceFile>,
        limits: &Limits,
        report: &mut Report,
    ) -> Result<Option<Self>> {
        Self::walk_with(file, limits, rules::length, report)
    }

    fn walk_with(
        file: Arc<SourceFile>,
        limits: &Limits,
        length: LengthRule,
        report: &mut Report,
    ) -> Result<Option<Self>> {
        let head = file.read(0, HEADER_BYTES.min(file.length()), HEADER_BYTES);
        let header = head.and_then(|bytes| Header::read(&bytes));
        let Some(header) = checked(header, Code::Header, report)? else { return Ok(None) };
        rules::header(&header, report)?;
        length(&header, file.length(), report)?;
        let entries = read_entries(&file, &header, limits);
        let Some(entries) = checked(entries, Code::Directory, report)? else { return Ok(None) };
        rules::chunks(&entries, header.file_length, report)?;
        rules::padding(&file, &entries, report)?;
        let Some(meta) = entries.iter().find(|entry| entry.kind == META) else {
            let error = Error::malformed(Place::File, "no chunk META", "one");
            report(Finding { code: Code::ChunkMissing, error })?;
            return Ok(None);
        };
        let bytes = chunk_bytes(
            &file,
            meta,
            (LimitName::HeaderBytes, "header bytes", limits.header_bytes),
            report,
        )?;
        let metadata = bytes.map(|bytes| from_canonical::<Metadata>(&bytes, &meta.place()));
        let Some(metadata) = metadata else { return Ok(None) };
        let Some(metadata) = checked(metadata, Code::Metadata, report)? else { return Ok(None) };
        if !metadata_rules::metadata(&metadata, limits, &meta.place(), report)? {
            return Ok(None);
        }
        rules::features(&header, &metadata, report)?;
        rules::contents(&entries, &metadata, header.file_length, report)?;
        let limits = limits.clone();
        Ok(Some(Self { file, header, entries, metadata, limits, inside: None }))
    }

    /// Marks this container as embedded in a value of a document, at byte `offset` of its file.
    /// Errors of strict reads then have places in that file.
    #[must_use]
    pub fn inside(mut self, pointer: &str, offset: u64) -> Self {
        self.inside = Some((pointer.to_owned(), offset));
        self
    }

    /// The limits at opening.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The file.
    pub fn file(&self) -> &SourceFile {
        &self.file
    }

    /// All chunks, in the order of the file.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// The metadata: everything except bulk data.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The chunk of a kind and level, if present.
    pub(super) fn entry(&self, kind: ChunkKind, level: Option<usize>) -> Option<&Entry> {
        self.entries
            .iter()
            .find(|entry| entry.kind == kind && entry.level.map(|level| level as usize) == level)
    }

    /// A chunk's bytes, with a verified checksum.
    pub(super) fn chunk(&self, entry: &Entry, report: &mut Report) -> Result<Option<Vec<u8>>> {
        chunk_bytes(
            &self.file,
            entry,
            (LimitName::Memory, "bytes of chunks", self.limits.memory),
            report,
        )
    }

    /// Decodes a chunk's bytes. The bytes count against the budget until decoded.
    pub(super) fn with_chunk<T>(
        &self,
        entry: &Entry,
        budget: &mut Budget,
        report: &mut Report,
        decode: impl FnOnce(&[u8], &mut Budget, &mut Report) -> Result<Option<T>>,
    ) -> Result<Option<T>> {
        let paid = budget.spend(entry.length, "bytes of chunks", &entry.place());
        let Some(()) = checked(paid, Code::ChunkBounds, report)? else { return Ok(None) };
        let decoded = match self.chunk(entry, report)? {
            Some(bytes) => decode(&bytes, budget, report)?,
            None => None,
        };
        budget.give_back(entry.length);
        Ok(decoded)
    }

    /// Adds the file to errors of strict reads.
    pub(super) fn in_file<T>(&self, result: Result<T>) -> Result<T> {
        result.map_err(|error| {
            let error = error.in_file(self.file.path());
            match &self.inside {
                Some((pointer, offset)) => error.within(pointer, *offset),
                None => error,
            }
        })
    }
}

fn read_entries(file: &SourceFile, header: &Header, limits: &Limits) -> Result<Vec<Entry>> {
    let place = Place::Offset(HEADER_BYTES);
    limits::check(LimitName::Chunks, "chunks", header.entries.into(), limits.chunks, &place)?;
    let length = HEADER_BYTES + ENTRY_BYTES * u64::from(header.entries);
    let bytes = file.read(0, length, length)?;
    read_directory(header, &bytes)
}

/// A chunk's bytes, with a verified checksum. Refuses more bytes than the limit `allowed`.
fn chunk_bytes(
    file: &SourceFile,
    entry: &Entry,
    (limit, what, allowed): (LimitName, &'static str, u64),
    report: &mut Report,
) -> Result<Option<Vec<u8>>> {
    let bytes = file.read_bounded(entry.offset, entry.length, (limit, what), allowed);
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
