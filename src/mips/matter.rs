//! What physically based filters average: matter, and the colour of matter.
//!
//! Raw values are logarithms of sorts: the mean of -60 and +10 is nearly empty, although half the
//! space is opaque, and an empty node's colour counts as much as a wall's. So nodes are *lifted* on
//! their way up from level 0: density becomes an amount of matter, every colour and feature is
//! activated and weighted by how much of that is seen ([`super::visibility`]). All are then plain
//! linear means on all levels. At each level they *settle* into what is stored: an amount into the
//! level's density domain, weighted colours divided by their weight into logits. Nodes that are nearly empty hold no
//! matter at all, and nothing is read of their colours.
//!
//! Amounts are opacities over a few intervals, `1 - exp(-reach * tau)` with the optical depth `tau`
//! of one interval: matter counts by how much of the light behind it covers. Means of optical depth
//! itself would let one node inside a wall, whose 40 nobody can tell from 4, swell the wall by a node
//! of every coarser level. The settled optical depth is `-ln(1 - amount) / reach`.

use super::Slab;
use super::cascade::spare_plane;
use crate::activate::{self, lanes};
use crate::error::Result;
use crate::field::Activation;
use crate::grid::{NodeMask, Nodes, row};
use crate::parallel;

use multiversion::multiversion;

/// Smaller amounts are none: most of a scene is empty, and costs nothing where that is known. A node of so much lets all
/// but one part in ten million of the light through, 140 dB below what can be seen.
const LEAST_AMOUNT: f64 = 1e-7;
/// Where the exponential ends ([`lanes::exp`]): lower shifted raw densities are none whatever the interval.
const EMPTY_BELOW: f32 = -80.0;
/// Values that are looked at together for being empty.
const EMPTY_RUN: usize = 32;
/// Amounts settle no closer to 1 than this: an optical depth that lets through one part in 10^7.
const MOST_AMOUNT: f64 = 1.0 - 1e-7;
/// Colours settle this far from 0 and 1: logits of -16 and 16.
const LEAST_COLOR: f64 = 1e-7;
/// How much the matter around a node counts in its colour. A node with little matter still colours
/// the cells around it by interpolation, and must not do so with the grey of empty space.
const NEIGHBOURS_SHARE: f64 = 1e-4;

/// Nodes that nobody needs, but fewer than these in a row settle too: stopping costs more.
const GAP: usize = 16;

/// What amounts of matter settle into.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Settled {
    /// The square root of the optical depth over one interval.
    SqrtOpticalDepth,
    /// Opacity over one interval.
    Opacity,
}

/// Lifts and settles values of one scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Matter {
    /// Raw density to optical depth.
    pub activation: Activation,
    /// Intervals over which opacity is the amount.
    pub reach: f32,
    /// What is stored.
    pub settled: Settled,
    empty_up_to: f32,
}

impl Matter {
    /// Matter as opacity over `reach` intervals, and what it settles into.
    pub fn new(activation: Activation, reach: f32, settled: Settled) -> Self {
        let Activation { shift, interval, .. } = activation;
        let [at, over] = [shift, interval * reach].map(f64::from);
        let least = activate::raw_at_opacity(LEAST_AMOUNT, at, over) as f32;
        Self { activation, reach, settled, empty_up_to: least.max(EMPTY_BELOW - shift) }
    }

    /// The highest raw density that is no matter.
    pub fn empty_up_to(&self) -> f32 {
        self.empty_up_to
    }

    /// Amounts of raw densities.
    pub fn lift_density(&self, raw: &[f32], amounts: &mut [f32]) {
        let Activation { shift, interval, .. } = self.activation;
        lift_density(raw, amounts, shift, interval * self.reach, self.empty_up_to);
    }

    /// Colours of raw colours, multiplied by weights.
    pub fn lift_color(&self, raw: &[f32], weights: &[f32], weighted: &mut [f32]) {
        lift_color(raw, weights, weighted);
    }

    /// The amount from which opacity over `intervals` exceeds `opacity`, lowered by a hair so that no
    /// rounding drops what is above.
    pub fn amount_at_opacity(&self, opacity: f32, intervals: f64) -> f32 {
        let depth = -libm::log1p(-f64::from(opacity)) / intervals;
        (-libm::expm1(-depth * f64::from(self.reach)) * (1.0 - 1e-6)) as f32
    }

    /// The optical depths over one interval of amounts.
    pub(super) fn depths(&self, amounts: &[f32], depths: &mut [f32]) {
        optical_depths(amounts, f64::from(self.reach), depths);
    }

    /// What is stored of amounts.
    fn settle_amounts(&self, amounts: &[f32], settled: &mut [f32]) {
        let reach = f64::from(self.reach);
        match self.settled {
            Settled::SqrtOpticalDepth => sqrt_optical_depths(amounts, reach, settled),
            Settled::Opacity => {
                for (settled, &amount) in settled.iter_mut().zip(amounts) {
                    *settled = -libm::expm1(-optical_depth(amount, reach)) as f32;
                }
            }
        }
    }
}

