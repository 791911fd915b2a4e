//! Harmonics in place of colours along directions, by ridge regression.
//!
//! ```text
//! minimise  mean over directions of (sum of c_i Y_i(d) - colour(d))^2
//!           + PENALTY sum of (l (l + 1))^2 c_i^2,   l the band of function i
//! ```
//!
//! The penalty grows with the band, so that high bands stay small where directions do not determine
//! them.

use multiversion::multiversion;

use crate::model::harmonics::{FUNCTIONS, basis_f64};

/// Weight of the penalty on coefficients.
const PENALTY: f64 = 1e-5;

/// A linear map from colours along directions to coefficients.
#[derive(Debug)]
pub struct Fit {
    /// For each direction, the weight of its colour in each coefficient.
    shares: Vec<[f64; FUNCTIONS]>,
    functions: usize,
}

impl Fit {
    /// For this many functions and colours along these unit directions.
    pub fn new(directions: &[[f64; 3]], functions: usize) -> Self {
        let rows: Vec<[f64; FUNCTIONS]> = directions.iter().map(|&at| basis_f64(at)).collect();
        let scale = 1.0 / directions.len().max(1) as f64;
        // [normal matrix | values of the functions along each direction], reduced to the identity.
        let mut system: Vec<Vec<f64>> = (0..functions)
            .map(|function| {
                let value = |row: &[f64; FUNCTIONS]| row.get(function).copied().unwrap_or(0.0);
                let products = (0..functions).map(|other| {
                    let of = |row: &[f64; FUNCTIONS]| row.get(other).copied().unwrap_or(0.0);
                    let sum: f64 = rows.iter().map(|row| value(row) * of(row)).sum();
                    let band = function.isqrt() as f64;
                    let penalty = PENALTY * (band * (band + 1.0)).powi(2);
                    scale * sum + if other == function { penalty } else { 0.0 }
                });
                let products: Vec<f64> = products.collect();
                products.into_iter().chain(rows.iter().map(|row| scale * value(row))).collect()
            })
            .collect();
        for pivot in 0..functions {
            // The matrix is symmetric and positive: no pivot is 0.
            let Some(mut row) = system.get(pivot).cloned() else { continue };
            let by = row.get(pivot).copied().unwrap_or(1.0);
            row.iter_mut().for_each(|value| *value /= by);
            for (number, other) in system.iter_mut().enumerate() {
                if number == pivot {
                    other.clone_from(&row);
                    continue;
                }
                let factor = other.get(pivot).copied().unwrap_or(0.0);
                other.iter_mut().zip(&row).for_each(|(value, of)| *value -= factor * of);
            }
        }
        let mut shares = vec![[0.0; FUNCTIONS]; directions.len()];
        for (function, row) in system.iter().enumerate() {
            for (shares, value) in shares.iter_mut().zip(row.iter().skip(functions)) {
                if let Some(share) = shares.get_mut(function) {
                    *share = *value;
                }
            }
        }
        Self { shares, functions }
    }

    /// The coefficients of colours along the directions, each red, green and blue: function by
    /// function, red, green, blue of each.
    pub fn coefficients(&self, colors: &[Vec<f64>; 3]) -> impl Iterator<Item = f64> + use<> {
        let mut sums = [[0.0; FUNCTIONS]; 3];
        for (sums, colors) in sums.iter_mut().zip(colors) {
            add_shares(&self.shares, colors, sums);
        }
        let [red, green, blue] = sums;
        let all = red.into_iter().zip(green).zip(blue);
        all.flat_map(|((red, green), blue)| [red, green, blue]).take(3 * self.functions)
    }
}

/// Adds the contribution of each direction's colour to all coefficients, direction by direction.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn add_shares(shares: &[[f64; FUNCTIONS]], colors: &[f64], sums: &mut [f64; FUNCTIONS]) {
    for (shares, color) in shares.iter().zip(colors) {
        sums.iter_mut().zip(shares).for_each(|(sum, share)| *sum += share * color);
    }
}

#[cfg(test)]
mod tests {
    use super::super::views::Views;
    use super::*;

    #[test]
    fn colours_that_are_harmonics_are_found_again() {
        let Views::Around(around) = Views::new(&[]) else { panic!("no cameras") };
        let half: Vec<[f64; 3]> = around.iter().copied().filter(|[x, y, _]| x + y > 0.1).collect();
        for (directions, most) in [(around, 0.03), (half, 0.05)] {
            for functions in [1, 4, 9, 16] {
                let fit = Fit::new(&directions, functions);
                let stored: Vec<f64> = (0..functions).map(|at| 0.3 - 0.05 * at as f64).collect();
                let color = |at: &[f64; 3]| -> f64 {
                    let terms = basis_f64(*at).into_iter().zip(&stored);
                    terms.map(|(function, value)| function * value).sum()
                };
                let red: Vec<f64> = directions.iter().map(color).collect();
                let zero = vec![0.0; directions.len()];
                let colors = [red.clone(), zero.clone(), zero];
                let found: Vec<f64> = fit.coefficients(&colors).collect();
                assert!(found.iter().skip(1).step_by(3).all(|green| *green == 0.0));
                // Only colours along the directions must match, not undetermined coefficients.
                for (at, expected) in directions.iter().zip(&red) {
                    let terms = basis_f64(*at).into_iter().zip(found.iter().step_by(3));
                    let shown: f64 = terms.map(|(function, value)| function * value).sum();
                    let off = (shown - expected).abs();
                    assert!(off < most, "{functions} functions: {off} off");
                }
            }
        }
    }
}
