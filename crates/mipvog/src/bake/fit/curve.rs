//! The rule of levels as a curve through knots, which is learned with the levels.
//!
//! A line through `log2(rho)` that suits near pictures picks levels that are too fine at a
//! distance. So the fit starts with a curve that rises ever faster. Every step moves the knots a
//! little along their derivatives. A search over knot positions would fail: levels that were fitted
//! under one curve look worse under any other at first.

use super::moments::{Means, fade, lacks};
use crate::model::baked::{Bends, LevelOfDetail, MOST_BENDS};

/// Added to a line at each knot. Among two dozen fixed curves, fits of two trained scenes were best
/// near these at every scale.
const RISES: [f32; MOST_BENDS + 1] = [0.1, 0.09, 0.25, 0.4, 0.9, 1.9, 3.4];
/// Knots before this one stay: moving the second one trades a loss at half size for a gain at a
/// quarter.
const FIRST_MOVED: usize = 2;
/// Step length of a knot's level at the start.
const RATE: f32 = 0.004;
/// Least slope between knots.
const LEAST_SLOPE: f32 = 0.1;

/// `log2(rho)` up to which only level 0 is read, so that pictures of full size do not change. With
/// 0, half-size pictures lose 0.4 to 1 dB. With -0.5, half-size pictures of some scenes gain 0.5
/// dB, but full-size pictures with pixels up to 0.7 voxels wide lose 0.9 dB.
const FULL_SIZE: f32 = -0.25;

/// Levels at whole numbers of `log2(rho)`, from 0 on.
#[derive(Debug, Clone)]
pub struct Curve {
    line: LevelOfDetail,
    /// The level at [`FULL_SIZE`].
    full_size: f32,
    levels: Vec<f32>,
    /// Of derivatives by the levels.
    means: [Means; MOST_BENDS + 1],
    steps: u32,
}

/// Derivatives by the levels of a curve's knots.
pub type ByKnots = [f32; MOST_BENDS + 1];

impl Curve {
    /// The initial curve of a fit, around a `line`, for this many coarser levels.
    pub fn above(line: LevelOfDetail, coarser: usize) -> Self {
        let knots = (coarser + 1).min(MOST_BENDS + 1);
        let level = |knot: usize| {
            let x = knot as f32;
            (line.factor * x + line.bias).max(-FULL_SIZE * LEAST_SLOPE) + RISES[knot]
        };
        let levels = (0..knots).map(level).collect();
        Self { line, full_size: 0.0, levels, means: Default::default(), steps: 0 }
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

    /// The two knots that determine a sample's level of detail, and its derivatives by them.
    #[inline]
    pub fn around(&self, lambda: f32) -> [(usize, f32); 2] {
        let levels = &self.levels;
        if lambda < levels[0] {
            return [(0, lambda / levels[0]), (0, 0.0)];
        }
        // The line continues beyond the last knot.
        let last = levels.len() - 2;
        let low = (0..last).find(|&knot| lambda < levels[knot + 1]).unwrap_or(last);
        let share = (lambda - levels[low]) / (levels[low + 1] - levels[low]);
        [(low, 1.0 - share), (low + 1, share)]
    }

    /// With one knot's level moved.
    #[cfg(test)]
    pub fn moved(&self, knot: usize, by: f32) -> Self {
        let mut moved = self.clone();
        moved.levels[knot] += by;
        moved
    }

    /// Takes a step against the derivatives by the knots' levels; `progress` goes from 0 to 1.
    pub fn step(&mut self, by: &ByKnots, progress: f32) {
        self.steps += 1;
        let rate = RATE * fade(progress);
        let lacks = lacks(self.steps);
        let knots = self.levels.iter_mut().zip(&mut self.means).zip(by).skip(FIRST_MOVED);
        for ((level, means), by) in knots {
            *level -= means.advance(*by, lacks, [rate, f32::MIN_POSITIVE]);
        }
        let mut least = -FULL_SIZE * LEAST_SLOPE;
        for level in &mut self.levels {
            *level = level.max(least);
            least = *level + LEAST_SLOPE;
        }
    }

    /// Rules that follow the line `near` up to a knot, and this curve from the next one on.
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

    fn rule_of(filter: Filter) -> LevelOfDetail {
        SharedFilter::from(filter).rule()
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
    fn a_level_of_detail_follows_from_the_knots_around_it() {
        let curve = Curve::above(rule_of(Filter::Fit), 4);
        for x in [-0.2, -0.01, 0.3, 1.0, 2.7, 4.0, 4.6] {
            let lambda = curve.rule().level(x);
            for knot in 0..curve.levels.len() {
                let by = curve.around(lambda).into_iter().filter(|(around, _)| *around == knot);
                let by: f32 = by.map(|(_, by)| by).sum();
                let [up, down] = [0.01, -0.01].map(|to| curve.moved(knot, to).rule().level(x));
                assert!((by - (up - down) / 0.02).abs() < 1e-3, "knot {knot} at {x}: {by}");
            }
        }
    }

    #[test]
    fn steps_go_downhill_and_levels_still_rise() {
        let start = Curve::above(rule_of(Filter::Fit), 5);
        let mut curve = start.clone();
        for _ in 0..1000 {
            curve.step(&[1.0, 1.0, -1.0, 1.0, 1.0, -1.0, 0.0], 0.0);
        }
        assert!(curve.rule().is_valid());
        assert_eq!(curve.levels[..FIRST_MOVED], start.levels[..FIRST_MOVED]);
        assert!(curve.levels[2] > start.levels[2] && curve.levels[5] > start.levels[5]);
        assert!(curve.levels.is_sorted_by(|a, b| b - a > 0.99 * LEAST_SLOPE));
    }

    #[test]
    fn pictures_of_full_size_read_level_0() {
        let rule = Curve::above(rule_of(Filter::Fit), 5).rule();
        assert!(rule.level(FULL_SIZE).abs() < 1e-6 && rule.level(FULL_SIZE - 1.0) < 0.0);
        assert!(rule.level(0.0) > 0.1);
    }
}
