//! The sizes of a table of features.

use crate::base::error::{Error, Place, Result};
use crate::packets::{Levels, Sizes, Values};

/// The numbers that determine the levels of a table.
#[derive(Debug, Clone, Copy)]
pub(super) struct TableSizes {
    pub(super) sizes: Sizes,
    pub(super) finest: u64,
}

impl TableSizes {
    /// tiny-cuda-nn's levels. Their ratio is a float32 that differs between machines by one ulp.
    pub(super) fn candidates(&self, place: &Place) -> Result<Vec<Levels>> {
        let steps = self.sizes.levels.saturating_sub(1).max(1) as f64;
        let [finest, base] = [self.finest, self.sizes.base].map(|size| libm::log(size as f64));
        #[expect(clippy::cast_possible_truncation, reason = "float32")]
        let ratio = match self.sizes.levels {
            1 => 1.0,
            _ => libm::exp((finest - base) / steps) as f32,
        };
        let mut found = Vec::new();
        for ratio in [ratio, ratio.next_up(), ratio.next_down()] {
            #[expect(clippy::cast_possible_truncation, reason = "float32")]
            let log2_ratio = libm::log2(f64::from(ratio)) as f32;
            found.push(self.sizes.levels(log2_ratio, place)?);
        }
        Ok(found)
    }

    pub(super) fn refuse(&self, values: &Values) -> Error {
        let found = format!("{} parameters", values.count);
        let expected = format!(
            "those of {} levels of {} features from {} to {} nodes, of up to 2^{} entries",
            self.sizes.levels,
            self.sizes.features,
            self.sizes.base,
            self.finest,
            self.sizes.log2_entries
        );
        Error::malformed(values.tensor.place(), found, expected)
    }
}
