//! The rule of levels as a curve through knots, and the search for the best one.
//!
//! A straight line through `log2(rho)` that suits near pictures reads levels from afar that are too
//! fine. So the fit starts with a curve that rises ever faster, and looks for the best height of
//! each knot once levels are fitted.

use crate::base::error::Result;
use crate::model::baked::{Bends, LevelOfDetail, MOST_BENDS};

/// Added to a line at `log2(rho)` of `x`: this times `x^2`.
const RISE: f32 = 0.12;
/// Steps of a knot's level, tried one after another.
const STEPS: [f32; 3] = [0.24, 0.12, 0.06];
/// Rounds over all knots for each step, at most.
const MAX_ROUNDS: usize = 2;
/// Least slope between knots.
const LEAST_SLOPE: f32 = 0.1;

/// Levels at whole numbers of `log2(rho)`, from 0 on.
#[derive(Debug, Clone)]
pub struct Curve {
    line: LevelOfDetail,
    levels: Vec<f32>,
}

impl Curve {
    /// The curve that a fit starts from, around a `line`, for this many coarser levels.
    pub fn above(line: LevelOfDetail, coarser: usize) -> Self {
        let knots = (coarser + 1).clamp(2, MOST_BENDS + 2);
        let level = |knot: usize| {
            let x = knot as f32;
            line.factor * x + line.bias + RISE * x * x
        };
        Self { line, levels: (0..knots).map(level).collect() }
    }

    /// The curve as a rule.
    pub fn rule(&self) -> LevelOfDetail {
        let slopes: Vec<f32> = self.levels.windows(2).map(|ends| ends[1] - ends[0]).collect();
        let bend = |(i, ends): (usize, &[f32])| [(i + 1) as f32, ends[1] - ends[0]];
        let bends: Vec<[f32; 2]> =
            slopes.windows(2).enumerate().map(bend).filter(|[_, by]| *by != 0.0).collect();
        let bends = Bends::new(&bends).unwrap_or_default();
        LevelOfDetail { factor: slopes[0], bias: self.levels[0], bends, ..self.line }
    }

    /// Moves knots uphill in `quality`, whose value of the curve as it is is `highest`. Returns the
    /// quality reached.
    pub fn climb(
        &mut self,
        mut highest: f64,
        mut quality: impl FnMut(LevelOfDetail) -> Result<f64>,
    ) -> Result<f64> {
        for step in STEPS {
            for _ in 0..MAX_ROUNDS {
                let before = highest;
                for knot in 0..self.levels.len() {
                    for by in [step, -step] {
                        let mut moved = self.clone();
                        moved.levels[knot] += by;
                        if !moved.rises() {
                            continue;
                        }
                        let found = quality(moved.rule())?;
                        if found > highest {
                            (*self, highest) = (moved, found);
                            break;
                        }
                    }
                }
                if highest == before {
                    break;
                }
            }
        }
        Ok(highest)
    }

    fn rises(&self) -> bool {
        self.levels.windows(2).all(|ends| ends[1] - ends[0] >= LEAST_SLOPE)
    }
}
