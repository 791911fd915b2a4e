//! The activations of one f64, by `libm`: the same bits on every machine.

/// `ln(1 + exp(x))` without overflow or loss.
pub fn softplus(x: f64) -> f64 {
    x.max(0.0) + libm::log1p(libm::exp(-x.abs()))
}

/// The inverse of [`softplus`]: `ln(exp(y) - 1)`; minus infinity at 0.
pub fn inverse_softplus(y: f64) -> f64 {
    // exp(y) overflows beyond 709; there softplus is the identity to the last bit.
    if y > 40.0 { y } else { libm::log(libm::expm1(y)) }
}

/// `1 / (1 + exp(-x))`.
pub fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + libm::exp(-x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn densities_and_raw_values_are_inverse() {
        for y in [1e-30, 1e-6, 0.3, 0.999, 1.0, 1.001, 7.0, 100.0, 1e30] {
            let back = softplus(inverse_softplus(y));
            assert!((back - y).abs() <= 1e-13 * y, "{y} {back}");
        }
        assert_eq!(softplus(inverse_softplus(0.0)), 0.0);
    }
}
