//! What each group of each level holds, lowest to highest, and encodings for just that.

use crate::baked::{Encoding, Group, LevelMetadata};
use crate::error::{Error, Result};
use crate::field::Activation;
use crate::grid::{NodeMask, mask};
use crate::mips::Slab;
use crate::parallel;
use crate::quantize::{ValueSpan, encoding_within};

/// What `--max-error` can be: below, hardly anything but f32 keeps it; above, nothing can be told.
const MAX_ERRORS: std::ops::RangeInclusive<f32> = 1e-6..=0.25;

/// Refuses errors that nobody can ask for.
pub fn check_max_error(max_error: Option<f32>) -> Result<()> {
    match max_error.is_none_or(|error| MAX_ERRORS.contains(&error)) {
        true => Ok(()),
        false => Err(Error::usage("--max-error must be from 1e-6 to 0.25")),
    }
}

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
                    mask::for_each_run(needed.row(slab.first + i, y), |start, end| {
                        span.take(&row[start..end]);
                    });
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
    max_error: f32,
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
            .map(|(decode, span)| encoding_within(max_error, decode, activation, span)))
    })?;
    Ok(found.as_chunks().0.to_vec())
}
