//! Level 0 on its way up: density becomes alpha, colours are multiplied by their visible alpha.

use std::ops::Range;

use super::AlphaDomain;
use super::alpha::{premultiply_colors, premultiply_logits};
use super::visibility::VisibilitySampler;
use crate::model::field::ColorDomain;
use crate::model::grid::{NodeMask, row};

/// Shorter gaps between required nodes are computed too: splitting the loop costs more.
const BRIDGED_NODES: usize = 32;

/// Some rows of one plane of level 0.
pub(super) struct RowBand<'a> {
    /// The nodes that are required; the others become 0.
    pub required: &'a NodeMask,
    /// The plane's number.
    pub x: usize,
    /// The rows' numbers.
    pub rows: Range<usize>,
}

impl RowBand<'_> {
    /// Raw densities to alpha; both are whole planes.
    pub fn density_to_alpha(&self, domain: &AlphaDomain, density: &[f32], alpha: &mut [f32]) {
        self.fill(alpha, |span, alpha| domain.density_to_alpha(&density[span], alpha));
    }

    /// Alpha times visibility; both are whole planes.
    pub fn attenuate(&self, sampler: &VisibilitySampler, alpha: &[f32], visible: &mut [f32]) {
        self.fill(visible, |span, visible| sampler.attenuate(span.start, &alpha[span], visible));
    }

    /// Raw colours, activated and multiplied by weights; all are whole planes.
    pub fn premultiply(
        &self,
        colors: ColorDomain,
        raw: &[f32],
        weights: &[f32],
        premultiplied: &mut [f32],
    ) {
        let premultiply = match colors {
            ColorDomain::Logit => premultiply_logits,
            ColorDomain::Linear => premultiply_colors,
        };
        self.fill(premultiplied, |span, premultiplied| {
            premultiply(&raw[span.clone()], &weights[span], premultiplied);
        });
    }

    /// Calls `fill` with ranges of nodes, each in one row, that cover the required nodes, and with
    /// their part of `plane`. Other nodes become 0.
    fn fill(&self, plane: &mut [f32], mut fill: impl FnMut(Range<usize>, &mut [f32])) {
        let nz = self.required.nodes().0[2];
        for y in self.rows.clone() {
            let (row, plane) = (self.required.row(self.x, y), &mut plane[y * nz..][..nz]);
            for (start, end) in row::spans(row, nz, BRIDGED_NODES) {
                fill(y * nz + start..y * nz + end, &mut plane[start..end]);
            }
            for (start, end) in row::gaps(row, nz) {
                plane[start..end].fill(0.0);
            }
        }
    }
}
