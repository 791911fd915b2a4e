//! The value range of each group of each level, and the encodings that follow from it.

use std::sync::{Mutex, PoisonError};

use super::MaxErrors;
use crate::base::error::Result;
use crate::base::parallel;
use crate::codec::quantize::{
    Bits, ValueRange, encoding_over, encoding_within, is_laid_over_values, planned_encoding,
};
use crate::levels::{Plane, PlaneSink};
use crate::model::baked::{Encoding, GROUPS, Group, Metadata};
use crate::model::field::Activation;
use crate::model::grid::{NodeMask, row};

/// The encodings that follow from the values' ranges.
#[derive(Debug, Clone, Copy)]
pub enum EncodingChoice {
    /// Those with the fewest bits.
    Within {
        /// The errors to keep.
        max_errors: MaxErrors,
        /// True if a planned encoding stays unless the search finds one with fewer bits.
        only_fewer: bool,
    },
    /// Those of so many bits, for values that are laid over their range. Others stay.
    Laid(Bits),
}

impl EncodingChoice {
    /// The encoding of values in `range`; none where the planned one stays.
    fn encoding(
        self,
        planned: &Encoding,
        group: Group,
        activation: &Activation,
        range: &ValueRange,
    ) -> Option<Encoding> {
        match self {
            Self::Within { max_errors, only_fewer } => {
                let error = max_errors.of(group);
                let found = encoding_within(error, planned.decode, activation, range);
                (!only_fewer || found.bits < planned.bits).then_some(found)
            }
            Self::Laid(bits) => {
                let decode = planned.decode;
                // Encodings that others laid stay.
                let is_open = is_laid_over_values(decode, activation)
                    && *planned == planned_encoding(bits, decode, activation);
                is_open.then(|| encoding_over(bits, decode, activation, range))
            }
        }
    }
}

/// Collects the ranges of all levels.
pub struct RangeSink<'a> {
    levels: Vec<LevelRanges<'a>>,
}

/// The ranges of one level.
struct LevelRanges<'a> {
    retained: &'a NodeMask,
    /// By [`Group`].
    ranges: [Option<Mutex<ValueRange>>; GROUPS],
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
                |group: Group| std::iter::repeat_n(group, group.channels(metadata.layout()));
            LevelRanges {
                retained,
                ranges: Group::ALL.map(|group| level.encoding(group).map(range)),
                groups: present.flat_map(channels).collect(),
            }
        });
        Self { levels: levels.collect() }
    }

    /// Replaces the encodings of the metadata's levels by those that are chosen.
    pub fn choose_encodings(self, choice: EncodingChoice, metadata: &mut Metadata) -> Result<()> {
        let activation = metadata.activation;
        let mut tasks: Vec<(&mut Encoding, ValueRange, Group)> = Vec::new();
        for (level, ranges) in metadata.levels.iter_mut().zip(self.levels) {
            let mut ranges = Group::ALL.into_iter().zip(ranges.ranges);
            for (group, encoding) in level.encodings_mut() {
                let own = ranges.find(|(other, _)| *other == group);
                if let Some(range) = own.and_then(|(_, range)| range) {
                    let range = range.into_inner().unwrap_or_else(PoisonError::into_inner);
                    tasks.push((encoding, range, group));
                }
            }
        }
        parallel::map_mut(&mut tasks, |_, (encoding, range, group)| {
            if let Some(found) = choice.encoding(encoding, *group, &activation, range) {
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
        let Some(range) = &ranges[groups[channel].index()] else { return Ok(()) };
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
