//! Converts premultiplied planes of a coarser level to stored values.
//!
//! ```text
//! color = (c + 1e-4 * sum of c around) / (w + 1e-4 * sum of w around)
//! ```
//!
//! with the premultiplied colour `c`, its weight `w`, and sums over the 3 x 3 x 3 nodes around. So
//! finishing a plane needs the next one: planes wait for their slab and the first plane of the next
//! slab. [`super::direction`] needs the same planes.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, Mutex};

use multiversion::multiversion;

use super::brightness::MOMENTS;
use super::direction::DirectionPlane;
use super::plane::PlanePool;
use super::{AlphaDomain, Direction, Plane, PlaneSink};
use crate::base::error::Result;
use crate::base::lock::{Locked, lock};
use crate::base::parallel;
use crate::model::activate::lanes;
use crate::model::field::ColorDomain;
use crate::model::grid::{NodeMask, Nodes, row};

/// Stored colours stay this far from 0 and 1: logits of -16 and 16.
const COLOR_MARGIN: f64 = 1e-7;
/// Share of the alpha around a node that counts in its colour. Through interpolation, a node with
/// little alpha still colours the cells around it, and must not make them the grey of empty space.
const NEIGHBOURS_SHARE: f64 = 1e-4;
/// Shorter gaps between retained nodes are computed too, because splitting the loop costs more.
const BRIDGED_NODES: usize = 16;

/// Finishes the planes of one coarser level, slab by slab.
#[derive(Debug)]
pub(super) struct LevelFinisher<'a> {
    level: usize,
    domain: AlphaDomain,
    colors: ColorDomain,
    direction: Option<Direction>,
    /// The nodes whose values must be exact; premultiplied values are also exact one node around
    /// them.
    retained: &'a NodeMask,
    /// Channels of a stored plane, without directional terms: density and colours. A premultiplied
    /// plane has alpha, visible alpha, colours, and moments of brightness.
    channels: usize,
    waiting: Mutex<Waiting>,
    pool: PlanePool,
}

/// Premultiplied planes that are still to be read.
#[derive(Debug, Default)]
struct Waiting {
    /// By number and channel.
    planes: BTreeMap<usize, Vec<Arc<Vec<f32>>>>,
    /// A complete slab that waits for the plane after it.
    slab: Option<Range<usize>>,
}

impl<'a> LevelFinisher<'a> {
    /// For the `retained` nodes of a level whose stored planes have this many `channels`.
    pub fn new(
        level: usize,
        (domain, colors, direction): (AlphaDomain, ColorDomain, Option<Direction>),
        channels: usize,
        retained: &'a NodeMask,
    ) -> Self {
        let (waiting, pool) = (Mutex::default(), PlanePool::default());
        Self { level, domain, colors, direction, retained, channels, waiting, pool }
    }

    /// Sums of a plane: alpha, visible alpha, colours, and moments of brightness.
    fn sums(&self) -> usize {
        let has_brightness =
            self.direction.is_some_and(|direction| direction.has_brightness(self.level));
        1 + self.channels + if has_brightness { MOMENTS } else { 0 }
    }

