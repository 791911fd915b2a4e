//! A container's content, decoded to codes.

use super::{Codes, GROUPS, Group, LevelMetadata, Metadata, Table};
use crate::base::error::{Error, Place, Result};
use crate::model::scene::FreeSpace;
use crate::model::view_mlp::ViewMlp;

/// A container's content, decoded to codes.
#[derive(Debug, Clone, PartialEq)]
pub struct BakedField {
    /// The metadata.
    pub metadata: Metadata,
    /// View-dependent colour, if any.
    pub view_mlp: Option<ViewMlp>,
    /// The free-space mask, if dropping it would be visible.
    pub free_space: Option<FreeSpace>,
    /// Levels, finest first, then shells: the parts of the metadata.
    pub levels: Vec<BakedLevel>,
    /// The finest level that was read, above 0 only for a prefix of a container. Finer levels are
    /// empty.
    pub finest: usize,
}

impl BakedField {
    /// Reduces the content to level 0's box: the levels that span it, without shells.
    #[must_use]
    pub fn inner_box(self) -> Self {
        self.one_box(0)
    }

    /// The content of one of the nested boxes, as a field of one box; 0 is that of level 0. Its
    /// level 0 is the box's shell, which has a hole where the next smaller box is. A number that is
    /// too large means the outermost box.
    #[must_use]
    pub fn one_box(mut self, number: usize) -> Self {
        let metadata = &self.metadata;
        if metadata.shells.is_empty() {
            return self;
        }
        let number = number.min(metadata.shells.len());
        let coarser = number + 1..metadata.levels.len();
        let coarser = coarser.filter(|level| metadata.box_of_part(*level) == number);
        let own: Vec<usize> = metadata.shell_of(number).into_iter().chain(coarser).collect();
        let own = if number == 0 { [&[0][..], &own].concat() } else { own };
        let bounds = metadata.level_bounds(number);
        let parts = own.iter().filter_map(|part| metadata.part(*part).cloned());
        let parts: Vec<_> = parts.map(|part| LevelMetadata { bounds: None, ..part }).collect();
        self.levels = own.iter().filter_map(|part| self.levels.get(*part).cloned()).collect();
        let metadata = &mut self.metadata;
        (metadata.levels, metadata.bounds) = (parts, bounds);
        metadata.shells.clear();
        self.finest = self.finest.saturating_sub(number).min(self.levels.len().saturating_sub(1));
        // Densities of a shell are over twice the interval of the next smaller box.
        let longer = libm::ldexpf(1.0, i32::try_from(number).unwrap_or(0));
        metadata.activation.interval *= longer;
        metadata.march.voxel_size *= longer;
        metadata.march.voxel = metadata.march.voxel.map(|edges| edges.map(|edge| edge * longer));
        if number > 0 {
            (metadata.free_space, self.free_space) = (false, None);
        }
        let sampled = metadata.march.sampled.and_then(|sampled| sampled.common(&metadata.bounds));
        metadata.march.sampled = sampled.filter(|sampled| *sampled != metadata.bounds);
        self
    }

    /// Refuses levels whose tables or codes do not fit the metadata. The metadata itself is checked
    /// elsewhere.
    ///
    /// # Errors
    /// `Malformed`, with the level as its place.
    pub fn check(&self) -> Result<()> {
        let refuse = |key: String, found: &str, expected: &str| {
            Err(Error::malformed(Place::Key(key), found, expected))
        };
        let parts = self.metadata.parts().count();
        if self.levels.len() != parts || self.finest >= self.metadata.levels.len() {
            return refuse(
                "levels".to_owned(),
                "another number of levels",
                "those of the metadata",
            );
        }
        for (number, (level, metadata)) in self.levels.iter().zip(self.metadata.parts()).enumerate()
        {
            let key = || format!("levels[{number}]");
            if level.table.grid() != metadata.grid() {
                return refuse(key(), "a table of other blocks", "those of the metadata");
            }
            for (group, codes) in Group::ALL.into_iter().zip(&level.atlases) {
                let channels = group.channels(self.metadata.layout());
                let count = level.table.frames() * channels * metadata.grid().block_nodes();
                let fits = match (metadata.encoding(group), codes) {
                    (Some(encoding), Some(codes)) => codes.fit(encoding.number, count),
                    (None, None) => true,
                    _ => false,
                };
                if !fits {
                    let found = format!("codes of {} that do not fit", group.name());
                    return refuse(key(), &found, "those of the metadata's encoding and blocks");
                }
            }
        }
        if let Some(network) = &self.view_mlp {
            network.check(self.metadata.features, &Place::Key("view network".to_owned()))?;
        }
        self.free_space.as_ref().map_or(Ok(()), FreeSpace::check)
    }
}

/// One level's codes.
#[derive(Debug, Clone, PartialEq)]
pub struct BakedLevel {
    /// The indirection table.
    pub table: Table,
    /// Codes by [`Group`]; `None` where the level has no such values.
    pub atlases: [Option<Codes>; GROUPS],
}
