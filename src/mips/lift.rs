//! What goes up from level 0 to coarser levels.

use std::ops::Range;

use super::{Matter, Visibility};
use crate::grid::{NodeMask, row};

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

    /// How many planes of weights there are: amounts, and where there are colours how much of them is seen.
    pub(super) fn weights(&self) -> usize {
        match self {
            Self::Raw(_) => 0,
            Self::Amounts(_) => 1,
            Self::Seen(..) => 2,
        }
    }

    /// Fills planes of weights for plane `x` of density: what lies outside the region weighs 0.
    pub(super) fn weigh(
        &self,
        region: &NodeMask,
        x: usize,
        density: &[f32],
        weights: &mut [Vec<f32>],
    ) {
        if let (Self::Amounts(matter) | Self::Seen(matter, _), [amounts, ..]) =
            (self, &mut *weights)
        {
            fill_region(region, x, amounts, |span, amounts| {
                matter.lift_density(&density[span], amounts);
            });
        }
        if let (Self::Seen(_, visibility), [amounts, seen]) = (self, weights) {
            let weigher = visibility.weigher(region.nodes(), x);
            fill_region(region, x, seen, |span, seen| {
                weigher.weigh(span.start, &amounts[span], seen);
            });
        }
    }

    /// Fills a plane with colours of plane `x`, multiplied by how much of them is `seen`.
    pub(super) fn lift_color(
        &self,
        region: &NodeMask,
        x: usize,
        raw: &[f32],
        seen: &[f32],
        weighted: &mut [f32],
    ) {
        if let Self::Seen(matter, _) = self {
            fill_region(region, x, weighted, |span, weighted| {
                matter.lift_color(&raw[span.clone()], &seen[span], weighted);
            });
        }
    }
}

/// Nodes that do not go up, but fewer than these in a row are lifted too: stopping costs more.
const GAP: usize = 32;

/// Calls `fill` with ranges of nodes of plane `x`, each in one row, that cover the region, and their part of `plane`;
/// what lies outside the region becomes 0.
fn fill_region(
    region: &NodeMask,
    x: usize,
    plane: &mut [f32],
    mut fill: impl FnMut(Range<usize>, &mut [f32]),
) {
    let nz = region.nodes().0[2];
    for (y, plane) in plane.chunks_exact_mut(nz).enumerate() {
        let row = region.row(x, y);
        for (start, end) in row::spans(row, nz, GAP) {
            fill(y * nz + start..y * nz + end, &mut plane[start..end]);
        }
        for (start, end) in row::gaps(row, nz) {
            plane[start..end].fill(0.0);
        }
    }
}