    fn waiting(&self) -> Locked<'_, Waiting> {
        lock(&self.waiting)
    }

    /// Keeps a premultiplied plane, and swaps in another one.
    pub fn keep(&self, x: usize, channel: usize, plane: &mut Vec<f32>) {
        let other = self.pool.take(plane.len());
        let kept = Arc::new(std::mem::replace(plane, other));
        let mut waiting = self.waiting();
        let sums = waiting.planes.entry(x).or_insert_with(|| vec![Arc::default(); self.sums()]);
        sums[channel] = kept;
    }

    /// The sums of a plane that was kept and is still read.
    pub fn kept(&self, x: usize) -> Vec<Arc<Vec<f32>>> {
        self.waiting().planes.get(&x).cloned().unwrap_or_default()
    }

    /// Called when all of these planes were kept; passes finished planes to `sink`.
    pub fn finish(&self, planes: Range<usize>, sink: &dyn PlaneSink) -> Result<()> {
        let before = self.waiting().slab.replace(planes.clone());
        let last = Some(planes).filter(|planes| planes.end == self.retained.nodes().0[0]);
        for planes in before.into_iter().chain(last) {
            parallel::map(planes.len(), |i| self.finish_plane(planes.start + i, sink))?;
            let mut waiting = self.waiting();
            // The slab's last plane is beside the next slab's first.
            let still_read = waiting.planes.split_off(&(planes.end - 1));
            let read = std::mem::replace(&mut waiting.planes, still_read);
            drop(waiting);
            self.pool.give(read.into_values().flatten().filter_map(Arc::into_inner));
            sink.slab(self.level, planes)?;
        }
        Ok(())
    }

    /// Finishes all channels of plane `x`.
    fn finish_plane(&self, x: usize, sink: &dyn PlaneSink) -> Result<()> {
        let Nodes([nx, ny, nz]) = self.retained.nodes();
        let numbers = x.saturating_sub(1)..(x + 2).min(nx);
        let around: Vec<Vec<Arc<Vec<f32>>>> =
            self.waiting().planes.range(numbers).map(|(_, plane)| plane.clone()).collect();
        let own = &around[x.min(1)];
        // The plane below is missing in front of the first one.
        let around_first = x.min(1);
        let unpremultiply = match self.colors {
            ColorDomain::Logit => unpremultiply_to_logits,
            ColorDomain::Linear => unpremultiply_to_colors,
        };
        let mut finished: Vec<_> = (0..self.channels).map(|_| self.pool.take(ny * nz)).collect();
        let nodes = self.retained.nodes();
        let mut direction =
            self.direction.map(|of| DirectionPlane::new(of, self.level, nodes, &self.pool));
        let [mut column, mut weights, mut totals] = [(); 3].map(|()| vec![0.0; nz]);
        let [zeros, mut means] = [(); 2].map(|()| vec![0.0; nz]);
        for y in 0..ny {
            let rows = y.saturating_sub(1)..(y + 2).min(ny);
            let retained = self.retained.row(x, y);
            for (start, end) in row::spans(retained, nz, BRIDGED_NODES) {
                let span = y * nz + start..y * nz + end;
                // Each node's own value of a channel plus a small share of its neighbours' values.
                let mut total = |channel: usize, totals: &mut [f64]| {
                    let [low, high] = [start.saturating_sub(1), (end + 1).min(nz)];
                    let column = &mut column[..high - low];
                    // Rows outside the grid add nothing.
                    let mut nine = [&zeros[low..high]; 9];
                    let places =
                        around.iter().flat_map(|plane| rows.clone().map(move |y| (plane, y)));
                    for (row, (plane, y)) in nine.iter_mut().zip(places) {
                        *row = &plane[channel][y * nz..][low..high];
                    }
                    add_rows(nine, column);
                    let own = &own[channel][span.clone()];
                    add_neighbours(own, column, start - low, &mut totals[..end - start]);
                };
                self.domain.stored(&own[0][span.clone()], &mut finished[0][span.clone()]);
                total(1, &mut weights);
                let means = &mut means[..end - start];
                means.fill(0.0);
                for (channel, finished) in finished.iter_mut().enumerate().skip(1) {
                    total(channel + 1, &mut totals);
                    unpremultiply(&totals, &weights, &mut finished[span.clone()]);
                    if channel <= 3 {
                        add_thirds(&totals, &weights, means);
                    }
                }
                let Some(direction) = &mut direction else { continue };
                direction.fill_brightness(own, span.clone(), means);
                let alpha_row = |x: usize, y: usize| {
                    let inside = y.checked_sub(1).filter(|&y| y < ny);
                    let plane = (x + around_first).checked_sub(1).and_then(|x| around.get(x));
                    plane.zip(inside).map(|(plane, y)| &plane[0][y * nz..(y + 1) * nz])
                };
                let rows_around = [0, 1, 2].map(|dx| [0, 1, 2].map(|dy| alpha_row(dx, y + dy)));
                let density = &finished[0][span.clone()];
                direction.fill_anisotropy(&rows_around, span, (start, end), density, retained);
            }
        }
        finished.extend(direction.into_iter().flat_map(DirectionPlane::into_planes));
        for (channel, values) in finished.iter_mut().enumerate() {
            sink.plane(Plane { level: self.level, x, channel, values })?;
        }
        self.pool.give(finished);
        Ok(())
    }
}

/// The sums of nine rows.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn add_rows(rows: [&[f32]; 9], sums: &mut [f64]) {
    let rows = rows.map(|row| &row[..sums.len()]);
    for (i, sum) in sums.iter_mut().enumerate() {
        *sum = rows.iter().fold(0.0, |sum, row| sum + f64::from(row[i]));
    }
}

/// `own` plus a share of the `column` sums around each value; `column[first]` belongs to the first
/// value.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn add_neighbours(own: &[f32], column: &[f64], first: usize, totals: &mut [f64]) {
    for ((total, &own), &column) in totals.iter_mut().zip(own).zip(&column[first..]) {
        *total = f64::from(own) + NEIGHBOURS_SHARE * column;
    }
    let after = column.get(first + 1..).unwrap_or_default();
    for (total, &column) in totals.iter_mut().zip(after) {
        *total += NEIGHBOURS_SHARE * column;
    }
    let before = totals.get_mut(1 - first..).unwrap_or_default();
    for (total, &column) in before.iter_mut().zip(column) {
        *total += NEIGHBOURS_SHARE * column;
    }
}

/// Adds a third of premultiplied colours divided by their weights.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn add_thirds(totals: &[f64], weights: &[f64], means: &mut [f32]) {
    for ((mean, total), weight) in means.iter_mut().zip(totals).zip(weights) {
        *mean += (total / (3.0 * weight.max(f64::MIN_POSITIVE))) as f32;
    }
}

/// Premultiplied colours divided by their weights.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn unpremultiply_to_colors(totals: &[f64], weights: &[f64], colors: &mut [f32]) {
    for ((color, total), weight) in colors.iter_mut().zip(totals).zip(weights) {
        *color = (total / weight.max(f64::MIN_POSITIVE)) as f32;
    }
}

/// Logits of premultiplied colours divided by their weights.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn unpremultiply_to_logits(totals: &[f64], weights: &[f64], logits: &mut [f32]) {
    for ((logit, total), weight) in logits.iter_mut().zip(totals).zip(weights) {
        let color = total / weight.max(f64::MIN_POSITIVE);
        let color = color.clamp(COLOR_MARGIN, 1.0 - COLOR_MARGIN);
        *logit = lanes::ln(color / (1.0 - color)) as f32;
    }
}
