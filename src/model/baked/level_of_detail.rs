//! The rule for the level that a sample reads.

use serde::{Deserialize, Serialize};

use crate::model::field::nullable;

/// Bends of a rule, at most.
pub const MOST_BENDS: usize = 6;

/// The sample of the neighbouring ray that a sample's footprint is measured to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FootprintNeighbour {
    /// The one at the same distance: the pixel's size there.
    SameDistance,
    /// The one of the same index, as in the paper and the research code. If the box is entered
    /// through an oblique face, the entries differ, and samples behind it are blurred.
    SameIndex,
}

/// `lambda = clamp(line + sum of by * max(0, x - at), 0, min(last level, most))`, where `x =
/// log2(rho)`, `line = factor * x + bias`, the sum is over the `bends`, and `rho` is the footprint
/// of half a pixel in voxels of size `(max - min) / N`, doubled.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LevelOfDetail {
    /// 1/3 in the paper, 1/2 in the research code, 1 for mipmaps.
    pub factor: f32,
    /// Added after the factor.
    pub bias: f32,
    /// The sample of the neighbouring ray that the footprint is measured to.
    #[serde(rename = "aside")]
    pub neighbour: FootprintNeighbour,
    /// An upper bound beside the last level, if there is one.
    #[serde(rename = "most", deserialize_with = "nullable")]
    pub bound: Option<f32>,
    /// Where the line bends; left out where it does not.
    #[serde(default, skip_serializing_if = "Bends::is_empty")]
    pub bends: Bends,
}

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

    /// True if numbers are finite, the bound is from 0, and the level grows with the footprint.
    pub fn is_valid(&self) -> bool {
        let bound = self.bound.unwrap_or(0.0);
        let line = self.factor > 0.0 && self.factor.is_finite() && self.bias.is_finite();
        line && (0.0..f32::INFINITY).contains(&bound) && self.bends.rise(self.factor)
    }
}

/// Changes of a line's slope: `[at, by]`, from `log2(rho)` of `at` on by `by`, in rising order.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<[f32; 2]>", into = "Vec<[f32; 2]>")]
pub struct Bends {
    count: usize,
    bends: [[f32; 2]; MOST_BENDS],
}

impl Bends {
    /// None if there are more than [`MOST_BENDS`].
    pub fn new(bends: &[[f32; 2]]) -> Option<Self> {
        let mut new = Self { count: bends.len(), ..Self::default() };
        new.bends.get_mut(..bends.len())?.copy_from_slice(bends);
        Some(new)
    }

    /// The bends.
    #[inline]
    pub fn as_slice(&self) -> &[[f32; 2]] {
        &self.bends[..self.count]
    }

    /// The bends, to be changed.
    pub fn as_mut_slice(&mut self) -> &mut [[f32; 2]] {
        &mut self.bends[..self.count]
    }

    /// True for a straight line.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// True if places rise and the slope, `factor` at first, stays above 0.
    fn rise(&self, factor: f32) -> bool {
        let bends = self.as_slice();
        let finite = bends.iter().flatten().all(|number| number.is_finite());
        let mut slope = f64::from(factor);
        let mut grows = |[_, by]: &[f32; 2]| {
            slope += f64::from(*by);
            slope > 0.0
        };
        finite && bends.is_sorted_by(|a, b| a[0] < b[0]) && bends.iter().all(&mut grows)
    }
}

impl TryFrom<Vec<[f32; 2]>> for Bends {
    type Error = String;

    fn try_from(bends: Vec<[f32; 2]>) -> Result<Self, String> {
        let wrong = || format!("{} bends, where 1 to {MOST_BENDS} are allowed", bends.len());
        Self::new(&bends).filter(|bends| !bends.is_empty()).ok_or_else(wrong)
    }
}

impl From<Bends> for Vec<[f32; 2]> {
    fn from(bends: Bends) -> Self {
        bends.as_slice().to_vec()
    }
}
