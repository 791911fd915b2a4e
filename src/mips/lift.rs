//! What goes up from level 0 to coarser levels.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use super::{Matter, Visibility};
use crate::error::Result;
use crate::grid::{NodeMask, row};
use crate::parallel;

/// What goes up from level 0 to coarser levels.
#[derive(Debug, Clone)]
pub enum Lift<'a> {
    /// These channels, as they are.
    Raw(Range<usize>),
    /// The matter of density, the only channel.
    Amounts(Matter),
    /// The matter of density, the first channel; how much of it is seen; all colours, weighted by that.
    Seen(Matter, &'a Visibility),
}

impl<'a> Lift<'a> {
    /// For levels of matter, or of raw values, with or without density, of a field of `channels`.
    pub fn of_levels(
        matter: Option<(Matter, &'a Visibility)>,
        density: bool,
        channels: usize,
    ) -> Self {
        match matter {
            Some((matter, visibility)) => Self::Seen(matter, visibility),
            None => Self::Raw(usize::from(!density)..channels),
        }
    }

    /// Channels of coarser levels where level 0 has `channels`.
    pub(super) fn count(&self, channels: usize) -> usize {
        match self {
            Self::Raw(range) => range.len(),
            Self::Amounts(_) => 1,
            Self::Seen(..) => channels + 1,
        }
    }
}

/// Nodes that do not go up, but fewer than these in a row are lifted too: stopping costs more.
const GAP: usize = 32;

/// Planes on their way up, by channel. Only what lies in a region is lifted.
pub(super) enum Lifted<'a> {
    AsTheyAre(Range<usize>),
    Weighted {
        /// By plane: amounts, and where there are colours how much of them is seen.
        weights: Vec<(Vec<f32>, Option<Vec<f32>>)>,
        colors: usize,
        matter: Matter,
        region: &'a NodeMask,
        /// Planes for weighted colours, as many as there are at once.
        scratch: Mutex<Vec<Vec<f32>>>,
    },
}

impl<'a> Lifted<'a> {
    /// What goes up of the level-0 `planes`, with `channels` a plane, from plane `start` on.
    pub(super) fn new(
        lift: &Lift,
        region: &'a NodeMask,
        start: usize,
        planes: &[Vec<f32>],
        channels: usize,
        spare: &mut Vec<Vec<f32>>,
    ) -> Result<Self> {
        let (matter, visibility) = match lift {
            Lift::Raw(range) => return Ok(Self::AsTheyAre(range.clone())),
            Lift::Amounts(matter) => (*matter, None),
            Lift::Seen(matter, visibility) => (*matter, Some(*visibility)),
        };
        let [_, ny, nz] = region.nodes().0;
        let mut weights: Vec<_> = (0..planes.len() / channels)
            .map(|_| {
                let seen = visibility.map(|_| spare_plane(spare, ny * nz));
                (spare_plane(spare, ny * nz), seen)
            })
            .collect();
        parallel::map_mut(&mut weights, |i, (amounts, seen)| {
            let density = &planes[i * channels];
            for_each_span(region, start + i, |span| {
                matter.lift_density(&density[span.clone()], &mut amounts[span]);
            });
            if let (Some(seen), Some(visibility)) = (seen, visibility) {
                let weigher = visibility.weigher(region.nodes(), start + i);
                for_each_span(region, start + i, |span| {
                    weigher.weigh(span.start, &amounts[span.clone()], &mut seen[span]);
                });
            }
            Ok(())
        })?;
        let scratch = spare.extract_if(.., |plane| plane.len() == ny * nz).collect();
        let scratch = Mutex::new(scratch);
        Ok(Self::Weighted { weights, colors: channels - 1, matter, region, scratch })
    }

    pub(super) fn channels(&self) -> usize {
        match self {
            Self::AsTheyAre(range) => range.len(),
            Self::Weighted { weights, colors, .. } => {
                let seen = weights.iter().any(|(_, seen)| seen.is_some());
                if seen { 2 + colors } else { 1 }
            }
        }
    }

    /// Calls `visit` with one channel of plane `x`, the `i`th, whose own channels are `planes`.
    pub(super) fn with_plane(
        &self,
        x: usize,
        i: usize,
        channel: usize,
        planes: &[Vec<f32>],
        visit: impl FnOnce(&[f32]),
    ) {
        match self {
            Self::AsTheyAre(range) => visit(&planes[range.start + channel]),
            Self::Weighted { weights, matter, region, scratch, .. } => match (channel, &weights[i])
            {
                (0, (amounts, _)) | (_, (amounts, None)) => visit(amounts),
                (1, (_, Some(seen))) => visit(seen),
                (_, (_, Some(seen))) => {
                    let raw = &planes[channel - 1];
                    let scratch = || scratch.lock().unwrap_or_else(PoisonError::into_inner);
                    let used = scratch().pop();
                    let mut weighted = used.unwrap_or_else(|| vec![0.0; raw.len()]);
                    for_each_span(region, x, |span| {
                        let weighted = &mut weighted[span.clone()];
                        matter.lift_color(&raw[span.clone()], &seen[span], weighted);
                    });
                    visit(&weighted);
                    scratch().push(weighted);
                }
            },
        }
    }

    /// Gives its planes back.
    pub(super) fn retire(self, spare: &mut Vec<Vec<f32>>) {
        if let Self::Weighted { weights, scratch, .. } = self {
            spare.extend(scratch.into_inner().unwrap_or_else(PoisonError::into_inner));
            for (amounts, seen) in weights {
                spare.push(amounts);
                spare.extend(seen);
            }
        }
    }
}

/// Calls `visit` with ranges of nodes of plane `x`, each in one row, that cover the region.
fn for_each_span(region: &NodeMask, x: usize, mut visit: impl FnMut(Range<usize>)) {
    let [_, ny, nz] = region.nodes().0;
    for y in 0..ny {
        row::for_each_span(region.row(x, y), GAP, |start, end| {
            visit(y * nz + start..y * nz + end);
        });
    }
}

/// A plane to be written, used before where there is one.
pub(super) fn spare_plane(spare: &mut Vec<Vec<f32>>, length: usize) -> Vec<f32> {
    match spare.iter().rposition(|plane| plane.len() == length) {
        Some(i) => spare.swap_remove(i),
        None => vec![0.0; length],
    }
}
