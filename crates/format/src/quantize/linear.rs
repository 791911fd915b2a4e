//! Encodings that depend on the values: linear colours, coefficients of harmonics, directional
//! brightness, anisotropy, and densities that are not logits. Their values are unbounded, so codes
//! cover their range.
//!
//! Codes of colours are uniformly spaced, and 0 is one of them, because a code's change is equally
//! visible everywhere. With given bits, coefficients of all harmonics get the same step, which
//! minimizes the squared error of colours, because each function has the same mean square over all
//! directions. With a given error, each band gets the step that changes a colour by that error in
//! the worst direction. Codes of densities lie around 0, where opacity is steepest, and grow sparse
//! to both sides.

use super::range::{
    self, Bits, Domain, LARGEST, OPACITY_ERROR, bound, float_encoding, is_laid_over_values,
    set_codes,
};
use super::value_range::ValueRange;
use crate::model::baked::{Decode, Encoding};
use crate::model::scene::Activation;

/// Step of opacity around empty space at 8 bits. Errors of low densities add up along a ray: steps
/// three times as long cost 11 dB in pictures, and save 1 % of the bytes.
const DENSITY_STEP: f64 = 0.3 * OPACITY_ERROR;
/// Step of a colour at 8 bits.
const COLOR_STEP: f64 = 0.0082;
/// Step of a coefficient at 8 bits: nine of them move a colour by 0.003 (root mean square).
const COEFFICIENT_STEP: f64 = 0.012;
/// Step of directional brightness at 8 bits, in logits.
const DIRECTIONAL_STEP: f64 = 0.0625;
/// Step of anisotropy at 8 bits, in square roots of optical depth.
const ANISOTROPY_STEP: f64 = 0.03125;

/// The encoding of this many bits for the values in `span`, if [`is_laid_over_values`].
pub fn encoding_over(
    bits: Bits,
    decode: Decode,
    activation: &Activation,
    span: &ValueRange,
) -> Encoding {
    let Bits::Integer(count) = bits else { return as_numbers(bits, decode, activation, span) };
    let half = f64::from((1u32 << (count - 1)) - 1);
    match decode.density() {
        Some(_) => {
            let mut encoding = as_numbers(bits, decode, activation, span);
            let [low, high] = ends(span).map(f64::abs);
            let extent = low.max(high).clamp(1e-20, LARGEST);
            set_codes(&mut encoding, 0.0, DENSITY_STEP / slope(activation), extent);
            bounded(encoding, activation, span)
        }
        None => {
            let step = match decode {
                Decode::Coefficient(_) => COEFFICIENT_STEP * decode.activated(1.0, activation),
                Decode::Directional => DIRECTIONAL_STEP * decode.activated(1.0, activation),
                Decode::Anisotropy => ANISOTROPY_STEP * decode.activated(1.0, activation),
                _ => COLOR_STEP,
            };
            equal_steps(step * 127.0 / half, count, decode, activation, span)
        }
    }
}

/// The encoding of linear colours with the fewest bits within `max_error`; floats if 16 bits do not
/// suffice.
pub(super) fn colors_within(
    max_error: f32,
    decode: Decode,
    activation: &Activation,
    span: &ValueRange,
) -> Encoding {
    // Slightly less than the error, because values and borders of codes are rounded, each by up to
    // 2^-24 of the largest value.
    let [low, high] = ends(span);
    let largest = decode.activated(low.abs().max(high.abs()), activation);
    let rounding = largest / f64::from(1u32 << 21);
    let step = 2.0 * (f64::from(max_error) * (1.0 - 1e-5) - rounding).max(0.0);
    let laid = (4..=16).map(|bits| equal_steps(step, bits, decode, activation, span));
    let mut kept = laid.filter(|encoding| encoding.max_error <= max_error);
    kept.next().unwrap_or_else(|| as_numbers(Bits::F32, decode, activation, span))
}

/// Codes of this many bits, spaced by at least `step` of colour and wide enough for the values. The
/// middle is a multiple of the step, so that 0 has a code if it is in the range.
fn equal_steps(
    step: f64,
    bits: u32,
    decode: Decode,
    activation: &Activation,
    span: &ValueRange,
) -> Encoding {
    let mut encoding = as_numbers(Bits::Integer(bits), decode, activation, span);
    let [low, high] = ends(span).map(|end| end.clamp(-LARGEST, LARGEST));
    let half = f64::from((1u32 << (bits - 1)) - 1);
    let gain = decode.activated(1.0, activation);
    let largest = low.abs().max(high.abs());
    // The middle is up to half a step from that of the values. Codes must be distinct f32 numbers.
    let needed = (high - low) / (2.0 * half - 1.0);
    let step = (step / gain).max(needed).max(largest / f64::from(1u32 << 22)) as f32;
    let middle = libm::round((low + high) / 2.0 / f64::from(step)) as f32;
    encoding.step = step;
    encoding.center = middle * step;
    bounded(encoding, activation, span)
}

