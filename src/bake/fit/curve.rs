//! The rule of levels as a curve through knots, and the search for the best one.
//!
//! A straight line through `log2(rho)` that suits near pictures reads levels from afar that are too
//! fine. So the fit starts with a curve that rises ever faster, and looks for the best height of
//! each knot once levels are fitted: nearby, for levels that were fitted under one curve look worse
//! under every other at first.

use crate::base::error::Result;
use crate::model::baked::{Bends, LevelOfDetail, MOST_BENDS};

/// Added to a line at each knot. Fits of two trained scenes under two dozen fixed curves were best
/// about here at every scale.
const RISES: [f32; MOST_BENDS + 1] = [0.1, 0.09, 0.25, 0.4, 0.9, 1.9, 3.4];
/// A step of a knot's level.
const STEP: f32 = 0.06;
/// Gain of a step, at least, in dB: a rule that looks better on validation's rays by less may look
/// worse on others.
const LEAST_GAIN: f64 = 0.02;
/// Loss of a scale by a step, at most, in dB: far scales must not gain at the cost of near ones.
const MOST_LOSS: f64 = 0.02;
/// Least slope between knots.
const LEAST_SLOPE: f32 = 0.1;

/// `log2(rho)` up to which level 0 is read alone: pictures of full size stay as they are. With 0
/// half-size pictures lose 0.4 to 1 dB.
const FULL_SIZE: f32 = -0.25;

/// Levels at whole numbers of `log2(rho)`, from 0 on.
#[derive(Debug, Clone)]
pub struct Curve {
    line: LevelOfDetail,
    /// The level at [`FULL_SIZE`].
    full_size: f32,
    levels: Vec<f32>,
}

impl Curve {
    /// The curve that a fit starts from, around a `line`, for this many coarser levels.
    pub fn above(line: LevelOfDetail, coarser: usize) -> Self {
        let knots = (coarser + 1).min(MOST_BENDS + 1);
        let level = |knot: usize| {
            let x = knot as f32;
            (line.factor * x + line.bias).max(-FULL_SIZE * LEAST_SLOPE) + RISES[knot]
        };
        Self { line, full_size: 0.0, levels: (0..knots).map(level).collect() }
    }

    /// The curve as a rule.
    pub fn rule(&self) -> LevelOfDetail {
        let (bias, factor) = (self.levels[0], self.first_slope());
        let mut slope = factor;
        let bend = |(knot, ends): (usize, &[f32])| {
            let by = ends[1] - ends[0] - slope;
            slope += by;
            [knot as f32, by]
        };
        let bends = self.levels.windows(2).enumerate().map(bend);
        let bends: Vec<[f32; 2]> = bends.filter(|[_, by]| *by != 0.0).collect();
        let bends = Bends::new(&bends).unwrap_or_default();
        LevelOfDetail { factor, bias, bends, ..self.line }
    }

    /// Moves each knot by a step, or not, uphill in the mean of `quality`, which is `best` before, in
    /// dB by scale.
    pub fn climb(
        &mut self,
        mut best: Vec<f64>,
        mut quality: impl FnMut(LevelOfDetail) -> Result<Vec<f64>>,
    ) -> Result<()> {
        for knot in 0..self.levels.len() {
            for by in [STEP, -STEP] {
                let mut moved = self.clone();
                moved.levels[knot] += by;
                if !moved.rises() {
                    continue;
                }
                let found = quality(moved.rule())?;
                let gains = || found.iter().zip(&best).map(|(found, best)| found - best);
                let gain = gains().sum::<f64>() / best.len().max(1) as f64;
                if gain > LEAST_GAIN && gains().all(|gain| gain > -MOST_LOSS) {
                    (*self, best) = (moved, found);
                    break;
                }
            }
        }
        Ok(())
    }

    /// Rules that are `near`, a line, up to a knot, and this curve from the next one on.
    pub fn far_rules(&self, near: LevelOfDetail) -> Vec<LevelOfDetail> {
        let mut joined = Self { full_size: near.level(FULL_SIZE), ..self.clone() };
        let rules = (0..joined.levels.len()).filter_map(|knot| {
            joined.levels[knot] = near.level(knot as f32);
            joined.rises().then(|| joined.rule())
        });
        rules.collect()
    }

    /// The slope from [`FULL_SIZE`] to the first knot.
    fn first_slope(&self) -> f32 {
        (self.levels[0] - self.full_size) / -FULL_SIZE
    }

    fn rises(&self) -> bool {
        let rises = |ends: &[f32]| ends[1] - ends[0] >= LEAST_SLOPE;
        self.first_slope() >= LEAST_SLOPE && self.levels.windows(2).all(rises)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::levels::{Filter, SharedFilter};
    use crate::model::baked::FootprintNeighbour;

    fn rule_of(filter: Filter) -> LevelOfDetail {
        SharedFilter::from(filter).rule(FootprintNeighbour::SameDistance)
    }

    #[test]
    fn far_rules_are_near_ones_up_to_a_knot() {
        let near = rule_of(Filter::RateTent);
        let curve = Curve::above(rule_of(Filter::Fit), 4);
        let (fitted, rules) = (curve.rule(), curve.far_rules(near));
        assert_eq!(rules.len(), 5);
        for (knot, rule) in rules.into_iter().enumerate() {
            assert!(rule.is_valid());
            for x in 0..=4 {
                let from = if x <= knot { near } else { fitted };
                let x = x as f32;
                assert!((rule.level(x) - from.level(x)).abs() < 1e-5, "{knot}, {x}");
            }
            assert!((rule.level(-0.1) - near.level(-0.1)).abs() < 1e-6);
        }
    }

    #[test]
    fn pictures_of_full_size_read_level_0() {
        let rule = Curve::above(rule_of(Filter::Fit), 5).rule();
        assert!(rule.level(FULL_SIZE).abs() < 1e-6 && rule.level(FULL_SIZE - 1.0) < 0.0);
        assert!(rule.level(0.0) > 0.1);
    }
}
