//! The levels of a table of features.
//!
//! ```text
//! scale = base b^l - 1,  size = ceil(scale) + 1
//! position in a level = position (0 to 1) scale + 1/2
//! entry = x + y s + z s^2 where all nodes have one, else x ^ 2654435761 y ^ 805459861 z
//! ```
//!
//! Entries are counted modulo those of the level: the last node of an axis may be one beyond it.

use crate::base::error::{Error, Place, Result};

/// Levels, at most.
const MOST_LEVELS: u64 = 64;
/// Binary logarithm of the entries of a level, at most.
const MOST_LOG2: u64 = 28;
/// Nodes along an axis of the first level, at most.
const MOST_BASE: u64 = 1 << 12;
/// Entries of levels are multiples of this.
const MULTIPLE: u64 = 8;
/// Factors of the coordinates in a hash.
const PRIMES: [u32; 3] = [1, 2_654_435_761, 805_459_861];

/// A level.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Level {
    scale: f32,
    /// Nodes along an axis, as entries are counted.
    size: u32,
    entries: u32,
    /// True if nodes share entries.
    hashed: bool,
    /// Entries of the levels before it.
    first: u64,
}

/// All levels.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Layout {
    levels: Vec<Level>,
    /// Features of an entry.
    pub(super) features: usize,
}

/// The numbers that levels follow from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sizes {
    pub(super) levels: u64,
    pub(super) features: u64,
    /// Binary logarithm of the most entries of a level.
    pub(super) log2_entries: u64,
    /// Nodes along an axis of the first level, about.
    pub(super) base: u64,
    /// Nodes along an axis more than the size, as entries are counted.
    pub(super) more: u32,
}

impl Sizes {
    /// Refuses sizes that no model has.
    pub(super) fn check(&self, place: &Place) -> Result<()> {
        let within = [
            ("levels", self.levels, MOST_LEVELS),
            ("features of a level", self.features, 8),
            ("as the logarithm of entries", self.log2_entries, MOST_LOG2),
            ("nodes of the first level", self.base, MOST_BASE),
        ];
        for (name, value, most) in within {
            if !(1..=most).contains(&value) {
                let expected = format!("1 to {most}");
                return Err(Error::malformed(place.clone(), format!("{value} {name}"), expected));
            }
        }
        Ok(())
    }

    /// The levels whose sizes grow by a ratio, of which the binary logarithm is given. Both programs
    /// compute scales in float32; each function is rounded once, as theirs are.
    ///
    /// # Errors
    /// `Malformed` for levels of 2^20 nodes along an axis or more.
    pub(super) fn layout(&self, log2_ratio: f32, place: &Place) -> Result<Layout> {
        self.check(place)?;
        let mut levels = Vec::new();
        let mut first = 0;
        for number in 0..self.levels {
            let (number, base) = (number as f32, self.base as f32);
            #[expect(clippy::cast_possible_truncation, reason = "float32")]
            let growth = libm::exp2(f64::from(number * log2_ratio)) as f32;
            let scale = growth * base - 1.0;
            // Sizes are compared as floats: a cast would saturate.
            let size = libm::ceilf(scale) + 1.0;
            if !(size >= 1.0 && size < (1u32 << 20) as f32) {
                let found = format!("a level of {size} nodes along an axis");
                return Err(Error::malformed(place.clone(), found, "fewer than 2^20"));
            }
            #[expect(clippy::cast_possible_truncation, reason = "checked above")]
            let size = size as u32 + self.more;
            let nodes = u64::from(size).pow(3);
            let entries = nodes.next_multiple_of(MULTIPLE).min(1 << self.log2_entries);
            let narrow = u32::try_from(entries).unwrap_or(u32::MAX);
            levels.push(Level { scale, size, entries: narrow, hashed: nodes > entries, first });
            first += entries;
        }
        let features = usize::try_from(self.features).unwrap_or(1);
        Ok(Layout { levels, features })
    }
}

impl Layout {
    /// Entries of all levels.
    pub(super) fn entries(&self) -> u64 {
        self.levels.last().map_or(0, |level| level.first + u64::from(level.entries))
    }

    /// The first entry of each level, and the end of the last one.
    pub(super) fn offsets(&self) -> impl Iterator<Item = u64> {
        self.levels.iter().map(|level| level.first).chain([self.entries()])
    }

    /// Features of all levels.
    pub(super) fn width(&self) -> usize {
        self.levels.len() * self.features
    }

