//! Ranges and error bounds.
//!
//! Nodes below the opacity threshold still shape surfaces by interpolation, so density's range
//! starts far below it, and emptiness (-100 where nothing was trained) gets a code of its own
//! beside the range: clamping it to the range's end would thicken every surface. A colour's range
//! is fixed and symmetric: values that training left beyond it are as good as saturated.
//!
//! **The bound.** Inside the range a value moves by at most half a step, plus four f32 roundings
//! (two to find the code, two to decode it), each of at most the range's width. Density's opacity moves by at
//! most its steepest slope times that. Above the range opacity is within `1 - opacity(high)` of
//! the end's; below it, whether the value becomes `low` or empty, within `opacity(low)`. A colour
//! moves by at most a quarter (the slope of the sigmoid at 0) of its value's move, or by
//! `sigmoid(-high)` where it is clamped.

use crate::activate;
use crate::baked::{Decode, Encoding, NumberType};
use crate::field::{Activation, EMPTY_DENSITY};

/// How many bits codes have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bits {
    /// Quantized, 4 to 16 bits.
    Integer(u32),
    /// IEEE binary16.
    F16,
    /// IEEE binary32, exact.
    F32,
}

impl Bits {
    /// The bits of an encoding.
    pub fn of(encoding: &Encoding) -> Self {
        match encoding.number {
            NumberType::U8 | NumberType::U16 => Self::Integer(encoding.bits),
            NumberType::F16 => Self::F16,
            NumberType::F32 => Self::F32,
        }
    }

    fn number(self) -> (NumberType, u32) {
        match self {
            Self::Integer(bits @ ..=8) => (NumberType::U8, bits),
            Self::Integer(bits) => (NumberType::U16, bits),
            Self::F16 => (NumberType::F16, 16),
            Self::F32 => (NumberType::F32, 32),
        }
    }
}

impl std::fmt::Display for Bits {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Integer(bits) => write!(f, "{bits}"),
            Self::F16 => write!(f, "f16"),
            Self::F32 => write!(f, "f32"),
        }
    }
}

/// Opacity moves by less than this at 8 bits, whatever the interval; where the range of
/// [`density_encoding`] would be too wide for that, its upper end comes down.
const OPACITY_ERROR: f64 = 0.0122;

/// The encoding of raw density.
pub fn density_encoding(bits: Bits, activation: &Activation) -> Encoding {
    let (number, count) = bits.number();
    let (shift, interval) = (f64::from(activation.shift), f64::from(activation.interval));
    let slope = activate::opacity_slope(interval);
    let mut encoding = Encoding {
        number,
        bits: count,
        low: 0.0,
        step: 0.0,
        empty: EMPTY_DENSITY,
        empty_code: false,
        decode: Decode::RawDensity,
        // With x = raw + shift, |raw| <= |x| + |shift|. The slope times |x| is at most 1/e for x > 0,
        // where sigma >= x, and (1 + max(0, ln interval)) / e below.
        max_error: float_error(
            number,
            (1.0 + libm::log(interval).max(0.0)) / std::f64::consts::E + shift.abs() * slope,
        ),
    };
    if let Bits::Integer(_) = bits {
        // Up to 0.9999 at 8 bits, wider where codes are finer. The lower end matters more: around thin
        // things nodes of opacity 1e-7 still decide how thin they are.
        let extra = f64::from(count.saturating_sub(8));
        let faint = libm::pow(10.0, if count < 8 { -6.0 } else { -8.0 - 0.5 * extra });
        let clear = libm::pow(10.0, -4.0 - 0.5 * extra);
        let codes = f64::from((1u32 << count) - 2);
        let low = activate::raw_at_opacity(faint, shift, interval);
        let high = activate::inverse_softplus(-libm::log(clear) / interval) - shift;
        let widest = low + 2.0 * OPACITY_ERROR / slope * codes;
        let high = if count >= 8 { high.min(widest) } else { high };
        encoding.low = low as f32;
        encoding.step = ((high - low) / codes) as f32;
        encoding.empty_code = true;
        encoding.empty = EMPTY_DENSITY.min(2.0 * encoding.low);
        let (low, high) = (encoding.value(1), encoding.value(encoding.last_code()));
        let slack = f64::from(4.0 * (low.abs() + high.abs()) * f32::EPSILON);
        let inside = slope * (0.5 * f64::from(encoding.step) + slack);
        let above = 1.0 - activate::opacity(high.into(), shift, interval);
        let below = activate::opacity(low.into(), shift, interval);
        encoding.max_error = round_up(inside.max(above).max(below));
    }
    encoding
}

