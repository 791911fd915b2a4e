//! Level 0 on its way up: density becomes alpha, colours are multiplied by their visible alpha.

use std::ops::Range;

use super::AlphaDomain;
use super::alpha::{mean_colors, premultiply_colors, premultiply_logits};
use super::visibility::PlaneSampler;
use crate::model::field::ColorDomain;
use crate::model::grid::{NodeMask, row};

/// Shorter gaps between required nodes are computed too, because splitting the loop costs more.
const BRIDGED_NODES: usize = 32;

/// Some rows of one plane of level 0.
pub(super) struct RowBand<'a> {
    /// The nodes that are required; the others count as 0.
    pub required: &'a NodeMask,
    /// For each row of the plane, the nodes along z that are read; others have unspecified values.
    pub read: &'a [Range<usize>],
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

    /// Alpha times the numbers of `sampler`; all are whole planes.
    pub fn multiply(&self, sampler: &PlaneSampler, alpha: &[f32], products: &mut [f32]) {
        self.fill(products, |span, products| sampler.multiply(span.start, &alpha[span], products));
    }

    /// Means of three premultiplied channels over their weights; all are whole planes.
    pub fn mean_color(&self, premultiplied: [&[f32]; 3], weights: &[f32], means: &mut [f32]) {
        let [red, green, blue] = premultiplied;
        self.fill(means, |span, means| {
            let colors = [&red[span.clone()], &green[span.clone()], &blue[span.clone()]];
            mean_colors(colors, &weights[span], means);
        });
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

    /// Calls `fill` with ranges of nodes, each in one row, that cover the required nodes that are
    /// read, and with their part of `plane`. Sets other nodes that are read to 0.
    fn fill(&self, plane: &mut [f32], mut fill: impl FnMut(Range<usize>, &mut [f32])) {
        let nz = self.required.nodes().0[2];
        for y in self.rows.clone() {
            let Range { start: low, end: high } = self.read[y];
            let (row, plane) = (self.required.row(self.x, y), &mut plane[y * nz..][..nz]);
            let mut done = low;
            let spans = row::spans(row, nz, BRIDGED_NODES);
            for (start, end) in spans.filter(|&(start, end)| start < high && end > low) {
                // Nodes of a span that are not required are 0 too.
                if start > done {
                    plane[done..start].fill(0.0);
                }
                fill(y * nz + start..y * nz + end, &mut plane[start..end]);
                for (start, end) in row::gaps_between(row, start, end) {
                    plane[start..end].fill(0.0);
                }
                done = end;
            }
            if done < high {
                plane[done..high].fill(0.0);
            }
        }
    }
}
