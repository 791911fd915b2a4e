//! Activations of several values at once, without branches or library calls, so that loops over
//! them are vectorized. Values are the same for any lane count and CPU.
//!
//! Tests bound the errors against the float64 functions of [`crate::model::activate`], over all
//! finite inputs: 3e-7 relative for [`exp`] (of results above 2e-35) and [`exp2`], 4e-7 relative
//! for [`softplus`], 6e-7 for [`opacity`], 4e-7 absolute for [`sigmoid`]; 1e-13
//! relative for [`ln`]; 3e-7 absolute and a rounding of the result for [`log2`].

use crate::model::generated::DensityFunction;

/// Adding 1.5 * 2^23 rounds to nearest without a library call, and leaves the integer in the lowest
/// bits: a conversion would saturate, which compilers do one lane at a time.
const ROUNDER: f32 = 12_582_912.0;

/// `exp(x)` for x in -80 to 88; beyond, the value at the end. The smallest result, 2e-35, avoids
/// subnormal numbers, which are slow.
///
/// `x = n ln 2 + r` with r within half of ln 2, `exp(r)` by its Taylor polynomial of degree 6
/// (whose remainder is 1.2e-7 relative at the ends, 4e-9 in the mean), and `2^n` by its exponent
/// bits.
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    let x = x.clamp(-80.0, 88.0);
    let rounded = x * std::f32::consts::LOG2_E + ROUNDER;
    let n = rounded - ROUNDER;
    // ln 2 in two parts, the first exact in products with small integers.
    let r = (x - n * 0.693_359_4) + n * 2.121_944_4e-4;
    near_0(r) * f32::from_bits(rounded.to_bits().wrapping_add(127) << 23)
}

/// `2^x` for x in -120 to 127; beyond, the value at the end. Exact of whole numbers. As [`exp`],
/// with `x = n + r / ln 2`.
#[inline(always)]
pub fn exp2(x: f32) -> f32 {
    let rounded = x.clamp(-120.0, 127.0) + ROUNDER;
    let r = (x.clamp(-120.0, 127.0) - (rounded - ROUNDER)) * std::f32::consts::LN_2;
    near_0(r) * f32::from_bits(rounded.to_bits().wrapping_add(127) << 23)
}

/// `exp(r)` for r within half of ln 2.
#[inline(always)]
fn near_0(r: f32) -> f32 {
    let p = 1.0 / 720.0;
    let p = p * r + 1.0 / 120.0;
    let p = p * r + 1.0 / 24.0;
    let p = p * r + 1.0 / 6.0;
    let p = p * r + 0.5;
    (p * r) * r + r + 1.0
}

/// `ln(1 + exp(x))`: `max(x, 0) + 2 atanh(y / (2 + y))` with `y = exp(-|x|)`, the series to z^13.
#[inline(always)]
pub fn softplus(x: f32) -> f32 {
    let y = exp(-x.abs());
    let z = y / (2.0 + y);
    // If squares would be subnormal, the series is 1 anyway.
    let s = z.max(1e-18) * z.max(1e-18);
    let series = 1.0 + s * (1.0 / 3.0 + s * (0.2 + s * (1.0 / 7.0 + s * (1.0 / 9.0 + s / 11.0))));
    x.max(0.0) + 2.0 * z * series
}

/// Density of a raw density, shifted.
#[inline(always)]
pub fn density(x: f32, function: DensityFunction) -> f32 {
    match function {
        DensityFunction::Softplus => softplus(x),
        DensityFunction::Relu => x.max(0.0),
    }
}

/// `1 - exp(-depth)` of an optical depth from 0: near 0 by its Taylor polynomial, so that faint
/// samples keep their digits.
#[inline(always)]
pub fn opacity(depth: f32) -> f32 {
    let far = 1.0 - exp(-depth);
    // If products would be subnormal, the series is 1 anyway.
    let d = depth.clamp(1e-18, 0.5);
    let series = 1.0 / 720.0 - d * (1.0 / 5040.0 - d * (1.0 / 40_320.0));
    let series = 1.0 / 24.0 - d * (1.0 / 120.0 - d * series);
    let series = 1.0 - d * (0.5 - d * (1.0 / 6.0 - d * series));
    if depth < 0.5 { depth * series } else { far }
}

/// `1 / (1 + exp(-x))`.
#[inline(always)]
pub fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exp(-x))
}

/// `log2(x)` of a number from 0, at least -126: `n + 2 atanh(s) / ln 2` with `x = 2^n m`, m from
/// 0.75 to 1.5, and `s = (m - 1) / (m + 1)`, the series to s^7.
#[inline(always)]
pub fn log2(x: f32) -> f32 {
    // This addend carries into the exponent if m would be above 1.5.
    const CARRY: u32 = 1 << 22;
    let bits = x.max(f32::MIN_POSITIVE).to_bits();
    let exponent = (bits + CARRY) >> 23;
    let m = f32::from_bits(bits + (127 << 23) - (exponent << 23));
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let series = 1.0 + z * (1.0 / 3.0 + z * (0.2 + z * (1.0 / 7.0)));
    (exponent as i32 - 127) as f32 + 2.0 * std::f32::consts::LOG2_E * s * series
}

