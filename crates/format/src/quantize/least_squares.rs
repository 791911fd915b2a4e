//! Weights of predictions by least squares.

use super::predict::WEIGHTS;
use super::sums::PRODUCTS;

/// The least-squares weights of predictions, in 32nds, from the sums of products of terms
/// ([`super::sums::Sums`]). A term that depends linearly on those before it gets 0.
pub fn weights(products: &[f64; PRODUCTS], terms: usize) -> [i8; WEIGHTS] {
    let product = |row: usize, column: usize| products[row * (row + 1) / 2 + column];
    // The decomposition L D L^T, and L z = the products with the predicted value, on the way.
    let mut lower = [[0.0; WEIGHTS]; WEIGHTS];
    let (mut diagonal, mut z) = ([0.0; WEIGHTS], [0.0; WEIGHTS]);
    for row in 0..terms {
        for column in 0..=row {
            let known = |i: usize| lower[row][i] * lower[column][i] * diagonal[i];
            let left = (0..column).fold(product(row, column), |left, i| left - known(i));
            if column < row {
                lower[row][column] =
                    if diagonal[column] > 0.0 { left / diagonal[column] } else { 0.0 };
            } else {
                // A remainder that is only rounding error is not a term: the other terms explain
                // it.
                diagonal[row] = if left > 1e-9 * product(row, row) { left } else { 0.0 };
            }
        }
        z[row] = (0..row).fold(product(WEIGHTS, row), |left, i| left - lower[row][i] * z[i]);
    }
    let mut solution = [0.0; WEIGHTS];
    for row in (0..terms).rev() {
        let scaled = if diagonal[row] > 0.0 { z[row] / diagonal[row] } else { 0.0 };
        let known = |i: usize| lower[i][row] * solution[i];
        solution[row] = (row + 1..terms).fold(scaled, |left, i| left - known(i));
        if diagonal[row] == 0.0 {
            solution[row] = 0.0;
        }
    }
    solution.map(|weight: f64| (32.0 * weight).round_ties_even().clamp(-127.0, 127.0) as i8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn products(samples: &[[f64; WEIGHTS + 1]]) -> [f64; PRODUCTS] {
        let mut sums = [0.0; PRODUCTS];
        for sample in samples {
            for row in 0..=WEIGHTS {
                for column in 0..=row {
                    sums[row * (row + 1) / 2 + column] += sample[row] * sample[column];
                }
            }
        }
        sums
    }

    #[test]
    fn weights_that_made_the_values_are_found() {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f64 / 2f64.powi(24) - 0.5
        };
        let made = [31, -7, 12, 0, -127];
        let samples: Vec<_> = (0..200)
            .map(|_| {
                let mut sample = [0.0; WEIGHTS + 1].map(|_| random());
                sample[WEIGHTS] = (0..WEIGHTS).map(|i| sample[i] * f64::from(made[i]) / 32.0).sum();
                sample
            })
            .collect();
        assert_eq!(weights(&products(&samples), WEIGHTS), made);
        let few: Vec<_> =
            samples.iter().map(|s| [s[0], s[1], s[2], 0.0, 0.0, s[0] / 2.0]).collect();
        assert_eq!(weights(&products(&few), 3), [16, 0, 0, 0, 0]);
    }

    #[test]
    fn terms_that_say_nothing_get_no_weight() {
        assert_eq!(weights(&[0.0; PRODUCTS], WEIGHTS), [0; WEIGHTS]);
        let samples: Vec<_> = (1..50).map(f64::from).map(|x| [x, 2.0 * x, 0.0, x, x, x]).collect();
        let found = weights(&products(&samples), WEIGHTS);
        assert_eq!(found, [32, 0, 0, 0, 0]);
    }
}
