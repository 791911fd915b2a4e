//! The range of some values.

use super::range::{Domain, is_laid_over_values};
use crate::model::baked::Decode;
use crate::model::scene::Activation;

/// Means are rounded to f32 a few times on the way through twenty levels.
const MEAN_ROUNDING: f32 = 1e-5;

/// The lowest and the highest of some values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValueRange {
    /// Lowest of them; above `high` where there are none.
    low: f32,
    high: f32,
    /// Values up to this one count as empty.
    empty: f32,
}

impl ValueRange {
    /// Of no values yet, which will mean `decode`.
    pub fn new(decode: Decode, activation: &Activation) -> Self {
        let empty = match decode {
            Decode::Logit => f32::NEG_INFINITY,
            _ if is_laid_over_values(decode, activation) => f32::NEG_INFINITY,
            _ => Domain::of(decode, activation).empty,
        };
        let [low, high] = match decode {
            // Nodes that are not retained have none.
            Decode::Anisotropy => [0.0; 2],
            _ => [f32::INFINITY, f32::NEG_INFINITY],
        };
        Self { low, high, empty }
    }

    /// Takes values. Zeros of both signs are the same: of equal ones the first stays.
    pub fn take(&mut self, values: &[f32]) {
        for &value in values {
            if value > self.empty && value < self.low {
                self.low = value;
            }
            if value > self.empty && value > self.high {
                self.high = value;
            }
        }
    }

    /// The lowest and the highest value, if there are any.
    pub(super) fn ends(&self) -> Option<[f32; 2]> {
        (self.low <= self.high).then_some([self.low, self.high])
    }

    /// Takes all weighted means of another range's values and of 0, however they were rounded.
    pub fn take_means(&mut self, other: &Self) {
        let Some(ends) = other.ends() else { return };
        let slack = ends[0].abs().max(ends[1].abs()) * MEAN_ROUNDING;
        self.take(&[ends[0].min(0.0) - slack, ends[1].max(0.0) + slack]);
    }

    /// Takes those of another span of the same meaning.
    pub fn join(&mut self, other: &Self) {
        self.take(
            &[other.low, other.high].map(|end| if end.is_finite() { end } else { self.empty }),
        );
    }
}
