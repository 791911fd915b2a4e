//! The ratio of the sizes of levels, which snapshots do not state.
//!
//! It is `exp(ln(finest / first) / (levels - 1))` in float32, and one float more or less moves the
//! finest nodes of large scenes by hundredths. Machines differ by that float, so one configuration
//! has two known parameter counts. The number of parameters determines the ratio only sometimes.
//! Otherwise, the ratio here is NumPy's, with which the reference rays were computed.

/// NumPy's `exp`: Cody-Waite reduction and a rational function, with fused multiply-adds.
#[expect(clippy::cast_possible_truncation, reason = "float32")]
fn exp(x: f32) -> f32 {
    const LN_2: [f32; 2] = [-6.931_457_5e-1, -1.428_606_8e-6];
    const ABOVE: [f32; 6] =
        [5.082_763e-4, 6.757_897e-3, 5.114_512e-2, 0.247_361_54, 0.725_766_5, 1.0];
    const BELOW: [f32; 3] = [2.159_509_4e-2, -0.274_233_55, 1.0];
    // A product of two float32 numbers is exact in float64.
    let fused = |a: f32, b: f32, c: f32| (f64::from(a) * f64::from(b) + f64::from(c)) as f32;
    let twos = libm::rintf(x * std::f32::consts::LOG2_E);
    let rest = LN_2.iter().fold(x, |rest, ln| fused(twos, *ln, rest));
    let sum = |of: &[f32]| of.iter().copied().reduce(|sum, term| fused(sum, rest, term));
    let quotient = sum(&ABOVE).unwrap_or(1.0) / sum(&BELOW).unwrap_or(1.0);
    quotient * libm::exp2f(twos)
}

/// The ratio of levels from `first` nodes along an axis to `finest`.
#[expect(clippy::cast_possible_truncation, reason = "float32")]
pub(super) fn ratio(levels: u64, first: u64, finest: f64) -> f32 {
    if levels < 2 {
        return 1.0;
    }
    let log = libm::log(f64::from(finest as f32 / first as f32)) as f32;
    exp(log / (levels - 1) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_those_of_numpy() {
        let scales = [
            (6, 4.0, 3.482_202),
            (8, 16.0, 2.971_988_7),
            (8, 1.0, 2.0),
            (16, 1.0, 1.381_912_8),
            (16, 16.0, 1.662_475_8),
        ];
        for (levels, cubes, expected) in scales {
            let found = ratio(levels, 16, 2048.0 * cubes);
            assert!(found.to_bits() == f32::to_bits(expected), "{levels}: {found:e}");
        }
        assert_eq!(ratio(1, 16, 2048.0), 1.0);
    }
}
