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

/// Opacity over `interval` of a raw value, 0 to 1.
pub fn opacity(raw: f64, shift: f64, interval: f64) -> f64 {
    -libm::expm1(-softplus(raw + shift) * interval)
}

/// The raw value of this opacity over `interval`. Minus infinity at 0, infinity at 1.
pub fn raw_at_opacity(opacity: f64, shift: f64, interval: f64) -> f64 {
    inverse_softplus(-libm::log1p(-opacity) / interval) - shift
}

/// The steepest slope of opacity over raw values: opacity moves by at most this much for each
/// unit of raw density.
///
/// With `s = sigmoid(x)`, `d alpha / dx = interval * s * (1 - s)^interval`, which is largest at
/// `s = 1 / (1 + interval)`.
pub fn opacity_slope(interval: f64) -> f64 {
    let s = 1.0 / (1.0 + interval);
    interval * s * libm::exp(interval * libm::log1p(-s))
}

/// `1 / (1 + exp(-x))`.
pub fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + libm::exp(-x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threshold_and_opacity_are_inverse() {
        for interval in [1e-7, 0.25, 0.5, 1.0, 1e5] {
            for target in [1e-12, 1e-6, 1e-3, 0.5, 0.9999] {
                let raw = raw_at_opacity(target, -4.6, interval);
                let back = opacity(raw, -4.6, interval);
                assert!((back - target).abs() <= 1e-12 * target.max(1e-3), "{interval} {target}");
            }
        }
        assert_eq!(opacity(-1e30, 0.0, 0.5), 0.0);
        assert_eq!(opacity(1e30, 0.0, 0.5), 1.0);
    }

    #[test]
    fn no_slope_is_steeper_than_stated() {
        for interval in [0.01, 0.25, 0.5, 1.0, 4.0] {
            let steepest = (-4000..4000)
                .map(|i| f64::from(i) * 0.01)
                .map(|x| {
                    (opacity(x + 0.005, 0.0, interval) - opacity(x - 0.005, 0.0, interval)) * 100.0
                })
                .fold(0.0, f64::max);
            let stated = opacity_slope(interval);
            assert!(steepest <= stated && steepest > 0.999 * stated, "{steepest} {stated}");
        }
    }
}
