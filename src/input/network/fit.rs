//! Harmonics in place of colours that were evaluated along directions all around.

use crate::model::harmonics::{FUNCTIONS, basis_f64};

/// Directions in which colours are evaluated.
const DIRECTIONS: u32 = 48;
/// Weight of the penalty on a band `l`: this times `(l (l + 1))^2`.
const PENALTY: f64 = 1e-5;

/// A linear map from colours along fixed directions to coefficients, by least squares.
#[derive(Debug)]
pub struct Fit {
    /// Unit directions, evenly spread.
    pub directions: Vec<[f64; 3]>,
    /// For each direction its share in each coefficient.
    shares: Vec<Vec<f64>>,
    functions: usize,
}

impl Fit {
    /// Of harmonics with so many functions.
    pub fn new(functions: usize) -> Self {
        let directions = spread();
        let rows: Vec<[f64; FUNCTIONS]> = directions.iter().map(|&at| basis_f64(at)).collect();
        let scale = 1.0 / f64::from(DIRECTIONS);
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
        let share = |direction: usize| {
            let of_row = |row: &Vec<f64>| row.get(functions + direction).copied().unwrap_or(0.0);
            system.iter().map(of_row).collect()
        };
        let shares = (0..directions.len()).map(share).collect();
        Self { directions, shares, functions }
    }

    /// The coefficients of colours along the directions, function by function, each red, green
    /// and blue.
    pub fn coefficients(&self, colors: impl Iterator<Item = [f64; 3]>) -> Vec<f64> {
        let mut sums = vec![0.0; 3 * self.functions];
        for (color, shares) in colors.zip(&self.shares) {
            for (sums, share) in sums.chunks_exact_mut(3).zip(shares) {
                sums.iter_mut().zip(color).for_each(|(sum, value)| *sum += share * value);
            }
        }
        sums
    }
}

/// Points of a spiral on the sphere, at equal steps of height.
fn spread() -> Vec<[f64; 3]> {
    let turn = std::f64::consts::PI * (3.0 - 5.0f64.sqrt());
    let at = |number: u32| {
        let z = 1.0 - (2.0 * f64::from(number) + 1.0) / f64::from(DIRECTIONS);
        let (radius, angle) = ((1.0 - z * z).sqrt(), turn * f64::from(number));
        [radius * libm::cos(angle), radius * libm::sin(angle), z]
    };
    (0..DIRECTIONS).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_that_are_harmonics_are_found_again() {
        for functions in [1, 4, 9, 16] {
            let fit = Fit::new(functions);
            let stored: Vec<f64> = (0..functions).map(|at| 0.3 - 0.05 * at as f64).collect();
            let colors = fit.directions.iter().map(|&at| {
                let terms = basis_f64(at).into_iter().zip(&stored);
                [terms.map(|(function, value)| function * value).sum(), 0.0, 0.0]
            });
            let found = fit.coefficients(colors);
            for (function, expected) in stored.iter().enumerate() {
                let off = (found[3 * function] - expected).abs();
                assert!(off < 0.03, "{functions}: {function} is {off} off");
                assert!(found[3 * function + 1].abs() < 1e-9);
            }
        }
    }
}
