//! The levels of a table of features.
//!
//! Those of tiny-cuda-nn:
//!
//! ```text
//! scale = base b^l - 1,  size = ceil(scale) + 1
//! position in a level = position (0 to 1) scale + 1/2
//! entry = x + y s + z s^2 where all nodes have one, else x ^ 2654435761 y ^ 805459861 z
//! ```
//!
//! Entries are taken modulo the level's number, because the last node of an axis may be one beyond
//! it.

use crate::base::error::{Error, Place, Result};

/// Levels, at most.
const MOST_LEVELS: u64 = 64;
/// Binary logarithm of the entries of a level, at most.
const MOST_LOG2: u64 = 28;
/// Nodes along an axis of the first level, at most.
const MOST_BASE: u64 = 1 << 12;
/// Entries of levels are multiples of this.
const MULTIPLE: u64 = 8;
/// Added to positions in nodes by tiny-cuda-nn.
const HALF: f64 = 0.5;
/// Factors of the coordinates in a hash.
const PRIMES: [u32; 3] = [1, 2_654_435_761, 805_459_861];

/// A level.
#[derive(Debug, Clone, PartialEq)]
pub struct Level {
    pub(super) scale: f32,
    /// Nodes along an axis, as entries are counted.
    pub(super) size: u32,
    /// A power of 2 where they are shared.
    pub(super) entries: u32,
    /// True if nodes share entries.
    pub(super) hashed: bool,
    /// Entries of the levels before it.
    pub(super) first: u64,
}

/// All levels.
#[derive(Debug, Clone, PartialEq)]
pub struct Levels {
    pub(super) levels: Vec<Level>,
    /// Features of an entry.
    pub(super) features: usize,
    /// Added to positions in nodes.
    pub(super) shift: f64,
}

/// The parameters that determine levels.
#[derive(Debug, Clone, Copy)]
pub struct Sizes {
    pub levels: u64,
    pub features: u64,
    /// Binary logarithm of the most entries of a level.
    pub log2_entries: u64,
    /// Nodes along an axis of the first level, about.
    pub base: u64,
    /// Additional nodes along an axis for counting entries.
    pub more: u32,
}

impl Sizes {
    /// Refuses unrealistic sizes.
    ///
    /// # Errors
    /// `Malformed`, at `place`.
    pub fn check(&self, place: &Place) -> Result<()> {
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

    /// Levels whose sizes grow by a ratio, given as its binary logarithm. Both programs compute
    /// scales in float32; as there, each function rounds once.
    ///
    /// # Errors
    /// `Malformed` for levels of 2^20 nodes along an axis or more.
    pub fn levels(&self, log2_ratio: f32, place: &Place) -> Result<Levels> {
        self.check(place)?;
        let mut levels = Vec::new();
        let mut first = 0;
        for number in 0..self.levels {
            let (number, base) = (number as f32, self.base as f32);
            #[expect(clippy::cast_possible_truncation, reason = "float32")]
            let growth = libm::exp2(f64::from(number * log2_ratio)) as f32;
            let scale = growth * base - 1.0;
            let size = checked_size(libm::ceilf(scale) + 1.0, place)? + self.more;
            let nodes = u64::from(size).pow(3);
            let entries = nodes.next_multiple_of(MULTIPLE).min(1 << self.log2_entries);
            let narrow = u32::try_from(entries).unwrap_or(u32::MAX);
            levels.push(Level { scale, size, entries: narrow, hashed: nodes > entries, first });
            first += entries;
        }
        Ok(self.of(levels, HALF))
    }

    /// The levels of nerfstudio's own tables, which are all hashed, from the first to the finest
    /// size. The power is PyTorch's for an integer exponent, in float32.
    ///
    /// ```text
    /// size = floor(base b^l),  b = (finest / base)^(1 / (levels - 1))
    /// position in a level = position (0 to 1) size
    /// ```
    ///
    /// # Errors
    /// `Malformed` for levels of 2^20 nodes along an axis or more.
    pub fn hashed_levels(&self, finest: u64, place: &Place) -> Result<Levels> {
        self.check(place)?;
        let steps = self.levels.saturating_sub(1).max(1) as f64;
        let [base, finest] = [self.base, finest].map(|size| size as f64);
        let ratio = match self.levels {
            1 => 1.0,
            _ => libm::exp((libm::log(finest) - libm::log(base)) / steps),
        };
        #[expect(clippy::cast_possible_truncation, reason = "float32")]
        let ratio = f64::from(ratio as f32);
        let mut levels = Vec::new();
        for number in 0..self.levels {
            #[expect(clippy::cast_possible_truncation, reason = "float32")]
            let growth = libm::pow(ratio, number as f64) as f32;
            let scale = libm::floorf(self.base as f32 * growth);
            let size = checked_size(scale, place)?;
            let (entries, first) = (1 << self.log2_entries, number << self.log2_entries);
            levels.push(Level { scale, size, entries, hashed: true, first });
        }
        Ok(self.of(levels, 0.0))
    }

    fn of(&self, levels: Vec<Level>, shift: f64) -> Levels {
        Levels { levels, features: usize::try_from(self.features).unwrap_or(1), shift }
    }
}

/// A number of nodes along an axis.
fn checked_size(size: f32, place: &Place) -> Result<u32> {
    // Compared as floats: a cast would saturate.
    if !(size >= 1.0 && size < (1u32 << 20) as f32) {
        let found = format!("a level of {size} nodes along an axis");
        return Err(Error::malformed(place.clone(), found, "fewer than 2^20"));
    }
    #[expect(clippy::cast_possible_truncation, reason = "checked above")]
    Ok(size as u32)
}

impl Level {
    /// Factors of a node's coordinates; combining the products gives its entry.
    #[inline(always)]
    pub(super) fn factors(&self) -> [u32; 3] {
        if self.hashed { PRIMES } else { [1, self.size, self.size.wrapping_mul(self.size)] }
    }
}

impl Levels {
    /// Entries of all levels.
    pub fn entries(&self) -> u64 {
        self.levels.last().map_or(0, |level| level.first + u64::from(level.entries))
    }

