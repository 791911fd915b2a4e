//! The features of positions.

use super::levels::{Level, Levels};
use super::real::{LANES, Lanes, Real};

/// Positions of a packet, 0 to 1 along each axis.
pub type Coordinates = [Lanes<f64>; 3];

/// The features of positions, level by level.
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
        // The levels determine the length of a table.
        let first = usize::try_from(level.first).unwrap_or(usize::MAX);
        let rows = rows.get(first..).unwrap_or_default();
        one(level, levels.shift, rows, at, out);
    }
}

/// The features of a level. A node's entry is combined from factors of its coordinates.
#[inline(always)]
fn one<T: Real, const F: usize>(
    level: &Level,
    shift: f64,
    rows: &[[f32; F]],
    at: &Coordinates,
    out: &mut [Lanes<T>; F],
) {
    let scale = f64::from(level.scale);
    // For the lower and the upper node along each axis.
    let mut numbers = [[[0u32; LANES]; 2]; 3];
    let mut shares = [[[T::default(); LANES]; 2]; 3];
    let axes = numbers.iter_mut().zip(&mut shares).zip(at).zip(level.factors());
    for ((([low, high], [away, near]), at), factor) in axes {
        let lanes = low.iter_mut().zip(high).zip(away.iter_mut().zip(near)).zip(at);
        for (((low, high), (away, near)), at) in lanes {
            // The table ends at the box, and far positions have no node.
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
            // The last node of an axis may be one beyond the counted nodes.
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
                // Reads are scalar, additions are vectorized.
                let mut values = [[0.0f32; LANES]; F];
                for (lane, entry) in found.into_iter().enumerate() {
                    let row = rows.get(entry as usize).copied().unwrap_or([0.0; F]);
                    for (values, value) in values.iter_mut().zip(row) {
                        if let Some(out) = values.get_mut(lane) {
                            *out = value;
                        }
                    }
                }
                for (out, values) in out.iter_mut().zip(&values) {
                    for ((sum, weight), value) in out.iter_mut().zip(&weights).zip(values) {
                        *sum += *weight * T::of_stored(*value);
                    }
                }
            }
        }
    }
}
