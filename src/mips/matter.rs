//! What physically based filters average: matter, and the colour of matter.
//!
//! Raw values are logarithms of sorts: the mean of -60 and +10 is nearly empty, although half the
//! space is opaque, and an empty node's colour counts as much as a wall's. So nodes are *lifted* on
//! their way up from level 0: density becomes an amount of matter, every colour and feature is
//! activated and weighted by how much of that is seen ([`super::visibility`]). All are then plain
//! linear means on all levels. At each level they *settle* into what is stored: an amount into the
//! level's density domain, weighted colours divided by their weight into logits.
//!
//! Amounts are opacities over a few intervals, `1 - exp(-reach * tau)` with the optical depth `tau`
//! of one interval: matter counts by how much of the light behind it covers. Means of optical depth
//! itself would let one node inside a wall, whose 40 nobody can tell from 4, swell the wall by a node
//! of every coarser level. The settled optical depth is `-ln(1 - amount) / reach`.

use super::Slab;
use crate::activate::lanes;
use crate::error::Result;
use crate::field::Activation;
use crate::grid::{NodeMask, Nodes};
use crate::parallel;

use multiversion::multiversion;

/// Amounts settle no closer to 1 than this: an optical depth that lets through one part in 10^7.
const MOST_AMOUNT: f64 = 1.0 - 1e-7;
/// Colours settle this far from 0 and 1: logits of -16 and 16.
const LEAST_COLOR: f64 = 1e-7;
/// How much the matter around a node counts in its colour. A node with little matter still colours
/// the cells around it by interpolation, and must not do so with the grey of empty space.
const NEIGHBOURS_SHARE: f64 = 1e-4;

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
}

impl Matter {
    /// Amounts of raw densities.
    pub fn lift_density(&self, raw: &[f32], amounts: &mut [f32]) {
        lift_density(raw, amounts, self.activation.shift, self.activation.interval * self.reach);
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

    /// The optical depth over one interval of an amount.
    pub(super) fn depth(&self, amount: f32) -> f64 {
        let left = 1.0 - f64::from(amount).clamp(0.0, MOST_AMOUNT);
        -libm::log(left) / f64::from(self.reach)
    }

    /// What is stored of an amount.
    fn settle_amount(&self, amount: f32) -> f32 {
        let depth = self.depth(amount);
        match self.settled {
            Settled::SqrtOpticalDepth => depth.sqrt() as f32,
            Settled::Opacity => -libm::expm1(-depth) as f32,
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn lift_density(raw: &[f32], amounts: &mut [f32], shift: f32, interval: f32) {
    for (amount, raw) in amounts.iter_mut().zip(raw) {
        *amount = lanes::opacity(lanes::softplus(raw + shift) * interval);
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
        Self { matter, needed, below: None, waiting: None }
    }

    /// Takes the next slab of lifted values, and returns the settled slabs that are now complete.
    pub fn take(&mut self, slab: &Slab) -> Result<Vec<Slab>> {
        let mut settled = Vec::new();
        let channels = slab.channels;
        if let Some(waiting) = self.waiting.take() {
            settled.push(self.settle(&waiting, Some(&slab.planes[..channels]))?);
            self.below = Some(waiting.planes[(waiting.count() - 1) * channels..].to_vec());
        }
        let waiting = Slab { first: slab.first, channels, planes: slab.planes.clone() };
        if waiting.first + waiting.count() == self.needed.nodes().0[0] {
            settled.push(self.settle(&waiting, None)?);
        } else {
            self.waiting = Some(waiting);
        }
        Ok(settled)
    }

    fn settle(&self, slab: &Slab, above: Option<&[Vec<f32>]>) -> Result<Slab> {
        let channels = slab.channels;
        let planes_of = |i: usize| -> Vec<&[Vec<f32>]> {
            let own = |i: usize| &slab.planes[i * channels..(i + 1) * channels];
            let below = if i > 0 { Some(own(i - 1)) } else { self.below.as_deref() };
            let above = if i + 1 < slab.count() { Some(own(i + 1)) } else { above };
            below.into_iter().chain([own(i)]).chain(above).collect()
        };
        let settled = parallel::map(slab.count(), |i| {
            Ok(self.settle_plane(slab.first + i, &slab.planes[i * channels..], &planes_of(i)))
        })?;
        let planes = settled.into_iter().flatten().collect();
        Ok(Slab { first: slab.first, channels: channels - 1, planes })
    }

    /// Settles plane `x` of all channels: `own`, among `around`.
    fn settle_plane(&self, x: usize, own: &[Vec<f32>], around: &[&[Vec<f32>]]) -> Vec<Vec<f32>> {
        let Nodes([_, ny, nz]) = self.needed.nodes();
        // All but the weight of colours.
        let mut settled = vec![vec![0.0; ny * nz]; around[0].len() - 1];
        for y in 0..ny {
            let rows = y.saturating_sub(1)..(y + 2).min(ny);
            crate::grid::mask::for_each_run(self.needed.row(x, y), |start, end| {
                for z in start..end {
                    let at = y * nz + z;
                    let near = |channel: usize| -> f64 {
                        let planes = around.iter().map(|planes| &planes[channel]);
                        let rows = planes.flat_map(|plane| {
                            let row = |y: usize| {
                                &plane[y * nz + z.saturating_sub(1)..y * nz + (z + 2).min(nz)]
                            };
                            rows.clone().map(row)
                        });
                        rows.flatten().fold(0.0, |sum, &value| sum + f64::from(value))
                    };
                    let total = |channel: usize| {
                        f64::from(own[channel][at]) + NEIGHBOURS_SHARE * near(channel)
                    };
                    settled[0][at] = self.matter.settle_amount(own[0][at]);
                    let weight = total(1).max(f64::MIN_POSITIVE);
                    for (channel, settled) in settled.iter_mut().enumerate().skip(1) {
                        let color = total(channel + 1) / weight;
                        let color = color.clamp(LEAST_COLOR, 1.0 - LEAST_COLOR);
                        settled[at] = libm::log(color / (1.0 - color)) as f32;
                    }
                }
            });
        }
        settled
    }
}
