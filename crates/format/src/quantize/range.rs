//! Ranges and error bounds.
//!
//! Nodes far below the opacity threshold, and far inside opaque regions, still shape surfaces by
//! interpolation: on a scene with steep density, clamping raw values at opacity 1e-8 costs 20 dB.
//! So codes extend down to -100, the value of nodes that training never reached, and equally far
//! up; they are dense where opacity changes and sparse elsewhere ([`Encoding`]). Emptiness has its
//! own code, which keeps its exact value. Codes of colour likewise extend far into saturation.
//!
//! **The bound.** Values of codes ascend, and a value gets the code between whose borders it lies.
//! The activation is monotone, so the distance of a value's activation from its code's is largest
//! at a border or, beyond the last codes, at the activation's limit. Borders are f32 numbers, and
//! comparisons with them are exact, so there is no rounding to add: the bound is the largest of
//! these distances. If all values lie in a known range ([`super::search`]), intervals between
//! borders are clipped to it, and codes outside of it are ignored.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::nearest::border;
use crate::model::activate;
use crate::model::baked::{Decode, DensityDomain, Encoding, NumberType};
use crate::model::scene::{Activation, DensityFunction, EMPTY_LOGIT};

/// Bits of codes.
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

    /// The text of each, the fewest bits first.
    pub const NAMES: [&str; 15] =
        ["4", "5", "6", "7", "8", "9", "10", "11", "12", "13", "14", "15", "16", "f16", "f32"];

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

/// From 4 to 16, f16 or f32.
impl std::str::FromStr for Bits {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match (text, text.parse()) {
            ("f16", _) => Ok(Self::F16),
            ("f32", _) => Ok(Self::F32),
            (_, Ok(bits @ 4..=16)) => Ok(Self::Integer(bits)),
            _ => Err("expected 4 to 16, f16 or f32"),
        }
    }
}

impl Serialize for Bits {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Bits {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        String::deserialize(from)?.parse().map_err(serde::de::Error::custom)
    }
}

/// Largest move of opacity at 8 bits, at its steepest.
pub(super) const OPACITY_ERROR: f64 = 0.0108;
/// Largest move of a colour at 8 bits, where the sigmoid is steepest.
const COLOR_ERROR: f64 = 0.0082;
/// Extent of codes in raw colour: the sigmoid is within 1e-14 of its limit.
const COLOR_EXTENT: f64 = 32.0;

/// Larger linear values have no codes, because sums of two of them would be infinite.
pub(super) const LARGEST: f64 = 1e30;

/// Extent of codes as the square root of optical depth: opacity 1 - 1e-7 over one interval.
const SQRT_DEPTH_EXTENT: f64 = 4.0;

/// True if codes of this meaning cover the range of the values.
pub fn is_laid_over_values(decode: Decode, activation: &Activation) -> bool {
    match decode {
        Decode::Linear | Decode::Coefficient(_) | Decode::Directional | Decode::Anisotropy => true,
        Decode::Density(DensityDomain::Raw) => activation.function == DensityFunction::Relu,
        Decode::Density(_) | Decode::Logit => false,
    }
}

/// The encoding of a level's density.
pub fn density_encoding(bits: Bits, domain: DensityDomain, activation: &Activation) -> Encoding {
    match domain {
        // The slope of 1 - exp(-q^2) times q is at most 2 / e.
        DensityDomain::SqrtOpticalDepth => {
            linear_encoding(bits, domain, SQRT_DEPTH_EXTENT, 2.0 / std::f64::consts::E, activation)
        }
        DensityDomain::Opacity => linear_encoding(bits, domain, 1.0, 1.0, activation),
        DensityDomain::Raw => raw_density_encoding(bits, activation),
    }
}

/// Codes from 0, which is empty, in equal steps up to a step below `extent`.
fn linear_encoding(
    bits: Bits,
    domain: DensityDomain,
    extent: f64,
    slope_times_value: f64,
    activation: &Activation,
) -> Encoding {
    let decode = Decode::Density(domain);
    let opacity = |value| domain.opacity(value, activation);
    let mut encoding = float_encoding(bits, decode, 0.0, slope_times_value, opacity);
    if let Bits::Integer(bits) = bits {
        // A power of two, so that code 0 is exactly 0.
        let step = extent / f64::from(1u32 << bits);
        encoding.step = step as f32;
        encoding.center = (extent / 2.0) as f32;
        encoding.max_error = bound(&encoding, [0.0, opacity(f64::MAX)], opacity);
    }
    encoding
}

