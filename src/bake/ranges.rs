//! The value range of each group of each level, and the encodings with the fewest bits for it.

use std::sync::{Mutex, PoisonError};

use super::MaxErrors;
use crate::base::error::Result;
use crate::base::parallel;
use crate::codec::quantize::{ValueRange, encoding_within};
use crate::levels::{Plane, PlaneSink};
use crate::model::baked::{Encoding, Group, Metadata};
use crate::model::grid::{NodeMask, row};

/// A search for the fewest bits.
#[derive(Debug, Clone, Copy)]
pub struct BitSearch {
    /// The errors to keep.
    pub max_errors: MaxErrors,
    /// True if a planned encoding stays unless the search finds one with fewer bits.
    pub only_fewer: bool,
}

/// Collects the ranges of all levels.
pub struct RangeSink<'a> {
    levels: Vec<LevelRanges<'a>>,
}

/// The ranges of one level.
struct LevelRanges<'a> {
    retained: &'a NodeMask,
    /// By [`Group`].
    ranges: [Option<Mutex<ValueRange>>; 3],
    /// The group of each channel.
    groups: Vec<Group>,
}

impl<'a> RangeSink<'a> {
    /// Of no values yet, for the groups that each level has; `retained` nodes count.
    pub fn new(metadata: &Metadata, retained: &[&'a NodeMask]) -> Self {
        let levels = metadata.levels.iter().zip(retained).map(|(level, &retained)| {
            let range = |encoding: &Encoding| {
                Mutex::new(ValueRange::new(encoding.decode, &metadata.activation))
            };
            let present = Group::ALL.into_iter().filter(|&group| level.encoding(group).is_some());
            let channels =
                |group: Group| std::iter::repeat_n(group, group.channels(metadata.features));
            LevelRanges {
                retained,
                ranges: Group::ALL.map(|group| level.encoding(group).map(range)),
                groups: present.flat_map(channels).collect(),
            }
        });
        Self { levels: levels.collect() }
    }

    /// Replaces the encodings of the metadata's levels by those with the fewest bits.
    pub fn choose_encodings(self, search: BitSearch, metadata: &mut Metadata) -> Result<()> {
        let activation = metadata.activation;
        let mut tasks: Vec<(&mut Encoding, ValueRange, Group)> = Vec::new();
        for (level, ranges) in metadata.levels.iter_mut().zip(self.levels) {
            let present = [&mut level.density, &mut level.diffuse, &mut level.features];
            let present = Group::ALL.into_iter().zip(present).zip(ranges.ranges);
            for ((group, encoding), range) in present {
                if let (Some(encoding), Some(range)) = (encoding, range) {
                    let range = range.into_inner().unwrap_or_else(PoisonError::into_inner);
                    tasks.push((encoding, range, group));
                }
            }
        }
        parallel::map_mut(&mut tasks, |_, (encoding, range, group)| {
            let max_error = search.max_errors.of(*group);
            let found = encoding_within(max_error, encoding.decode, &activation, range);
            if !search.only_fewer || found.bits < encoding.bits {
                **encoding = found;
            }
            Ok(())
        })?;
        Ok(())
    }
}

impl PlaneSink for RangeSink<'_> {
    fn plane(&self, Plane { level, x, channel, values }: Plane) -> Result<()> {
        let LevelRanges { retained, ranges, groups } = &self.levels[level];
        let Some(range) = &ranges[groups[channel] as usize] else { return Ok(()) };
        let mut own = *range.lock().unwrap_or_else(PoisonError::into_inner);
        for (y, row) in values.chunks_exact(retained.nodes().0[2]).enumerate() {
            for (start, end) in row::runs(retained.row(x, y)) {
                own.take(&row[start..end]);
            }
        }
        range.lock().unwrap_or_else(PoisonError::into_inner).join(&own);
        Ok(())
    }
}
