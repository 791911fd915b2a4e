//! What each group of each level holds, lowest to highest, and encodings for just that.

use std::sync::{Mutex, PoisonError};

use super::MaxErrors;
use crate::base::error::Result;
use crate::base::parallel;
use crate::codec::quantize::{ValueRange, encoding_within};
use crate::model::baked::{Encoding, Group, LevelMetadata};
use crate::model::field::Activation;
use crate::model::grid::{NodeMask, row};

/// The values of one level.
#[derive(Debug)]
pub struct LevelSpans<'a> {
    needed: &'a NodeMask,
    /// By [`Group`].
    spans: [Option<Mutex<ValueRange>>; 3],
    /// The group of each channel.
    groups: Vec<Group>,
}

impl<'a> LevelSpans<'a> {
    /// Of no values yet: those of the groups that `level` has, by what they mean.
    pub fn new(
        level: &LevelMetadata,
        needed: &'a NodeMask,
        activation: &Activation,
        features: usize,
    ) -> Self {
        let span = |encoding: &Encoding| Mutex::new(ValueRange::new(encoding.decode, activation));
        let spans = Group::ALL.map(|group| level.encoding(group).map(span));
        let present = Group::ALL.into_iter().filter(|&group| level.encoding(group).is_some());
        let of_group = |group: Group| std::iter::repeat_n(group, group.channels(features));
        Self { needed, spans, groups: present.flat_map(of_group).collect() }
    }

    /// Takes the needed nodes of plane `x` of a channel, counted over the level's groups in order. From any thread.
    pub fn put(&self, x: usize, channel: usize, values: &[f32]) {
        let Some(all) = &self.spans[self.groups[channel] as usize] else { return };
        let mut span = *all.lock().unwrap_or_else(PoisonError::into_inner);
        for (y, row) in values.chunks_exact(self.needed.nodes().0[2]).enumerate() {
            for (start, end) in row::runs(self.needed.row(x, y)) {
                span.take(&row[start..end]);
            }
        }
        all.lock().unwrap_or_else(PoisonError::into_inner).join(&span);
    }
}

/// The encodings with the fewest bits for the values of each level, by [`Group`].
pub fn encodings_within(
    max_errors: MaxErrors,
    levels: &[LevelMetadata],
    activation: &Activation,
    spans: &[LevelSpans],
) -> Result<Vec<[Option<Encoding>; 3]>> {
    let groups = Group::ALL.len();
    let found = parallel::map(levels.len() * groups, |i| {
        let (level, group) = (i / groups, Group::ALL[i % groups]);
        let decode = levels[level].encoding(group).map(|encoding| encoding.decode);
        let span = &spans[level].spans[group as usize];
        Ok(decode.zip(span.as_ref()).map(|(decode, span)| {
            let span = span.lock().unwrap_or_else(PoisonError::into_inner);
            encoding_within(max_errors.of(group), decode, activation, &span)
        }))
    })?;
    Ok(found.as_chunks().0.to_vec())
}
