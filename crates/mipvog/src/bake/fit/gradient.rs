//! The derivatives of a ray's colour by the values of coarser levels.
//!
//! With the samples' optical depths `t_i` and colours `c_i`, light `T_i` before and `T_(i+1)`
//! behind a sample, weights `w_i = T_i - T_(i+1)`, accumulated `A = sum w_i c_i` and light left
//! `T`:
//!
//! ```text
//! dL/dc_i = w_i dL/dA
//! dL/dt_i = T_(i+1) dL/dA . c_i - (sum over j > i of w_j dL/dA . c_j + T dL/dT)
//! ```
//!
//! A sample's optical depth and colour are those of two levels, mixed by its level of detail. So
//! the derivative by the level of detail is the difference of the two, and the rule's knots
//! determine the level of detail. Knots also move the samples, which only adds noise, so this is
//! ignored.
//!
//! With anisotropy a density is `max(0, v + sum over m of a_m Y_m)`, so where it is not 0 the
//! derivative by `a_m` is `Y_m` times that by `v`.

use multiversion::multiversion;

use super::curve::ByKnots;
use super::target::Windows;
use super::trace::{Part, Rays, Sampled, Samples, Traced};
use crate::model::anisotropy::ANISOTROPY;
use crate::view::render::ColorRule;

/// Marks nodes that are not fitted.
pub const NOT_FITTED: u32 = u32::MAX;

/// A node's stored values, or sums of derivatives by them.
#[derive(Debug, Clone, Copy)]
pub struct NodeValues<const C: usize> {
    /// Density.
    pub density: f32,
    /// Anisotropy of density.
    pub anisotropy: [f32; ANISOTROPY],
    /// Colours.
    pub color: [f32; C],
}

impl<const C: usize> NodeValues<C> {
    /// All zero.
    pub const ZERO: Self = Self { density: 0.0, anisotropy: [0.0; ANISOTROPY], color: [0.0; C] };
}

/// Sums of derivatives.
#[derive(Debug)]
pub struct Gradient<const C: usize> {
    /// From level 1 on, by fitted node.
    pub levels: Vec<Vec<NodeValues<C>>>,
    /// By the rule's knots.
    pub knots: ByKnots,
    samples: Samples<C>,
}

impl<const C: usize> Gradient<C> {
    /// Zeros for this many nodes of each level.
    pub fn new(nodes: &[usize]) -> Self {
        let levels = nodes.iter().map(|&nodes| vec![NodeValues::ZERO; nodes]).collect();
        Self { levels, knots: ByKnots::default(), samples: Samples::default() }
    }
}

/// [`Rays::spread`] in the processor's widest vectors.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn spread<const C: usize>(
    rays: &Rays<C>,
    traced: &Traced<C>,
    worth: f32,
    samples: &Samples<C>,
    sums: (&mut [Vec<NodeValues<C>>], &mut ByKnots),
) {
    rays.spread(traced, worth, samples, sums);
}

impl<const C: usize> Rays<'_, C> {
    /// Adds the derivatives of half the squared error of ray `number`, times `worth`.
    pub fn differentiate(
        &self,
        scale: usize,
        number: usize,
        windows: Windows,
        worth: f32,
        gradient: &mut Gradient<C>,
    ) {
        let Gradient { levels, knots, samples } = gradient;
        let target = self.targets.draw(scale, number, windows);
        let Some(traced) = target.and_then(|target| self.trace(&target, samples)) else { return };
        spread(self, &traced, worth, samples, (levels, knots));
    }

    /// Adds the derivatives of a traced ray.
    #[inline(always)]
    fn spread(
        &self,
        traced: &Traced<C>,
        worth: f32,
        samples: &Samples<C>,
        (levels, knots): (&mut [Vec<NodeValues<C>>], &mut ByKnots),
    ) {
        let mut by_color = traced.by_color;
        by_color.iter_mut().for_each(|by| *by *= worth);
        // Back to front: the derivative by the light behind a sample.
        let mut behind = traced.left * traced.by_left * worth;
        // At density 0, the derivative is 0.
        for sample in samples.list.iter().rev().filter(|sample| sample.weight > 0.0) {
            let colors = sample.colors.map(|number| &samples.colors[number]);
            let worth = colors.map_or(0.0, |colors| dot(&by_color, &colors.mixed));
            let by_depth = (sample.left * worth - behind) * sample.intervals;
            for (slot, part) in sample.parts.iter().enumerate() {
                if part.level == 0 {
                    continue;
                }
                let color = colors.map(|colors| &colors.parts[slot]);
                let by_raw = by_raw(&traced.rule, sample, part, color, &by_color);
                self.add(part, by_depth, &by_raw, &traced.along, &mut levels[part.level - 1]);
            }
            if sample.parts[1].share > 0.0 {
                let colors = colors.map_or([&[0.0; C]; 2], |colors| colors.parts.each_ref());
                let apart = dot(&by_color, colors[1]) - dot(&by_color, colors[0]);
                let by_lambda = by_depth * sample.deeper + sample.weight * apart;
                let lambda = sample.parts[0].level as f32 + sample.parts[1].share;
                for (knot, share) in self.curve.around(lambda) {
                    knots[knot] += share * by_lambda;
                }
            }
            behind += sample.weight * worth;
        }
    }

    /// The picture of ray `number`, and its squared error over three channels; none if no picture
    /// shows anything.
    pub fn square(
        &self,
        scale: usize,
        number: usize,
        windows: Windows,
        gradient: &mut Gradient<C>,
    ) -> Option<(usize, f32)> {
        let target = self.targets.draw(scale, number, windows)?;
        let traced = self.trace(&target, &mut gradient.samples);
        Some((target.picture, traced.map_or(0.0, |traced| traced.square)))
    }

    /// Adds a sample's share to the derivatives of the nodes around it.
    #[inline(always)]
    fn add(
        &self,
        part: &Part,
        by_depth: f32,
        by_raw: &[f32; C],
        along: &[f32; ANISOTROPY],
        sums: &mut [NodeValues<C>],
    ) {
        // depth = density^2
        let by_density = by_depth * part.share * 2.0 * part.density;
        let by_anisotropy = along.map(|along| by_density * along);
        for (node, weight) in self.field.corners(part.level, &part.cell) {
            let number = self.numbers[part.level - 1][node];
            if number == NOT_FITTED {
                continue;
            }
            let sums = &mut sums[number as usize];
            sums.density += weight * by_density;
            for (sum, by) in sums.anisotropy.iter_mut().zip(by_anisotropy) {
                *sum += weight * by;
            }
            for (sum, by_raw) in sums.color.iter_mut().zip(by_raw) {
                *sum += weight * by_raw;
            }
        }
    }
}

/// The derivatives by a part's interpolated values.
#[inline(always)]
fn by_raw<const C: usize>(
    rule: &ColorRule,
    sample: &Sampled,
    part: &Part,
    color: Option<&[f32; C]>,
    by_color: &[f32; C],
) -> [f32; C] {
    let Some(color) = color else { return [0.0; C] };
    let share = sample.weight * part.share;
    let mut by_part = *by_color;
    by_part.iter_mut().for_each(|by| *by *= share);
    rule.by_values(color, &by_part)
}

fn dot<const C: usize>(a: &[f32; C], b: &[f32; C]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
