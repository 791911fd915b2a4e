//! The rule for the level that a sample reads.

use super::generated::LevelOfDetail;

impl LevelOfDetail {
    /// The level of a footprint, before it is clamped.
    #[inline]
    pub fn level(&self, log2_footprint: f32) -> f32 {
        let line = self.factor * log2_footprint + self.bias;
        let bends = self.bends.as_slice().iter();
        bends.fold(line, |level, [at, by]| level + by * (log2_footprint - at).max(0.0))
    }

    /// With all slopes `times` as steep.
    pub fn scaled(mut self, times: f32) -> Self {
        self.factor *= times;
        self.bends.as_mut_slice().iter_mut().for_each(|[_, by]| *by *= times);
        self
    }

    /// True if numbers are finite, the bound is not negative, and the level grows with the
    /// footprint.
    pub fn is_valid(&self) -> bool {
        let bound = self.bound.unwrap_or(0.0);
        let line = self.factor > 0.0 && self.factor.is_finite() && self.bias.is_finite();
        line && (0.0..f32::INFINITY).contains(&bound) && self.bends.rise(self.factor)
    }
}
