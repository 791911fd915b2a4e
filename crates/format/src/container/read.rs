//! Levels and other chunks of an open container.

use super::Container;
use super::json::from_canonical;
use super::layout::{ATLASES, ChunkKind, Entry, MASK, PROVENANCE, TABLE, THUMBNAIL, VMLP};
use super::thumbnail::thumbnail_size;
use super::write::OtherChunk;
use super::{mask, network, rules, runs, table};
use crate::base::bytes::ByteReader;
use crate::base::error::{Error, Place, Result};
use crate::base::finding::{Code, Report, checked, strict};
use crate::base::limits::{self, Budget, LimitName};
use crate::model::baked::{
    BakedField, BakedLevel, Codes, GROUPS, Group, LevelMetadata, Occupancy, Table, ViewMetadata,
};
use crate::model::scene::FreeSpace;
use crate::model::view_mlp::ViewMlp;
use crate::quantize::{FrameShape, InheritedColors};

impl Container {
    /// Reads and decodes everything.
    pub fn read(&self) -> Result<BakedField> {
        self.read_from(0)
    }

    /// Reads and decodes all levels from `finest` on; finer ones have no blocks.
    pub(super) fn read_from(&self, finest: usize) -> Result<BakedField> {
        let read = || {
            let mut budget = Budget::new(&self.limits);
            let (view_mlp, free_space) = self.head(&mut budget, &mut strict)?;
            let mut metadata = self.metadata.clone();
            let mut parts: Vec<Option<BakedLevel>> = self.metadata.parts().map(|_| None).collect();
            let missing = || Error::malformed(Place::File, "missing chunks", "a whole container");
            for part in self.metadata.parts_in_file() {
                let number = self.metadata.level_of_part(part);
                let coarser = parts.get(number + 1).and_then(Option::as_ref);
                let coarser = coarser.filter(|_| number + 1 < self.metadata.levels.len());
                let read = if number < finest {
                    let level = metadata.parts_mut().nth(part).ok_or_else(missing)?;
                    (level.blocks_stored, level.blocks_filled) = (0, 0);
                    empty_level(level, &mut budget)?
                } else {
                    let read = self.level(part, coarser, &mut budget, &mut strict)?;
                    read.ok_or_else(missing)?
                };
                if let Some(place) = parts.get_mut(part) {
                    *place = Some(read);
                }
            }
            let levels = parts.into_iter().map(|part| part.ok_or_else(missing));
            let levels = levels.collect::<Result<Vec<BakedLevel>>>()?;
            Ok(BakedField { metadata, view_mlp, free_space, levels, finest })
        };
        self.in_file(read())
    }

    /// Decodes everything, coarse to fine, and reports all faults. Only one level is in memory at a
    /// time.
    #[doc(hidden)]
    pub fn check_contents(&self, report: &mut Report) -> Result<()> {
        self.head(&mut Budget::new(&self.limits), report)?;
        let mut coarser = None;
        for part in self.metadata.parts_in_file() {
            let mut budget = Budget::new(&self.limits);
            let read = self.level(part, coarser.as_ref(), &mut budget, report)?;
            // A shell and its level share the next coarser level.
            if part < self.metadata.levels.len() {
                coarser = read;
            }
        }
        Ok(())
    }

    /// Reads all parts, coarsest first. `visit` gets the number of each part and the part. Only
    /// this part is in memory, plus the coarser level that inherited blocks need.
    /// [`Self::read_head`] reads the chunks that belong to no level.
    pub fn for_each_part(
        &self,
        mut visit: impl FnMut(usize, &BakedLevel) -> Result<()>,
    ) -> Result<()> {
        let mut coarser = None;
        for part in self.metadata.parts_in_file() {
            let mut budget = Budget::new(&self.limits);
            let read = self.level(part, coarser.as_ref(), &mut budget, &mut strict);
            let read = self.in_file(read)?;
            read.as_ref().map_or(Ok(()), |read| visit(part, read))?;
            if part < self.metadata.levels.len() {
                coarser = read;
            }
        }
        Ok(())
    }

