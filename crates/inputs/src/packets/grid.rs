//! A table of features, evaluated at many positions at once.

use super::encode::Coordinates;
use super::kernels::Kernels;
use super::levels::Levels;
use super::real::{LANES, Lanes};

/// A table with its levels.
#[derive(Debug)]
pub struct HashGrid {
    /// Its levels.
    pub levels: Levels,
    /// All entries, feature by feature.
    pub table: Vec<f32>,
}

impl HashGrid {
    /// Features of positions, level by level.
    pub fn encode<T: Kernels>(&self, at: &Coordinates, out: &mut Vec<Lanes<T>>) {
        out.clear();
        out.resize(self.levels.width(), [T::default(); LANES]);
        T::encode(&self.levels, &self.table, at, out);
    }
}

/// Up to [`LANES`] positions as a packet; the others are 0.
pub fn gathered(positions: &[[f64; 3]]) -> Coordinates {
    let mut at = [[0.0; LANES]; 3];
    for (lane, position) in positions.iter().enumerate() {
        for (axis, value) in at.iter_mut().zip(position) {
            if let Some(out) = axis.get_mut(lane) {
                *out = *value;
            }
        }
    }
    at
}

#[cfg(test)]
mod tests {
    use super::super::levels::{Level, Sizes};
    use super::*;
    use crate::base::error::Place;

    /// Factors of the coordinates in a hash.
    const PRIMES: [u64; 3] = [1, 2_654_435_761, 805_459_861];

    /// The features of a level at a position, directly from the rules, in integers and float64.
    fn plain(level: &Level, shift: f64, features: usize, table: &[f32], at: [f64; 3]) -> Vec<f64> {
        let places = at.map(|at| at.clamp(0.0, 1.0) * f64::from(level.scale) + shift);
        let mut sums = vec![0.0; features];
        for corner in 0..8 {
            let (mut weight, mut node) = (1.0, [0u64; 3]);
            for axis in 0..3 {
                let (low, up) = (places[axis].floor(), corner >> axis & 1);
                let share = places[axis] - low;
                weight *= if up == 1 { share } else { 1.0 - share };
                node[axis] = low as u64 + up;
            }
            let size = u64::from(level.size);
            let entry = match level.hashed {
                true => (0..3).fold(0, |hash, axis| hash ^ (node[axis] * PRIMES[axis])),
                false => node[0] + node[1] * size + node[2] * size * size,
            };
            let row = (level.first + entry % u64::from(level.entries)) as usize * features;
            for (sum, value) in sums.iter_mut().zip(&table[row..row + features]) {
                *sum += weight * f64::from(*value);
            }
        }
        sums
    }

    /// Numbers from 0 to 1.
    fn noise(seed: &mut u32) -> f64 {
        *seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(*seed >> 8) / f64::from(1 << 24)
    }

    fn held<T: Kernels>(grid: &HashGrid, positions: &[[f64; 3]], most: f64) {
        let mut found: Vec<Lanes<T>> = Vec::new();
        grid.encode(&gathered(positions), &mut found);
        let (features, shift) = (grid.levels.features, grid.levels.shift);
        for (lane, position) in positions.iter().enumerate() {
            let of_level = |level: &Level| plain(level, shift, features, &grid.table, *position);
            let expected = grid.levels.levels.iter().flat_map(of_level);
            for (found, expected) in found.iter().zip(expected) {
                assert!((found[lane].wide() - expected).abs() < most, "{position:?}: {expected}");
            }
        }
    }

    #[test]
    fn packets_agree_with_the_rules() {
        let seed = &mut 11;
        for features in 1..=8 {
            let sizes = Sizes { levels: 5, features, log2_entries: 9, base: 3, more: 0 };
            for levels in [
                sizes.levels(0.7, &Place::File).expect("levels"),
                sizes.hashed_levels(40, &Place::File).expect("levels"),
            ] {
                let count = levels.entries() * features;
                let table = (0..count).map(|_| noise(seed) as f32 - 0.5).collect();
                let grid = HashGrid { levels, table };
                let mut positions: Vec<[f64; 3]> =
                    (0..LANES - 3).map(|_| [(); 3].map(|()| noise(seed))).collect();
                positions.extend([[0.0; 3], [1.0; 3], [1.0, 0.5, 0.0]]);
                held::<f64>(&grid, &positions, 1e-13);
                held::<f32>(&grid, &positions, 1e-6);
                held::<f64>(&grid, &positions[..3], 1e-13);
            }
        }
    }

    #[test]
    fn positions_far_away_have_the_features_of_the_faces() {
        let sizes = Sizes { levels: 2, features: 1, log2_entries: 10, base: 4, more: 0 };
        let levels = sizes.levels(1.0, &Place::File).expect("levels");
        let table: Vec<f32> = (0..levels.entries()).map(|entry| entry as f32).collect();
        let grid = HashGrid { levels, table };
        let features = |position: [f64; 3]| {
            let mut found: Vec<Lanes<f32>> = Vec::new();
            grid.encode(&gathered(&[position]), &mut found);
            [found[0][0], found[1][0]]
        };
        assert_eq!(features([1e300, 0.5, -1e300]), features([1.0, 0.5, 0.0]));
        assert_eq!(features([f64::INFINITY, 5e9, 0.25]), features([1.0, 1.0, 0.25]));
        features([f64::NAN; 3]);
    }
}
