//! What goes up from level 0 to coarser levels.

use std::ops::Range;

use super::visibility::Weigher;
use super::{Matter, Visibility};
use crate::model::grid::{NodeMask, row};

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

/// A part of a plane of level 0 that goes up.
pub(super) struct Part<'a> {
    /// What must come out right; the rest goes up as 0.
    pub region: &'a NodeMask,
    /// The plane's number.
    pub x: usize,
    /// Rows.
    pub rows: Range<usize>,
}

impl Part<'_> {
    /// Amounts of a plane of density.
    pub fn weigh(&self, matter: &Matter, density: &[f32], amounts: &mut [f32]) {
        self.fill(amounts, |span, amounts| matter.lift_density(&density[span], amounts));
    }

    /// How much of a plane of amounts is seen.
    pub fn see(&self, weigher: &Weigher, amounts: &[f32], seen: &mut [f32]) {
        self.fill(seen, |span, seen| weigher.weigh(span.start, &amounts[span], seen));
    }

    /// A plane of colours, multiplied by how much of them is seen.
    pub fn color(&self, matter: &Matter, raw: &[f32], seen: &[f32], weighted: &mut [f32]) {
        self.fill(weighted, |span, weighted| {
            matter.lift_color(&raw[span.clone()], &seen[span], weighted);
        });
    }

    /// Calls `fill` with ranges of nodes, each in one row, that cover the region, and their part of `plane`.
    fn fill(&self, plane: &mut [f32], mut fill: impl FnMut(Range<usize>, &mut [f32])) {
        let nz = self.region.nodes().0[2];
        for y in self.rows.clone() {
            let (row, plane) = (self.region.row(self.x, y), &mut plane[y * nz..][..nz]);
            for (start, end) in row::spans(row, nz, GAP) {
                fill(y * nz + start..y * nz + end, &mut plane[start..end]);
            }
            for (start, end) in row::gaps(row, nz) {
                plane[start..end].fill(0.0);
            }
        }
    }
}

/// Nodes that do not go up, but fewer than these in a row are lifted too: stopping costs more.
const GAP: usize = 32;
