//! The value range of each group of each level, and the encodings that follow from it.

use std::sync::{Mutex, PoisonError};

use super::MaxErrors;
use super::level_source::LevelSource;
use super::plan::activation_of;
use crate::base::error::Result;
use crate::base::lock::lock;
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::levels::{Plane, PlaneSink, ReadSummary};
use crate::model::baked::{Encoding, GROUPS, Group, Metadata};
use crate::model::field::Activation;
use crate::model::grid::{NodeMask, row};
use crate::quantize::{
    Bits, ValueRange, encoding_over, encoding_within, is_laid_over_values, planned_encoding,
};

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
    /// Encodings of this many bits, for groups whose encodings follow the range of values. Others
    /// stay.
    Laid(Bits),
    /// Encodings of as many bits as before, for rotated coefficients of functions of the view
    /// direction. Others stay.
    Directional,
}

impl EncodingChoice {
    /// The encoding for values in `range`; none if the planned one stays.
    fn encoding(
        self,
        planned: &Encoding,
        (level, group): (usize, Group),
        activation: &Activation,
        range: &ValueRange,
    ) -> Option<Encoding> {
        match self {
            Self::Within { max_errors, only_fewer } => {
                let error = max_errors.of_level(level).of(group);
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
            Self::Directional => group
                .is_directional()
                .then(|| encoding_over(Bits::of(planned), planned.decode, activation, range)),
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
        let levels =
            metadata.parts().zip(retained).enumerate().map(|(part, (level, &retained))| {
                let activation = activation_of(metadata, part);
                let range =
                    |encoding: &Encoding| Mutex::new(ValueRange::new(encoding.decode, &activation));
                let present =
                    Group::ALL.into_iter().filter(|&group| level.encoding(group).is_some());
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

    /// Takes the values of one plane at the nodes in `counted`.
    fn take(&self, plane: &Plane, counted: &NodeMask) {
        let Plane { level, x, channel, values } = plane;
        let LevelRanges { ranges, groups, .. } = &self.levels[*level];
        let Some(range) = &ranges[groups[*channel].index()] else { return };
        let mut own = *lock(range);
        for (y, row) in values.chunks_exact(counted.nodes().0[2]).enumerate() {
            for (start, end) in row::runs(counted.row(*x, y)) {
                own.take(&row[start..end]);
            }
        }
        lock(range).join(&own);
    }

    /// Gives coarser levels the ranges that means of level 0's values can have.
    fn take_means(&mut self) {
        let Some((finest, coarser)) = self.levels.split_first_mut() else { return };
        let unlocked = |range: &mut Mutex<ValueRange>| {
            *range.get_mut().unwrap_or_else(PoisonError::into_inner)
        };
        for level in coarser {
            for (range, finest) in level.ranges.iter_mut().zip(&mut finest.ranges) {
                if let (Some(range), Some(finest)) = (range, finest) {
                    let finest = unlocked(finest);
                    range.get_mut().unwrap_or_else(PoisonError::into_inner).take_means(&finest);
                }
            }
        }
    }

    /// The ranges of values whose encodings follow them: from level 0 alone if coarser levels are
    /// means of it, else from all levels of `source`.
    pub fn read(
        metadata: &Metadata,
        retained: &[&'a NodeMask],
        choice: EncodingChoice,
        source: &dyn LevelSource,
        progress: &dyn Progress,
    ) -> Result<(Self, ReadSummary)> {
        let mut sink = Self::new(metadata, retained);
        if let EncodingChoice::Laid(_) = choice {
            let see = |plane: Plane, counted: &NodeMask| sink.take(&plane, counted);
            if let Some(summary) = source.read_finest(&see, Step::Ranges, progress)? {
                sink.take_means();
                return Ok((sink, summary));
            }
        }
        let summary = source.stream(&sink, Step::Ranges, progress)?;
        Ok((sink, summary))
    }

    /// Replaces the encodings of the metadata's levels by the chosen ones.
    pub fn choose_encodings(self, choice: EncodingChoice, metadata: &mut Metadata) -> Result<()> {
        let parts = metadata.parts().count();
        let own = |part| (metadata.level_of_part(part), activation_of(metadata, part));
        let own: Vec<_> = (0..parts).map(own).collect();
        let mut tasks: Vec<(&mut Encoding, ValueRange, (usize, Group))> = Vec::new();
        let levels = metadata.parts_mut().zip(self.levels).enumerate();
        for (part, (level, ranges)) in levels {
            let mut ranges = Group::ALL.into_iter().zip(ranges.ranges);
            for (group, encoding) in level.encodings_mut() {
                let own = ranges.find(|(other, _)| *other == group);
                if let Some(range) = own.and_then(|(_, range)| range) {
                    let range = range.into_inner().unwrap_or_else(PoisonError::into_inner);
                    tasks.push((encoding, range, (part, group)));
                }
            }
        }
        parallel::map_mut(&mut tasks, |_, (encoding, range, (part, group))| {
            let (level, activation) = &own[*part];
            if let Some(found) = choice.encoding(encoding, (*level, *group), activation, range) {
                **encoding = found;
            }
            Ok(())
        })?;
        Ok(())
    }
}

impl PlaneSink for RangeSink<'_> {
    fn plane(&self, plane: Plane) -> Result<()> {
        self.take(&plane, self.levels[plane.level].retained);
        Ok(())
    }
}