/// The optical depth over one interval of an amount.
#[inline(always)]
fn optical_depth(amount: f32, reach: f64) -> f64 {
    -lanes::ln(1.0 - f64::from(amount).clamp(0.0, MOST_AMOUNT)) / reach
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn optical_depths(amounts: &[f32], reach: f64, depths: &mut [f32]) {
    for (depth, &amount) in depths.iter_mut().zip(amounts) {
        *depth = optical_depth(amount, reach) as f32;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn sqrt_optical_depths(amounts: &[f32], reach: f64, settled: &mut [f32]) {
    for (settled, &amount) in settled.iter_mut().zip(amounts) {
        *settled = optical_depth(amount, reach).sqrt() as f32;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn lift_density(raw: &[f32], amounts: &mut [f32], shift: f32, interval: f32, empty_up_to: f32) {
    // Most of a scene is empty, and found so faster than lifted.
    for (raw, amounts) in raw.chunks(EMPTY_RUN).zip(amounts.chunks_mut(EMPTY_RUN)) {
        if raw.iter().fold(0, |any, &raw| any | u32::from(raw > empty_up_to)) == 0 {
            amounts.fill(0.0);
            continue;
        }
        for (amount, &raw) in amounts.iter_mut().zip(raw) {
            let lifted = lanes::opacity(lanes::softplus(raw + shift) * interval);
            *amount = if raw > empty_up_to { lifted } else { 0.0 };
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn lift_color(raw: &[f32], weights: &[f32], weighted: &mut [f32]) {
    for ((weighted, raw), weight) in weighted.iter_mut().zip(raw).zip(weights) {
        *weighted = lanes::sigmoid(*raw) * weight;
    }
}

/// Settles the slabs of one level, which colour makes wait: a slab's last plane needs the next slab.
#[derive(Debug)]
pub struct Settler<'a> {
    matter: Matter,
    /// The nodes that must come out right; lifted values are right one node around them too.
    needed: &'a NodeMask,
    /// The last plane of the slab before `waiting`.
    below: Option<Vec<Vec<f32>>>,
    waiting: Option<Slab>,
    /// Planes to be used again.
    spare: Vec<Vec<f32>>,
}

impl<'a> Settler<'a> {
    /// For each level, given what is `needed` of it; none where values are stored as they come.
    pub fn of_levels(
        matter: Option<Matter>,
        needed: impl IntoIterator<Item = &'a NodeMask>,
    ) -> Vec<Option<Self>> {
        let levels = needed.into_iter().enumerate();
        let settler = |(level, needed)| match matter {
            Some(matter) if level > 0 => Some(Self::new(matter, needed)),
            _ => None,
        };
        levels.map(settler).collect()
    }

    /// For the nodes that are `needed` of a level.
    fn new(matter: Matter, needed: &'a NodeMask) -> Self {
        Self { matter, needed, below: None, waiting: None, spare: Vec::new() }
    }

    /// Takes the next slab of lifted values, and hands out the settled slabs that are now complete.
    pub fn take(
        &mut self,
        slab: &Slab,
        mut hand_out: impl FnMut(&mut Slab) -> Result<()>,
    ) -> Result<()> {
        let channels = slab.channels;
        if let Some(mut waiting) = self.waiting.take() {
            self.settle(&waiting, Some(&slab.planes[..channels]), &mut hand_out)?;
            let last = waiting.planes.split_off((waiting.count() - 1) * channels);
            self.spare.extend(self.below.replace(last).into_iter().flatten());
            self.spare.append(&mut waiting.planes);
        }
        let mut planes: Vec<Vec<f32>> =
            slab.planes.iter().map(|_| self.spare.pop().unwrap_or_default()).collect();
        parallel::map_mut(&mut planes, |i, copy| {
            copy.clear();
            copy.extend_from_slice(&slab.planes[i]);
            Ok(())
        })?;
        let waiting = Slab { first: slab.first, channels, planes };
        if waiting.first + waiting.count() == self.needed.nodes().0[0] {
            return self.settle(&waiting, None, &mut hand_out);
        }
        self.waiting = Some(waiting);
        Ok(())
    }

    /// Settles a slab, given the plane after it if there is one.
    fn settle(
        &mut self,
        slab: &Slab,
        above: Option<&[Vec<f32>]>,
        hand_out: &mut impl FnMut(&mut Slab) -> Result<()>,
    ) -> Result<()> {
        let channels = slab.channels;
        // All but the weight of colours.
        let left = channels - 1;
        let spare = &mut self.spare;
        let plane = |_| spare_plane(spare, self.needed.nodes().0[1] * self.needed.nodes().0[2]);
        let mut planes: Vec<Vec<f32>> = (0..slab.count() * left).map(plane).collect();
        let this = &*self;
        let own = |i: usize| &slab.planes[i * channels..(i + 1) * channels];
        let mut settled: Vec<&mut [Vec<f32>]> = planes.chunks_exact_mut(left).collect();
        parallel::map_mut(&mut settled, |i, settled| {
            let below = if i > 0 { Some(own(i - 1)) } else { this.below.as_deref() };
            let above = if i + 1 < slab.count() { Some(own(i + 1)) } else { above };
            let around: Vec<_> = below.into_iter().chain([own(i)]).chain(above).collect();
            this.settle_plane(slab.first + i, own(i), &around, settled);
            Ok(())
        })?;
        let mut settled = Slab { first: slab.first, channels: left, planes };
        hand_out(&mut settled)?;
        self.spare.append(&mut settled.planes);
        Ok(())
    }

    /// Settles plane `x` of all channels: `own`, among `around`.
    fn settle_plane(
        &self,
        x: usize,
        own: &[Vec<f32>],
        around: &[&[Vec<f32>]],
        settled: &mut [Vec<f32>],
    ) {
        let Nodes([_, ny, nz]) = self.needed.nodes();
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
                    for planes in around {
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
