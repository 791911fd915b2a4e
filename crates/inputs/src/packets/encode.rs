//! The features of positions.

use super::levels::{Level, Levels};
use super::real::{LANES, Lanes, Real};

/// Positions of a packet, 0 to 1 along each axis.
pub type Coordinates = [Lanes<f64>; 3];

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
    pub fn encode<T: Real>(&self, at: &Coordinates, out: &mut Vec<Lanes<T>>) {
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

/// See [`Real::encode`].
#[inline(always)]
pub(super) fn encode<T: Real>(
    levels: &Levels,
    table: &[f32],
    at: &Coordinates,
    out: &mut [Lanes<T>],
) {
    match levels.features {
        1 => each::<T, 1>(levels, table, at, out),
        2 => each::<T, 2>(levels, table, at, out),
        3 => each::<T, 3>(levels, table, at, out),
        4 => each::<T, 4>(levels, table, at, out),
        5 => each::<T, 5>(levels, table, at, out),
        6 => each::<T, 6>(levels, table, at, out),
        7 => each::<T, 7>(levels, table, at, out),
        // `Sizes::check` refuses more.
        _ => each::<T, 8>(levels, table, at, out),
    }
}

#[inline(always)]
fn each<T: Real, const F: usize>(
    levels: &Levels,
    table: &[f32],
    at: &Coordinates,
    out: &mut [Lanes<T>],
) {
    let rows = table.as_chunks::<F>().0;
    for (level, out) in levels.levels.iter().zip(out.as_chunks_mut::<F>().0) {
        // A table is as long as its levels say.
        let first = usize::try_from(level.first).unwrap_or(usize::MAX);
        let rows = rows.get(first..).unwrap_or_default();
        one(level, levels.shift, rows, at, out);
    }
}

/// The features of a level. A node's entry is joined from numbers of its coordinates.
#[inline(always)]
fn one<T: Real, const F: usize>(
    level: &Level,
    shift: f64,
    rows: &[[f32; F]],
    at: &Coordinates,
    out: &mut [Lanes<T>; F],
) {
    let scale = f64::from(level.scale);
    // Of the lower and the upper node along each axis.
    let mut numbers = [[[0u32; LANES]; 2]; 3];
    let mut shares = [[[T::default(); LANES]; 2]; 3];
    let axes = numbers.iter_mut().zip(&mut shares).zip(at).zip(level.factors());
    for ((([low, high], [away, near]), at), factor) in axes {
        let lanes = low.iter_mut().zip(high).zip(away.iter_mut().zip(near)).zip(at);
        for (((low, high), (away, near)), at) in lanes {
            // Nothing is stored beyond the box, and far positions have no node.
            let at = at.clamp(0.0, 1.0) * scale + shift;
            let floor = at.floor();
            #[expect(clippy::cast_possible_truncation, reason = "within the level's nodes")]
            let node = floor as u32;
            (*low, *high) = (node.wrapping_mul(factor), (node + 1).wrapping_mul(factor));
            (*away, *near) = (T::of(1.0 - (at - floor)), T::of(at - floor));
        }
    }
    let ([xs, ys, zs], [by_x, by_y, by_z]) = (&numbers, &shares);
    let entries = level.entries;
    let entry = |x: u32, y: u32, z: u32| {
        if level.hashed {
            // A power of 2.
            (x ^ y ^ z) & (entries - 1)
        } else {
            // The last node of an axis may be one beyond those that are counted.
            let sum = x.wrapping_add(y).wrapping_add(z);
            if sum >= entries { sum - entries } else { sum }
        }
    };
    *out = [[T::default(); LANES]; F];
    for (z, by_z) in zs.iter().zip(by_z) {
        for (y, by_y) in ys.iter().zip(by_y) {
            for (x, by_x) in xs.iter().zip(by_x) {
                let mut found = [0u32; LANES];
                for (found, ((x, y), z)) in found.iter_mut().zip(x.iter().zip(y).zip(z)) {
                    *found = entry(*x, *y, *z);
                }
                let mut weights = [T::default(); LANES];
                for (weight, ((x, y), z)) in weights.iter_mut().zip(by_x.iter().zip(by_y).zip(by_z))
                {
                    *weight = *x * *y * *z;
                }
                for (lane, (entry, weight)) in found.into_iter().zip(weights).enumerate() {
                    let row = rows.get(entry as usize).copied().unwrap_or([0.0; F]);
                    for (out, value) in out.iter_mut().zip(row) {
                        if let Some(sum) = out.get_mut(lane) {
                            *sum += weight * T::of_stored(value);
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::levels::Sizes;
    use super::*;
    use crate::base::error::Place;

    /// Factors of the coordinates in a hash.
    const PRIMES: [u64; 3] = [1, 2_654_435_761, 805_459_861];

    /// The features of a level at a position, in whole numbers and float64 from the rules alone.
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

    fn held<T: Real>(grid: &HashGrid, positions: &[[f64; 3]], most: f64) {
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