/// The encoding of raw density.
fn raw_density_encoding(bits: Bits, activation: &Activation) -> Encoding {
    let (shift, interval) = (f64::from(activation.shift), f64::from(activation.interval));
    let (_, slope) = activation.steepest();
    // With x = raw + shift, |raw| <= |x| + |shift|. The slope times |x| is at most 1/e for x > 0,
    // where sigma >= x, and (1 + max(0, ln interval)) / e below.
    let slope_times_value =
        (1.0 + libm::log(interval).max(0.0)) / std::f64::consts::E + shift.abs() * slope;
    let opacity = |raw| DensityDomain::Raw.opacity(raw, activation);
    let decode = Decode::Density(DensityDomain::Raw);
    let mut encoding = float_encoding(bits, decode, EMPTY_LOGIT, slope_times_value, opacity);
    if let Bits::Integer(_) = bits {
        let (center, extent) = raw_density_extent(activation);
        set_codes(&mut encoding, center, 2.0 * OPACITY_ERROR / slope, extent);
        encoding.empty_code = true;
        encoding.empty = emptiness(center, extent);
        encoding.max_error = bound(&encoding, [0.0, opacity(f64::MAX)], opacity);
    }
    encoding
}

/// The raw density at which opacity is steepest, and the extent of codes from there.
fn raw_density_extent(activation: &Activation) -> (f64, f64) {
    let (center, _) = activation.steepest();
    let clear = activation.raw_at_opacity(0.9999);
    // The lowest code stays above emptiness, which has its own code.
    (center, (center - f64::from(EMPTY_LOGIT) - 2.0).max(clear - center))
}

/// Raw density of emptiness: below the lowest code.
fn emptiness(center: f64, extent: f64) -> f32 {
    EMPTY_LOGIT.min((center - extent - 1.0) as f32)
}

/// Spaces codes around `center`: `step` apart there at 8 bits (scaled for other bits), up to
/// `extent` away at the ends.
pub(super) fn set_codes(encoding: &mut Encoding, center: f64, step: f64, extent: f64) {
    let half = f64::from((1u32 << (encoding.bits - 1)) - 1);
    // If there are enough codes, they are uniformly spaced.
    let step = (step * 127.0 / half).min(extent / half);
    encoding.center = center as f32;
    encoding.step = step as f32;
    encoding.curve = ((extent - step * half) / (half * half * half)) as f32;
}

/// The relevant range of values of one meaning.
#[derive(Debug, Clone, Copy)]
pub(super) struct Domain {
    /// The value at which the activation is steepest.
    pub steepest: f64,
    /// Values below need no separate code.
    pub floor: f64,
    /// Values above need no separate code.
    pub ceiling: f64,
    /// The value of emptiness, below `floor`. Lower values count as empty too.
    pub empty: f32,
}

impl Domain {
    /// For values of this meaning.
    pub fn of(decode: Decode, activation: &Activation) -> Self {
        match decode {
            Decode::Density(DensityDomain::Raw) if activation.function == DensityFunction::Relu => {
                let (floor, ceiling) = (-LARGEST, LARGEST);
                Self { steepest: 0.0, floor, ceiling, empty: 0.0 }
            }
            Decode::Density(DensityDomain::Raw) => {
                let (steepest, extent) = raw_density_extent(activation);
                let empty = emptiness(steepest, extent);
                Self { steepest, floor: steepest - extent, ceiling: steepest + extent, empty }
            }
            Decode::Density(DensityDomain::SqrtOpticalDepth) => {
                let steepest = std::f64::consts::FRAC_1_SQRT_2;
                Self { steepest, floor: 0.0, ceiling: SQRT_DEPTH_EXTENT, empty: 0.0 }
            }
            Decode::Density(DensityDomain::Opacity) => {
                Self { steepest: 0.5, floor: 0.0, ceiling: 1.0, empty: 0.0 }
            }
            Decode::Logit => {
                Self { steepest: 0.0, floor: -COLOR_EXTENT, ceiling: COLOR_EXTENT, empty: 0.0 }
            }
            Decode::Linear | Decode::Coefficient(_) | Decode::Directional | Decode::Anisotropy => {
                let (floor, ceiling) = (-LARGEST, LARGEST);
                Self { steepest: 0.0, floor, ceiling, empty: 0.0 }
            }
        }
    }
}