    /// Reads and decodes one level, 0 being the finest, without its shell.
    pub fn read_level(&self, number: usize) -> Result<BakedLevel> {
        // Inherited blocks need the next coarser level, and its own coarser levels while those have
        // inherited blocks too.
        let levels = &self.metadata.levels;
        let inherits =
            |level: &usize| levels.get(*level).is_some_and(|level| level.blocks_filled > 0);
        let last = (number..levels.len()).find(|level| !inherits(level)).unwrap_or(number);
        let mut read = None;
        for level in (number..=last).rev() {
            let mut budget = Budget::new(&self.limits);
            read = self.in_file(self.level(level, read.as_ref(), &mut budget, &mut strict))?;
        }
        read.ok_or_else(|| Error::malformed(Place::File, "no such level", "one of the metadata"))
    }

    /// Reads the network and the free-space mask. Verifies all other chunks that belong to no
    /// level.
    pub fn read_head(&self) -> Result<(Option<ViewMlp>, Option<FreeSpace>)> {
        self.in_file(self.head(&mut Budget::new(&self.limits), &mut strict))
    }

    /// Verifies the checksum of every chunk.
    pub fn verify(&self) -> Result<()> {
        let verify = |entry| self.chunk(entry, &mut strict).map(|_| ());
        self.in_file(self.entries.iter().try_for_each(verify))
    }

    /// The provenance, if any.
    pub fn provenance(&self) -> Result<Option<serde_json::Value>> {
        let Some(entry) = self.entry(PROVENANCE, None) else { return Ok(None) };
        let bytes = self.in_file(self.chunk(entry, &mut strict))?;
        self.in_file(bytes.map(|bytes| from_canonical(&bytes, &entry.place())).transpose())
    }

    /// The ancillary chunks that this version does not know, in the order of the file. A program
    /// that rewrites the container keeps them.
    pub fn other_chunks(&self) -> Result<Vec<OtherChunk>> {
        let unknown = |entry: &&Entry| !entry.is_critical() && entry.kind != PROVENANCE;
        let chunks = self.entries.iter().filter(unknown).map(|entry| {
            let bytes = self.chunk(entry, &mut strict)?.unwrap_or_default();
            Ok(OtherChunk { kind: entry.kind, level: entry.level, bytes })
        });
        self.in_file(chunks.collect())
    }

    fn head(
        &self,
        budget: &mut Budget,
        report: &mut Report,
    ) -> Result<(Option<ViewMlp>, Option<FreeSpace>)> {
        let (mut view_mlp, mut free_space) = (None, None);
        let bulk = |entry: &&Entry| entry.level.is_some() && rules::is_known(entry.kind);
        // A prefix may lack ancillary chunks. The length of a complete file is already checked.
        let is_cut = |entry: &&Entry| {
            self.file.length() < self.header.file_length
                && !entry.is_critical()
                && entry.padded_end() > self.file.length()
        };
        for entry in self.entries.iter().filter(|entry| !bulk(entry) && !is_cut(entry)) {
            let place = entry.place();
            self.with_chunk(entry, budget, report, |bytes, budget, report| {
                let mut reader = ByteReader::new(bytes, entry.offset);
                let network = self.metadata.view.as_ref().and_then(ViewMetadata::network);
                match (entry.kind, network) {
                    (VMLP, Some(view)) => {
                        let read = network::read(view, &self.metadata, &mut reader, &place);
                        view_mlp = checked(read, Code::Network, report)?;
                    }
                    (MASK, _) => {
                        let read = mask::read(&mut reader, &place, &self.limits, budget);
                        free_space = checked(read, Code::FreeSpace, report)?;
                    }
                    (PROVENANCE, _) => {
                        let read = from_canonical::<serde_json::Value>(bytes, &place);
                        checked(read, Code::Provenance, report)?;
                    }
                    (THUMBNAIL, _) => {
                        checked(thumbnail_size(bytes, &place), Code::Thumbnail, report)?;
                    }
                    _ => {}
                }
                Ok(Some(()))
            })?;
        }
        Ok((view_mlp, free_space))
    }