/// `ln(x)` of a normal positive number: with `x = 2^n m`, m from 0.75 to 1.5, `n ln 2 + 2 atanh(s)`
/// and `s = (m - 1) / (m + 1)`, the series to s^17.
#[inline(always)]
pub fn ln(x: f64) -> f64 {
    // This addend carries into the exponent if m would be above 1.5.
    const CARRY: u64 = 1 << 51;
    const ONE: u64 = 1023 << 52;
    let exponent = x.to_bits().wrapping_add(CARRY) >> 52;
    let m = f64::from_bits(x.to_bits().wrapping_sub(exponent << 52).wrapping_add(ONE));
    // Integers of 52 bits under this exponent are floats above 2^52, which avoids a conversion that
    // vectors may lack.
    let n = f64::from_bits(exponent | (1075 << 52)) - (4_503_599_627_370_496.0 + 1023.0);
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let series = 1.0 / 13.0 + z * (1.0 / 15.0 + z * (1.0 / 17.0));
    let series = 1.0 / 7.0 + z * (1.0 / 9.0 + z * (1.0 / 11.0 + z * series));
    let series = 1.0 + z * (1.0 / 3.0 + z * (0.2 + z * series));
    n * std::f64::consts::LN_2 + 2.0 * s * series
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::activate as wide;

    fn inputs() -> impl Iterator<Item = f32> {
        let fine = (-9000..9000).map(|i| i as f32 * 0.0097);
        fine.chain([0.0, -0.0, 1e-30, -1e-30, 1e30, -1e30, f32::MAX, f32::MIN, 1e-40])
    }

    fn relative(got: f32, want: f64) -> f64 {
        (f64::from(got) - want).abs() / want.abs().max(1e-37)
    }

    #[test]
    fn exponentials_keep_their_bound() {
        for x in inputs().filter(|x| x.abs() < 79.0) {
            let error = relative(exp(x), f64::from(x).exp());
            assert!(error <= 3e-7, "{x}: {error}");
        }
        assert!(exp(-1e30) < 2e-35 && exp(1e30) > 1e38);
    }

    #[test]
    fn powers_of_2_keep_their_bound() {
        for x in inputs().filter(|x| x.abs() < 120.0) {
            let error = relative(exp2(x), f64::from(x).exp2());
            assert!(error <= 3e-7, "{x}: {error}");
        }
        let whole = [-3.0, 0.0, 1.0, 6.0].map(exp2);
        assert_eq!(whole, [0.125, 1.0, 2.0, 64.0]);
    }

    #[test]
    fn softplus_and_sigmoid_keep_their_bounds() {
        for x in inputs() {
            let want = wide::softplus(x.into());
            let error = (f64::from(softplus(x)) - want).abs() / want.max(1e-37);
            assert!(error <= 4e-7 || x < -79.0, "{x}: {error}");
            let error = (f64::from(sigmoid(x)) - wide::sigmoid(x.into())).abs();
            assert!(error <= 4e-7, "{x}: {error}");
        }
    }

    #[test]
    fn logarithms_keep_their_bound() {
        let near_one = (0..2000).map(|i| 1.0 + f64::from(i - 1000) * 1e-9);
        let far = (-20_000..20_000).map(|i| (f64::from(i) * 0.0173).exp());
        for x in near_one.chain(far).chain([0.75, 1.5, f64::MIN_POSITIVE, f64::MAX]) {
            let want = libm::log(x);
            assert!((ln(x) - want).abs() <= 1e-13 * want.abs(), "{x}: {} {want}", ln(x));
        }
        assert_eq!(ln(1.0), 0.0);
    }

    #[test]
    fn binary_logarithms_keep_their_bound() {
        let near_one = (0..2000).map(|i| 1.0 + (i - 1000) as f32 * 1e-6);
        let far = (-4000..4000).map(|i| libm::exp2f(i as f32 * 0.031));
        for x in near_one.chain(far).chain([0.75, 1.5, f32::MIN_POSITIVE, f32::MAX]) {
            let want = libm::log2(x.into());
            let off = (f64::from(log2(x)) - want).abs();
            assert!(off <= 3e-7 + f64::from(f32::EPSILON) * want.abs(), "{x}: {off}");
        }
        assert_eq!((log2(1.0), log2(0.0), log2(8.0)), (0.0, -126.0, 3.0));
    }

    #[test]
    fn opacity_keeps_its_bound() {
        for depth in (0..20_000).map(|i| i as f32 * 0.001).chain([1e-20, 1e-7, 1e-3, 0.5, 1e30]) {
            let want = -(-f64::from(depth)).exp_m1();
            let error = (f64::from(opacity(depth)) - want).abs() / want.max(1e-37);
            assert!(error <= 6e-7, "{depth}: {error}");
        }
    }
}
