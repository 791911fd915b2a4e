//! Joins boxes that were packed one by one into one container.

use crate::bake::PruneReport;
use crate::bake::report::prune_reports;
use crate::container::EncodedLevel;
use crate::levels::Visible;
use crate::model::baked::{LevelMetadata, Metadata};

/// Facts about a box beside its levels.
pub struct BoxRecord {
    pruned: Vec<PruneReport>,
    nonfinite: u64,
    density_checksums: Vec<u32>,
}

impl BoxRecord {
    /// For a box with known visible nodes, in which this many values were not finite.
    pub fn new(visible: &Visible, nonfinite: u64) -> Self {
        let pruned = prune_reports(visible, 0);
        Self { pruned, nonfinite, density_checksums: visible.density_checksums.clone() }
    }
}

/// A box as it was packed.
pub type PackedBox = (Metadata, Vec<EncodedLevel>, BoxRecord);

/// The parts of a container.
pub struct Merged {
    /// That of the whole.
    pub metadata: Metadata,
    /// Levels, then shells.
    pub encoded: Vec<EncodedLevel>,
    /// By level.
    pub pruned: Vec<PruneReport>,
    /// Values that were replaced.
    pub nonfinite: u64,
    /// CRC-32 of planes of density, box by box.
    pub density_checksums: Vec<u32>,
}

impl Merged {
    /// Of the smallest box.
    pub fn of_first((metadata, encoded, record): PackedBox) -> Self {
        let BoxRecord { pruned, nonfinite, density_checksums } = record;
        Self { metadata, encoded, pruned, nonfinite, density_checksums }
    }

    /// Adds the next larger box: its first level is a shell, the others are the levels that follow.
    pub fn add(&mut self, (metadata, encoded, record): PackedBox) {
        self.nonfinite += record.nonfinite;
        self.density_checksums.extend(record.density_checksums);
        let mut levels = metadata.levels.into_iter();
        let mut encoded = encoded.into_iter();
        // Shells stay behind all levels.
        let shells = self.encoded.split_off(self.metadata.levels.len());
        let shell = levels.next();
        self.metadata
            .shells
            .extend(shell.map(|shell| LevelMetadata { bounds: Some(metadata.bounds), ..shell }));
        let own_shell = encoded.next();
        self.metadata.levels.extend(levels);
        self.encoded.extend(encoded);
        self.encoded.extend(shells.into_iter().chain(own_shell));
        let before = self.pruned.len();
        self.pruned.extend(record.pruned.into_iter().skip(1));
        (before..).zip(self.pruned.iter_mut().skip(before)).for_each(|(level, report)| {
            report.level = level;
        });
    }
}