    /// The features of a position, 0 to 1 along each axis, level by level.
    pub(super) fn encode(
        &self,
        table: &[f32],
        position: [f64; 3],
        mut put: impl FnMut(usize, f32),
    ) {
        for (number, level) in self.levels.iter().enumerate() {
            let mut axes = [(0u32, 0.0); 3];
            for (axis, at) in axes.iter_mut().zip(position) {
                // Nothing is stored beyond the box, and far positions have no node.
                let at = at.clamp(0.0, 1.0) * f64::from(level.scale) + 0.5;
                let low = at.floor();
                #[expect(clippy::cast_possible_truncation, reason = "within the level's nodes")]
                let node = low as u32;
                *axis = (node, at - low);
            }
            let mut sums = [0.0; 8];
            for corner in 0..8u32 {
                let (mut weight, mut node) = (1.0, [0; 3]);
                for (axis, (node, (low, share))) in node.iter_mut().zip(axes).enumerate() {
                    let up = corner >> axis & 1;
                    weight *= if up == 1 { share } else { 1.0 - share };
                    *node = low + up;
                }
                let first = level.entry(node).saturating_mul(self.features);
                let stored = table.get(first..first + self.features).unwrap_or_default();
                let terms = sums.iter_mut().zip(stored);
                terms.for_each(|(sum, value)| *sum += weight * f64::from(*value));
            }
            for (feature, sum) in sums.into_iter().take(self.features).enumerate() {
                #[expect(clippy::cast_possible_truncation, reason = "networks are float32")]
                put(number * self.features + feature, sum as f32);
            }
        }
    }
}

impl Level {
    fn entry(&self, node: [u32; 3]) -> usize {
        let entry = if self.hashed {
            let parts = node.into_iter().zip(PRIMES).map(|(at, prime)| at.wrapping_mul(prime));
            parts.fold(0, |hash, part| hash ^ part)
        } else {
            let [x, y, z] = node;
            x.wrapping_add(y.wrapping_mul(self.size))
                .wrapping_add(z.wrapping_mul(self.size.wrapping_mul(self.size)))
        };
        let entry = u64::from(entry % self.entries.max(1)) + self.first;
        usize::try_from(entry).unwrap_or(usize::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries(levels: u64, features: u64, finest: f64) -> u64 {
        let sizes = Sizes { levels, features, log2_entries: 19, base: 16, more: 0 };
        let ratio = libm::expf(libm::logf(finest as f32 / 16.0) / (levels - 1) as f32);
        let layout = sizes.layout(libm::log2f(ratio), &Place::File).expect("levels");
        layout.entries()
    }

    #[test]
    fn tables_are_as_large_as_published_ones() {
        // Counted from the official formulas in NumPy's float32.
        assert_eq!(entries(8, 4, 2048.0), 2_920_448);
        assert_eq!(entries(16, 2, 2048.0), 6_098_120);
        assert_eq!(entries(8, 4, 4.0 * 2048.0), 3_213_824);
        assert_eq!(entries(16, 2, 16.0 * 2048.0), 6_811_592);
    }

    #[test]
    fn positions_far_away_have_the_features_of_the_faces() {
        let sizes = Sizes { levels: 2, features: 1, log2_entries: 10, base: 4, more: 0 };
        let layout = sizes.layout(1.0, &Place::File).expect("levels");
        let table: Vec<f32> = (0..layout.entries()).map(|entry| entry as f32).collect();
        let features = |position: [f64; 3]| {
            let mut found = [0.0; 2];
            layout.encode(&table, position, |number, value| found[number] = value);
            found
        };
        assert_eq!(features([1e300, 0.5, -1e300]), features([1.0, 0.5, 0.0]));
        assert_eq!(features([f64::INFINITY, 5e9, 0.25]), features([1.0, 1.0, 0.25]));
        features([f64::NAN; 3]);
    }

    #[test]
    fn sizes_beyond_reason_are_refused() {
        let sizes =
            Sizes { levels: 1_000_000_000, features: 2, log2_entries: 19, base: 16, more: 0 };
        assert!(sizes.layout(1.0, &Place::File).is_err());
        let sizes = Sizes { levels: 16, ..sizes };
        assert!(sizes.layout(99.0, &Place::File).is_err());
        assert!(sizes.layout(f32::NAN, &Place::File).is_err());
    }
}
