//! Lifted planes of a level to what is stored of it.
//!
//! A node takes a little of its colour from the nodes around it, so a plane settles once the next one is there: planes
//! wait until their slab and the first plane of the next one have come.

use std::ops::Range;
use std::sync::{Mutex, PoisonError, RwLock};

use multiversion::multiversion;

use super::Matter;
use super::pool::Pool;
use crate::base::error::Result;
use crate::base::parallel;
use crate::model::activate::lanes;
use crate::model::grid::{NodeMask, Nodes, row};

/// Colours settle this far from 0 and 1: logits of -16 and 16.
const LEAST_COLOR: f64 = 1e-7;
/// How much the matter around a node counts in its colour. A node with little matter still colours
/// the cells around it by interpolation, and must not do so with the grey of empty space.
const NEIGHBOURS_SHARE: f64 = 1e-4;
/// Nodes that nobody needs, but fewer than these in a row settle too: stopping costs more.
const GAP: usize = 16;

/// Settles one level's planes, slab by slab.
#[derive(Debug)]
struct Settler<'a> {
    matter: Matter,
    /// The nodes that must come out right; lifted values are right one node around them too.
    needed: &'a NodeMask,
    /// Lifted planes, `[x][channel]`: density, how much of it is seen, and colours weighted by that. Empty before they come,
    /// and when nobody needs them any more.
    lifted: Vec<Vec<RwLock<Vec<f32>>>>,
    /// Planes of a slab that waits for the next one.
    waiting: Mutex<Option<Range<usize>>>,
    pool: Pool,
}

/// Settles the coarser levels of matter; values of others are stored as they come.
#[derive(Debug)]
pub struct Settlers<'a>(Vec<Option<Settler<'a>>>);

impl<'a> Settlers<'a> {
    /// For levels, finest first, given what is `needed` of each, of a field of `channels`.
    pub fn new(
        matter: Option<Matter>,
        channels: usize,
        needed: impl IntoIterator<Item = &'a NodeMask>,
    ) -> Self {
        let settler = |(level, needed)| match matter {
            Some(matter) if level > 0 => Some(Settler::new(matter, channels, needed)),
            _ => None,
        };
        Self(needed.into_iter().enumerate().map(settler).collect())
    }

    /// Takes a plane of a coarser level as a cascade shows it. What is stored as it is goes to `put(level, x, channel, plane)`.
    pub fn pass(
        &self,
        [level, x, channel]: [usize; 3],
        plane: &mut Vec<f32>,
        put: impl Fn(usize, usize, usize, &mut [f32]) -> Result<()>,
    ) -> Result<()> {
        let Some(settler) = &self.0[level] else { return put(level, x, channel, plane) };
        settler.keep(x, channel, plane);
        Ok(())
    }

    /// Is told that planes of a level have gone by. What is settled now goes to `put`, and `take` is told about slabs of
    /// which all has.
    pub fn settle(
        &self,
        level: usize,
        planes: Range<usize>,
        put: impl Fn(usize, usize, usize, &mut [f32]) -> Result<()> + Sync + Send,
        mut take: impl FnMut(Range<usize>) -> Result<()>,
    ) -> Result<()> {
        let Some(settler) = &self.0[level] else { return take(planes) };
        settler.settle(planes, |x, channel, plane| put(level, x, channel, plane), take)
    }
}

impl<'a> Settler<'a> {
    /// For the nodes that are `needed` of a level.
    fn new(matter: Matter, channels: usize, needed: &'a NodeMask) -> Self {
        // One more is what colours are weighted by.
        let of_plane = |_| (0..=channels).map(|_| RwLock::default()).collect();
        let lifted = (0..needed.nodes().0[0]).map(of_plane).collect();
        Self { matter, needed, lifted, waiting: Mutex::default(), pool: Pool::default() }
    }

    /// Keeps a lifted plane, and leaves another.
    fn keep(&self, x: usize, channel: usize, plane: &mut Vec<f32>) {
        let other = self.pool.take(plane.len());
        let mut kept = self.lifted[x][channel].write().unwrap_or_else(PoisonError::into_inner);
        *kept = std::mem::replace(plane, other);
    }

