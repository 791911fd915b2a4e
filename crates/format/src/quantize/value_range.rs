//! The range of some values.

use super::range::{Domain, is_laid_over_values};
use crate::model::baked::Decode;
use crate::model::scene::Activation;

/// Means are rounded to f32 several times over up to twenty levels.
const MEAN_ROUNDING: f32 = 1e-5;

/// The lowest and the highest of some values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValueRange {
    /// The lowest value; above `high` if there are none.
    low: f32,
    high: f32,
    /// Values up to this one count as empty.
    empty: f32,
}

impl ValueRange {
    /// An empty range of values with the meaning `decode`.
    pub fn new(decode: Decode, activation: &Activation) -> Self {
        let empty = match decode {
            Decode::Logit => f32::NEG_INFINITY,
            _ if is_laid_over_values(decode, activation) => f32::NEG_INFINITY,
            _ => Domain::of(decode, activation).empty,
        };
        let [low, high] = match decode {
            // Nodes that are not retained have no values.
            Decode::Anisotropy => [0.0; 2],
            _ => [f32::INFINITY, f32::NEG_INFINITY],
        };
        Self { low, high, empty }
    }

    /// Adds values. Both zeros are equal, and the first of equal values stays.
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

    /// The lowest and the highest value, if any.
    pub(super) fn ends(&self) -> Option<[f32; 2]> {
        (self.low <= self.high).then_some([self.low, self.high])
    }

    /// Adds all weighted means of another range's values and of 0, with any rounding.
    pub fn take_means(&mut self, other: &Self) {
        let Some(ends) = other.ends() else { return };
        let slack = ends[0].abs().max(ends[1].abs()) * MEAN_ROUNDING;
        self.take(&[ends[0].min(0.0) - slack, ends[1].max(0.0) + slack]);
    }

    /// Adds the values of another range of the same meaning.
    pub fn join(&mut self, other: &Self) {
        self.take(
            &[other.low, other.high].map(|end| if end.is_finite() { end } else { self.empty }),
        );
    }
}