    /// Reads a part, and makes inherited blocks from the `coarser` level.
    fn level(
        &self,
        number: usize,
        coarser: Option<&BakedLevel>,
        budget: &mut Budget,
        report: &mut Report,
    ) -> Result<Option<BakedLevel>> {
        let Some(level) = self.metadata.part(number) else { return Ok(None) };
        let Some(entry) = self.entry(TABLE, Some(number)) else { return Ok(None) };
        let (asked, place) = (level.grid().total() as u64, entry.place());
        let in_runs = !self.metadata.shells.is_empty();
        let table = self.with_chunk(entry, budget, report, |bytes, budget, report| {
            let table =
                limits::check(LimitName::Blocks, "blocks", asked, self.limits.blocks, &place)
                    .and_then(|()| table::read(level, in_runs, bytes, &place, budget));
            checked(table, Code::Table, report)
        })?;
        let Some(table) = table else { return Ok(None) };
        let mut atlases = [const { None }; GROUPS];
        let mut whole = true;
        for ((group, kind), atlas) in Group::ALL.into_iter().zip(ATLASES).zip(&mut atlases) {
            if level.encoding(group).is_some() {
                let inherited = if group.is_color() { table.inherited() } else { 0 };
                let frames = table.frames() - inherited;
                *atlas = self.atlas(number, group, kind, frames, budget, report)?;
                if let Some(stored) = atlas.take_if(|_| inherited > 0) {
                    *atlas = self.restore(number, group, (&table, &stored), coarser, budget)?;
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
        let level = self.metadata.part(number);
        let Some((level, encoding)) = level.and_then(|l| l.encoding(group).map(|e| (l, e))) else {
            return Ok(None);
        };
        let Some(entry) = self.entry(kind, Some(number)) else { return Ok(None) };
        let shape = FrameShape {
            number: encoding.number,
            channels: group.channels(self.metadata.layout()),
            edge: level.block_size,
        };
        self.with_chunk(entry, budget, report, |bytes, budget, report| {
            let (place, offset) = (entry.place(), entry.offset);
            let codes = runs::decode(shape, encoding, frames, bytes, &place, offset, budget);
            checked(codes, Code::Atlas, report)
        })
    }

    /// The codes of all blocks, restored from those of stored blocks. `None` if the coarser level
    /// is missing.
    fn restore(
        &self,
        number: usize,
        group: Group,
        (table, stored): (&Table, &Codes),
        coarser: Option<&BakedLevel>,
        budget: &mut Budget,
    ) -> Result<Option<Codes>> {
        let (Some(level), Some(coarser_metadata), Some(coarser)) =
            (self.metadata.part(number), self.metadata.coarser(number), coarser)
        else {
            return Ok(None);
        };
        let channels = group.channels(self.metadata.layout());
        let bytes = level.encoding(group).map_or(0, |encoding| encoding.number.bytes());
        let size = (table.frames() * channels * bytes) as u64 * level.grid().block_nodes() as u64;
        let place = Place::Chunk { kind: TABLE, level: u32::try_from(number).ok() };
        budget.spend(size, "bytes of codes", &place)?;
        let colors = InheritedColors::new(level, (coarser_metadata, coarser), group, channels);
        Ok(colors.map(|colors| colors.restore(table, stored)))
    }
}

/// A level without blocks.
fn empty_level(level: &LevelMetadata, budget: &mut Budget) -> Result<BakedLevel> {
    let total = level.grid().total();
    budget.spend(total as u64, "bytes of tables", &Place::File)?;
    let table = Table::new(level.grid(), vec![Occupancy::Empty; total])?;
    let codes = |group| level.encoding(group).map(|encoding| Codes::zeroed(encoding.number, 0));
    Ok(BakedLevel { table, atlases: Group::ALL.map(codes) })
}
