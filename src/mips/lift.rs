//! What goes up from level 0 to coarser levels.

use super::{Matter, Visibility};
use crate::error::Result;
use crate::grid::Nodes;
use crate::parallel;

/// What goes up from level 0 to coarser levels.
#[derive(Debug, Clone)]
pub enum Lift<'a> {
    /// These channels, as they are.
    Raw(std::ops::Range<usize>),
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

/// Planes on their way up, by channel.
pub(super) enum Lifted {
    AsTheyAre(std::ops::Range<usize>),
    Weighted {
        /// By plane: amounts, and where there are colours how much of them is seen.
        weights: Vec<(Vec<f32>, Option<Vec<f32>>)>,
        colors: usize,
        matter: Matter,
    },
}

impl Lifted {
    /// What goes up of the level-0 `planes` of `nodes`, with `channels` a plane, from plane `start` on.
    pub(super) fn new(
        lift: &Lift,
        nodes: Nodes,
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
        let length = nodes.0[1] * nodes.0[2];
        let mut weights: Vec<_> = (0..planes.len() / channels)
            .map(|_| {
                let seen = visibility.map(|_| spare_plane(spare, length));
                (spare_plane(spare, length), seen)
            })
            .collect();
        parallel::map_mut(&mut weights, |i, (amounts, seen)| {
            matter.lift_density(&planes[i * channels], amounts);
            if let (Some(seen), Some(visibility)) = (seen, visibility) {
                seen.copy_from_slice(amounts);
                visibility.weigh(nodes, start + i, seen);
            }
            Ok(())
        })?;
        Ok(Self::Weighted { weights, colors: channels - 1, matter })
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

    /// A plane for weighted colours, where there will be some.
    pub(super) fn scratch(&self, spare: &mut Vec<Vec<f32>>, length: usize) -> Vec<f32> {
        match self {
            Self::AsTheyAre(_) => Vec::new(),
            Self::Weighted { .. } => spare_plane(spare, length),
        }
    }

    /// One channel of plane `i`, whose own channels are `planes`.
    pub(super) fn plane<'p>(
        &'p self,
        i: usize,
        channel: usize,
        planes: &'p [Vec<f32>],
        scratch: &'p mut [f32],
    ) -> &'p [f32] {
        match self {
            Self::AsTheyAre(range) => &planes[range.start + channel],
            Self::Weighted { weights, matter, .. } => match (channel, &weights[i]) {
                (0, (amounts, _)) | (_, (amounts, None)) => amounts,
                (1, (_, Some(seen))) => seen,
                (_, (_, Some(seen))) => {
                    matter.lift_color(&planes[channel - 1], seen, scratch);
                    scratch
                }
            },
        }
    }

    /// Gives its planes back.
    pub(super) fn retire(self, spare: &mut Vec<Vec<f32>>) {
        if let Self::Weighted { weights, .. } = self {
            for (amounts, seen) in weights {
                spare.push(amounts);
                spare.extend(seen);
            }
        }
    }
}

/// A plane to be written, used before where there is one.
pub(super) fn spare_plane(spare: &mut Vec<Vec<f32>>, length: usize) -> Vec<f32> {
    let fits = spare.iter().rposition(|plane| plane.capacity() >= length);
    let mut plane = fits.map(|i| spare.swap_remove(i)).unwrap_or_default();
    plane.resize(length, 0.0);
    plane
}