/// The largest distance of a value's activation from its code's, for values with activations within
/// `activations`; see the module's proof.
pub(super) fn bound(
    encoding: &Encoding,
    activations: [f64; 2],
    activation: impl Fn(f64) -> f64,
) -> f32 {
    let codes = 0..=encoding.last_code();
    round_up(
        codes.fold(0.0, |max, code| max.max(code_error(encoding, code, activations, &activation))),
    )
}

/// [`bound`] for the values of this code.
pub(super) fn code_error(
    encoding: &Encoding,
    code: u32,
    activations: [f64; 2],
    activation: &impl Fn(f64) -> f64,
) -> f64 {
    let value = encoding.value(code);
    let at_border = |low, high| activation(border(low, high).into());
    let [mut low, mut high] = activations;
    if code > 0 {
        low = low.max(at_border(encoding.value(code - 1), value));
    }
    if code < encoding.last_code() {
        high = high.min(at_border(value, encoding.value(code + 1)));
    }
    let level = activation(value.into());
    if low > high { 0.0 } else { (high - level).max(level - low) }
}

/// The encoding of raw colour or features.
pub fn color_encoding(bits: Bits) -> Encoding {
    // The sigmoid's slope times its argument is at most 0.224.
    let mut encoding = float_encoding(bits, Decode::Logit, 0.0, 0.224, activate::sigmoid);
    if let Bits::Integer(_) = bits {
        set_codes(&mut encoding, 0.0, 2.0 * COLOR_ERROR / 0.25, COLOR_EXTENT);
        encoding.max_error = bound(&encoding, [0.0, 1.0], activate::sigmoid);
    }
    encoding
}

/// A float encoding; integers get their codes later. Storing as f32 does not change a value's
/// activation; as f16, a value changes by `2^-11` of its magnitude, and `slope_times_value` bounds
/// the product of magnitude and slope. The bound is doubled for subnormal f16 values. `activation`
/// may still grow beyond 65504, the largest f16: over short intervals, raw density saturates late.
pub(super) fn float_encoding(
    bits: Bits,
    decode: Decode,
    empty: f32,
    slope_times_value: f64,
    activation: impl Fn(f64) -> f64,
) -> Encoding {
    let (number, count) = bits.number();
    let max_error = match number {
        NumberType::F16 => {
            let beyond = activation(f64::MAX) - activation(half::f16::MAX.to_f64());
            round_up((2.0 * slope_times_value / 2048.0).max(beyond))
        }
        _ => 0.0,
    };
    Encoding {
        number,
        bits: count,
        center: 0.0,
        step: 0.0,
        curve: 0.0,
        empty,
        empty_code: false,
        decode,
        max_error,
    }
}

pub(super) fn round_up(bound: f64) -> f32 {
    let nearest = bound as f32;
    if f64::from(nearest) < bound { nearest.next_up() } else { nearest }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn activation(interval: f32) -> Activation {
        Activation::logits(-4.595_12, interval)
    }

    #[test]
    fn eight_bits_hold_the_promised_errors() {
        assert!(color_encoding(Bits::Integer(8)).max_error <= 0.0085);
        for interval in [0.05, 0.25, 0.5, 1.0, 4.0] {
            let encoding = raw_density_encoding(Bits::Integer(8), &activation(interval));
            assert!(encoding.max_error <= 0.0125, "{interval}: {}", encoding.max_error);
        }
    }

    #[test]
    fn more_bits_err_less() {
        let errors = |f: &dyn Fn(u32) -> f32| (4..=16).map(f).collect::<Vec<_>>();
        let color = errors(&|bits| color_encoding(Bits::Integer(bits)).max_error);
        let density =
            errors(&|bits| raw_density_encoding(Bits::Integer(bits), &activation(0.5)).max_error);
        for errors in [color, density] {
            assert!(errors.windows(2).all(|pair| pair[1] < pair[0]), "{errors:?}");
        }
        assert_eq!(color_encoding(Bits::F32).max_error, 0.0);
    }
}
