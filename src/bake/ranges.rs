//! What each group of each level holds, lowest to highest, and encodings for just that.

use super::MaxErrors;
use crate::baked::{Encoding, Group, LevelMetadata};
use crate::error::Result;
use crate::field::Activation;
use crate::grid::{NodeMask, row};
use crate::mips::Slab;
use crate::parallel;
use crate::quantize::{ValueSpan, encoding_within};

/// The values of one level.
#[derive(Debug)]
pub struct LevelSpans {
    /// By [`Group`].
    spans: [Option<ValueSpan>; 3],
    /// Specular features of a node.
    features: usize,
}

impl LevelSpans {
    /// Of no values yet: those of the groups that `level` has, by what they mean.
    pub fn new(level: &LevelMetadata, activation: &Activation, features: usize) -> Self {
        let span = |encoding: &Encoding| ValueSpan::new(encoding.decode, activation);
        Self { spans: Group::ALL.map(|group| level.encoding(group).map(span)), features }
    }

    /// Takes the needed nodes of a slab, whose channels are those of the level's groups in order.
    pub fn take(&mut self, slab: &Slab, needed: &NodeMask) -> Result<()> {
        let mut first_channel = 0;
        let nz = needed.nodes().0[2];
        for (group, span) in Group::ALL.into_iter().zip(&mut self.spans) {
            let Some(span) = span else { continue };
            let channels = group.channels(self.features);
            let of_plane = |i: usize, channel: usize| {
                let mut span = *span;
                for (y, row) in slab.plane(i, first_channel + channel).chunks_exact(nz).enumerate()
                {
                    for (start, end) in row::runs(needed.row(slab.first + i, y)) {
                        span.take(&row[start..end]);
                    }
                }
                Ok(span)
            };
            let found =
                parallel::map(slab.count() * channels, |i| of_plane(i / channels, i % channels))?;
            found.iter().for_each(|found| span.join(found));
            first_channel += channels;
        }
        Ok(())
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
        Ok(decode
            .zip(span.as_ref())
            .map(|(decode, span)| encoding_within(max_errors.of(group), decode, activation, span)))
    })?;
    Ok(found.as_chunks().0.to_vec())
}
