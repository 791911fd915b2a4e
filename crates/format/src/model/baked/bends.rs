//! Bends of the rule that picks the level of a sample.

use serde::{Deserialize, Serialize};

/// Bends of a rule, at most.
pub const MOST_BENDS: usize = 6;

/// Changes of a line's slope: `[at, by]` adds `by` to the slope from a `log2(rho)` of `at` on, in
/// rising order.
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

    /// The bends, mutable.
    pub fn as_mut_slice(&mut self) -> &mut [[f32; 2]] {
        &mut self.bends[..self.count]
    }

    /// True for a straight line.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// True if places rise and the slope, which starts as `factor`, stays above 0.
    pub(super) fn rise(&self, factor: f32) -> bool {
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