    /// Settles what can be once all of these `planes` have come: `pass(x, channel, plane)` sees each settled plane, and
    /// `take` is told about whole slabs.
    fn settle(
        &self,
        planes: Range<usize>,
        pass: impl Fn(usize, usize, &mut [f32]) -> Result<()> + Sync + Send,
        mut take: impl FnMut(Range<usize>) -> Result<()>,
    ) -> Result<()> {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let before = waiting.replace(planes.clone());
        drop(waiting);
        let last = Some(planes).filter(|planes| planes.end == self.lifted.len());
        for planes in before.into_iter().chain(last) {
            parallel::map(planes.len(), |i| self.settle_plane(planes.start + i, &pass))?;
            // The last plane is beside the next slab's first.
            for plane in &self.lifted[planes.start.saturating_sub(1)..planes.end - 1] {
                let free = |plane: &RwLock<Vec<f32>>| {
                    std::mem::take(&mut *plane.write().unwrap_or_else(PoisonError::into_inner))
                };
                self.pool.give(plane.iter().map(free));
            }
            take(planes)?;
        }
        Ok(())
    }

    /// Settles all channels of plane `x`.
    fn settle_plane(
        &self,
        x: usize,
        pass: &(impl Fn(usize, usize, &mut [f32]) -> Result<()> + Sync + Send),
    ) -> Result<()> {
        let Nodes([nx, ny, nz]) = self.needed.nodes();
        let lifted = |x: usize| {
            let read = |plane| RwLock::read(plane).unwrap_or_else(PoisonError::into_inner);
            self.lifted[x].iter().map(read).collect::<Vec<_>>()
        };
        let around: Vec<_> = (x.saturating_sub(1)..(x + 2).min(nx)).map(lifted).collect();
        let own = &around[x.min(1)];
        // All but what colours are weighted by.
        let mut settled: Vec<_> = own.iter().skip(1).map(|_| self.pool.take(ny * nz)).collect();
        let [mut column, mut weights, mut totals] = [(); 3].map(|()| vec![0.0; nz]);
        for y in 0..ny {
            let rows = y.saturating_sub(1)..(y + 2).min(ny);
            for (start, end) in row::spans(self.needed.row(x, y), nz, GAP) {
                let span = y * nz + start..y * nz + end;
                // Of a channel, each node's own value and a little of those around it.
                let mut total = |channel: usize, totals: &mut [f64]| {
                    let [low, high] = [start.saturating_sub(1), (end + 1).min(nz)];
                    let column = &mut column[..high - low];
                    column.fill(0.0);
                    for planes in &around {
                        for y in rows.clone() {
                            add(column, &planes[channel][y * nz + low..y * nz + high]);
                        }
                    }
                    let own = &own[channel][span.clone()];
                    add_neighbours(own, column, start - low, &mut totals[..end - start]);
                };
                self.matter.settle_amounts(&own[0][span.clone()], &mut settled[0][span.clone()]);
                total(1, &mut weights);
                for (channel, settled) in settled.iter_mut().enumerate().skip(1) {
                    total(channel + 1, &mut totals);
                    settle_color(&totals, &weights, &mut settled[span.clone()]);
                }
            }
        }
        for (channel, settled) in settled.iter_mut().enumerate() {
            pass(x, channel, settled)?;
        }
        self.pool.give(settled);
        Ok(())
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn add(sums: &mut [f64], row: &[f32]) {
    for (sum, &value) in sums.iter_mut().zip(row) {
        *sum += f64::from(value);
    }
}

/// `own` and a share of the `column` sums around each value, of which `column[first]` is the first one's.
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

/// Logits of weighted colours divided by their weights.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn settle_color(totals: &[f64], weights: &[f64], settled: &mut [f32]) {
    for ((settled, total), weight) in settled.iter_mut().zip(totals).zip(weights) {
        let color = total / weight.max(f64::MIN_POSITIVE);
        let color = color.clamp(LEAST_COLOR, 1.0 - LEAST_COLOR);
        *settled = lanes::ln(color / (1.0 - color)) as f32;
    }
}