/// The encoding with its bound.
fn bounded(mut encoding: Encoding, activation: &Activation, span: &ValueRange) -> Encoding {
    let decode = encoding.decode;
    let activated = |value: f64| decode.activated(value, activation);
    encoding.max_error = bound(&encoding, ends(span).map(activated), activated);
    encoding
}

/// A float encoding.
fn as_numbers(bits: Bits, decode: Decode, activation: &Activation, span: &ValueRange) -> Encoding {
    let [low, high] = ends(span);
    let largest = low.abs().max(high.abs());
    let most = match decode.density() {
        // The change of opacity is at most the slope times the change of the value.
        Some(_) => largest * slope(activation),
        None => decode.activated(largest, activation),
    };
    let ends = half::f16::MAX.to_f64();
    let activated = |value: f64| match decode.density() {
        Some(_) => decode.activated(value, activation),
        // For colours, only the present ones.
        None => decode.activated(value.min(largest.max(ends)), activation),
    };
    float_encoding(bits, decode, Domain::of(decode, activation).empty, most, activated)
}

/// The lowest and the highest value; 0 if there are none.
fn ends(span: &ValueRange) -> [f64; 2] {
    span.ends().unwrap_or_default().map(f64::from)
}

/// The steepest slope of opacity over densities.
fn slope(activation: &Activation) -> f64 {
    activation.interval.into()
}

/// A placeholder encoding before the values are known; only its bits count.
pub fn planned_encoding(bits: Bits, decode: Decode, activation: &Activation) -> Encoding {
    match decode {
        Decode::Logit => range::color_encoding(bits),
        Decode::Density(domain) if !is_laid_over_values(decode, activation) => {
            range::density_encoding(bits, domain, activation)
        }
        _ => encoding_over(bits, decode, activation, &ValueRange::new(decode, activation)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::baked::DensityDomain;
    use crate::quantize::encoding_within;

    const RELU: Activation = Activation::relu(0.02);

    const LINEAR: [Decode; 8] = [
        Decode::Linear,
        Decode::Coefficient(0),
        Decode::Coefficient(1),
        Decode::Coefficient(2),
        Decode::Coefficient(3),
        Decode::Directional,
        Decode::Anisotropy,
        Decode::Density(DensityDomain::Raw),
    ];

    fn span(decode: Decode, values: &[f32]) -> ValueRange {
        let mut span = ValueRange::new(decode, &RELU);
        span.take(values);
        span
    }

    fn has_zero(encoding: &Encoding) -> bool {
        encoding.values().any(|value| value == 0.0)
    }

    #[test]
    fn codes_ascend_hold_zero_and_keep_their_bound() {
        let ranges =
            [[-1.7, 2.3], [-0.01, 0.4], [0.0, 900.0], [-70.0, 3.0], [5.0, 5.0], [-1e9, 1e9]];
        for decode in LINEAR {
            for [low, high] in ranges {
                let span = span(decode, &[low, high]);
                for bits in [4, 7, 8, 9, 12, 16] {
                    let encoding = encoding_over(Bits::Integer(bits), decode, &RELU, &span);
                    let values: Vec<f32> = encoding.values().collect();
                    assert!(values.is_sorted_by(|a, b| a < b), "{decode:?} {low} {high} {bits}");
                    assert!(low > 0.0 || has_zero(&encoding), "{decode:?} {low} {high} {bits}");
                    for step in 0..=1000 {
                        let value = low + (high - low) * (step as f32 / 1000.0);
                        let near = |code: &f32| f64::from(*code - value).abs();
                        let code = values.iter().min_by(|a, b| near(a).total_cmp(&near(b)));
                        let code = *code.expect("codes");
                        let [one, other] = [code, value].map(|v| decode.activated(v.into(), &RELU));
                        let most = f64::from(encoding.max_error) * (1.0 + 1e-6);
                        assert!((one - other).abs() <= most, "{value} as {code}: {encoding:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn bands_have_equal_steps_and_errors_are_kept() {
        for band in 0..4 {
            let decode = Decode::Coefficient(band);
            let span = span(decode, &[-0.2, 0.3]);
            let encoding = encoding_over(Bits::Integer(8), decode, &RELU, &span);
            let steps = encoding.step / COEFFICIENT_STEP as f32;
            assert!((steps - 1.0).abs() < 1e-4, "{encoding:?}");
            for error in [0.1, 0.01, 1e-3, 1e-4] {
                let encoding = encoding_within(error, decode, &RELU, &span);
                assert!(encoding.max_error <= error && has_zero(&encoding), "{encoding:?}");
                assert!(!encoding.number.is_float());
            }
        }
    }

    #[test]
    fn densities_keep_errors_and_zero() {
        let decode = Decode::Density(DensityDomain::Raw);
        for values in [[-30.0, 400.0], [0.0, 3.0], [2.0, 50.0], [-9.0, -1.0]] {
            let span = span(decode, &values);
            for error in [0.1, 0.01, 1e-3] {
                let encoding = encoding_within(error, decode, &RELU, &span);
                assert!(encoding.max_error <= error, "{encoding:?}");
                assert!(encoding.number.is_float() || has_zero(&encoding), "{encoding:?}");
            }
        }
    }
}