    /// The first entry of each level, and the end of the last one.
    pub fn offsets(&self) -> impl Iterator<Item = u64> {
        self.levels.iter().map(|level| level.first).chain([self.entries()])
    }

    /// Features of all levels.
    pub fn width(&self) -> usize {
        self.levels.len() * self.features
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries(levels: u64, features: u64, log2_entries: u64, finest: f64) -> u64 {
        let sizes = Sizes { levels, features, log2_entries, base: 16, more: 0 };
        let ratio = libm::expf(libm::logf(finest as f32 / 16.0) / (levels - 1) as f32);
        let levels = sizes.levels(libm::log2f(ratio), &Place::File).expect("levels");
        levels.entries()
    }

    #[test]
    fn tables_are_as_large_as_published_ones() {
        // Counted from the official formulas in NumPy's float32.
        assert_eq!(entries(8, 4, 19, 2048.0), 2_920_448);
        assert_eq!(entries(16, 2, 19, 2048.0), 6_098_120);
        assert_eq!(entries(8, 4, 19, 4.0 * 2048.0), 3_213_824);
        assert_eq!(entries(16, 2, 19, 16.0 * 2048.0), 6_811_592);
        // Networks of proposals.
        assert_eq!(entries(5, 2, 17, 128.0), 766_528 / 2);
    }

    #[test]
    fn hashed_levels_are_as_large_as_nerfstudios() {
        // nerfstudio's own. In float64, the last of the first row would be 127, of the third 2048.
        let sizes = |levels: u64, finest: u64| {
            let sizes = Sizes { levels, features: 2, log2_entries: 9, base: 16, more: 0 };
            let levels = sizes.hashed_levels(finest, &Place::File).expect("levels").levels;
            levels.into_iter().map(|level| level.size).collect::<Vec<_>>()
        };
        assert_eq!(sizes(5, 128), [16, 26, 45, 76, 128]);
        assert_eq!(sizes(5, 256), [16, 32, 64, 128, 256]);
        assert_eq!(
            sizes(16, 2048),
            [16, 22, 30, 42, 58, 80, 111, 153, 212, 294, 406, 561, 776, 1072, 1482, 2047]
        );
        assert_eq!(sizes(1, 2048), [16]);
    }

    #[test]
    fn sizes_beyond_reason_are_refused() {
        let sizes =
            Sizes { levels: 1_000_000_000, features: 2, log2_entries: 19, base: 16, more: 0 };
        assert!(sizes.levels(1.0, &Place::File).is_err());
        let sizes = Sizes { levels: 16, ..sizes };
        assert!(sizes.levels(99.0, &Place::File).is_err());
        assert!(sizes.levels(f32::NAN, &Place::File).is_err());
    }
}