/// Raw density up to which nodes that nobody needs may be filled: a hundredth of the opacity at
/// which blocks are kept, so that a ray through many of them loses nothing that shows.
pub fn unneeded_density(alpha_threshold: f32, activation: &Activation) -> f32 {
    let (shift, interval) = (f64::from(activation.shift), f64::from(activation.interval));
    activate::raw_at_opacity(0.01 * f64::from(alpha_threshold), shift, interval) as f32
}

/// The encoding of raw colour or features.
pub fn color_encoding(bits: Bits) -> Encoding {
    let (number, count) = bits.number();
    let mut encoding = Encoding {
        number,
        bits: count,
        low: 0.0,
        step: 0.0,
        empty: 0.0,
        empty_code: false,
        decode: Decode::Logit,
        // The sigmoid's slope times its argument is at most 0.224.
        max_error: float_error(number, 0.224),
    };
    if let Bits::Integer(_) = bits {
        // Where codes are finer than 8 bits, what is clamped must move less too. Half a unit more
        // than the bits: at 8 bits the widest range with an error below 0.0085.
        let high = f64::from(count.max(8)) + 0.5;
        encoding.low = -high as f32;
        encoding.step = (2.0 * high / f64::from((1u32 << count) - 1)) as f32;
        let slack = 8.0 * high * f64::from(f32::EPSILON);
        let inside = 0.25 * (0.5 * f64::from(encoding.step) + slack);
        encoding.max_error = round_up(inside.max(activate::sigmoid(-high)));
    }
    encoding
}

/// How far a value's activation moves when it is stored as a float of a type: not at all as f32;
/// as f16 by `2^-11` of the value's magnitude, which `slope_times_value` bounds once multiplied by
/// the activation's slope there. Doubled for values that are subnormal in f16.
fn float_error(number: NumberType, slope_times_value: f64) -> f32 {
    match number {
        NumberType::F16 => round_up(2.0 * slope_times_value / 2048.0),
        _ => 0.0,
    }
}

fn round_up(bound: f64) -> f32 {
    let nearest = bound as f32;
    if f64::from(nearest) < bound { nearest.next_up() } else { nearest }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::ActivationOrder;

    fn activation(interval: f32) -> Activation {
        Activation { shift: -4.595_12, interval, order: ActivationOrder::Raw }
    }

    #[test]
    fn eight_bits_hold_the_promised_errors() {
        assert!(color_encoding(Bits::Integer(8)).max_error <= 0.0085);
        for interval in [0.05, 0.25, 0.5, 1.0, 4.0] {
            let encoding = density_encoding(Bits::Integer(8), &activation(interval));
            assert!(encoding.max_error <= 0.0125, "{interval}: {}", encoding.max_error);
        }
    }

    #[test]
    fn more_bits_err_less() {
        let errors = |f: &dyn Fn(u32) -> f32| (4..=16).map(f).collect::<Vec<_>>();
        let color = errors(&|bits| color_encoding(Bits::Integer(bits)).max_error);
        let density =
            errors(&|bits| density_encoding(Bits::Integer(bits), &activation(0.5)).max_error);
        for errors in [color, density] {
            assert!(errors.windows(2).all(|pair| pair[1] < pair[0]), "{errors:?}");
        }
        assert_eq!(color_encoding(Bits::F32).max_error, 0.0);
    }
}
