//! Values to codes and back, row by row.

use crate::baked::{Codes, Encoding, NumberType};

/// The code of each value: the nearest for integers, with emptiness one of the candidates where it
/// has a code; the ordered bits for floats ([`float_code`]).
pub fn encode_values(encoding: &Encoding, values: &[f32], codes: &mut [u32]) {
    match encoding.number {
        NumberType::F32 => {
            for (code, value) in codes.iter_mut().zip(values) {
                *code = float_code(value.to_bits(), 32);
            }
        }
        NumberType::F16 => {
            for (code, value) in codes.iter_mut().zip(values) {
                let largest = half::f16::MAX.to_f32();
                let nearest = half::f16::from_f32(value.clamp(-largest, largest));
                *code = float_code(nearest.to_bits().into(), 16);
            }
        }
        NumberType::U8 | NumberType::U16 => {
            let first = encoding.first_code();
            let most = (encoding.last_code() - first) as f32;
            let border = 0.5 * (encoding.empty + encoding.low);
            let border = if encoding.empty_code { border } else { f32::NEG_INFINITY };
            for (code, &value) in codes.iter_mut().zip(values) {
                let steps = ((value - encoding.low) / encoding.step).clamp(0.0, most);
                // Truncation of what is not negative: `round` would be a library call.
                let nearest = first + (steps + 0.5) as u32;
                *code = if value < border { 0 } else { nearest };
            }
        }
    }
}

/// The values of codes.
pub(super) fn decode_values(
    encoding: &Encoding,
    codes: impl Iterator<Item = u32>,
    values: &mut [f32],
) {
    for (value, code) in values.iter_mut().zip(codes) {
        *value = match encoding.number {
            NumberType::F32 => f32::from_bits(float_from_code(code, 32)),
            NumberType::F16 => half::f16::from_bits(float_from_code(code, 16) as u16).to_f32(),
            NumberType::U8 | NumberType::U16 => encoding.value(code),
        };
    }
}

/// The values of a run of codes.
pub fn decode_codes(
    encoding: &Encoding,
    codes: &Codes,
    run: std::ops::Range<usize>,
    values: &mut [f32],
) {
    match codes {
        Codes::U8(codes) => {
            decode_values(encoding, codes[run].iter().map(|&code| code.into()), values);
        }
        Codes::U16(codes) => {
            decode_values(encoding, codes[run].iter().map(|&code| code.into()), values);
        }
        Codes::U32(codes) => decode_values(encoding, codes[run].iter().copied(), values),
    }
}

/// A float's bits as a number that grows with the float: the sign bit is flipped, and of negative
/// numbers all others too. Neighbouring values then have neighbouring codes, which predict well.
pub fn float_code(bits: u32, width: u32) -> u32 {
    let sign = 1 << (width - 1);
    let all = u32::MAX >> (32 - width);
    if bits & sign == 0 { bits | sign } else { !bits & all }
}

/// The inverse of [`float_code`].
pub fn float_from_code(code: u32, width: u32) -> u32 {
    let sign = 1 << (width - 1);
    let all = u32::MAX >> (32 - width);
    if code & sign == 0 { !code & all } else { code & !sign }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::{Activation, ActivationOrder};
    use crate::quantize::{Bits, color_encoding, density_encoding};

    fn round_trip(encoding: &Encoding, value: f32) -> (u32, f32) {
        let (mut code, mut back) = ([0], [0.0]);
        encode_values(encoding, &[value], &mut code);
        decode_values(encoding, code.into_iter(), &mut back);
        (code[0], back[0])
    }

    #[test]
    fn float_codes_are_ordered_and_reversible() {
        let values = [-1e30, -2.0, -1.5, -1e-40, -0.0, 0.0, 1e-40, 0.1, 1e30f32];
        let codes = values.map(|value| float_code(value.to_bits(), 32));
        assert!(codes.is_sorted_by(|a, b| a < b));
        for (value, code) in values.into_iter().zip(codes) {
            assert_eq!(float_from_code(code, 32), value.to_bits());
        }
        for bits in 0..=u32::from(u16::MAX) {
            assert_eq!(float_from_code(float_code(bits, 16), 16), bits);
        }
    }

    #[test]
    fn codes_survive_a_round_trip() {
        let activation = Activation { shift: -4.6, interval: 0.5, order: ActivationOrder::Raw };
        for bits in 4..=16 {
            let bits = Bits::Integer(bits);
            for encoding in [density_encoding(bits, &activation), color_encoding(bits)] {
                for code in 0..=encoding.last_code() {
                    let value = encoding.value(code);
                    assert_eq!(round_trip(&encoding, value), (code, value), "{encoding:?}");
                }
            }
        }
    }

    #[test]
    fn integers_round_to_nearest() {
        let encoding = color_encoding(Bits::Integer(8));
        let mut value = -9.0f32;
        while value < 9.0 {
            let (_, back) = round_trip(&encoding, value);
            let clamped = value.clamp(-8.0, 8.0);
            assert!((back - clamped).abs() <= 0.5001 * encoding.step, "{value} {back}");
            value += 0.00317;
        }
        let activation = Activation { shift: -4.6, interval: 0.5, order: ActivationOrder::Raw };
        let density = density_encoding(Bits::Integer(8), &activation);
        assert_eq!(round_trip(&density, -1e30).1, -100.0);
        assert_eq!(round_trip(&density, -60.0).1, -100.0);
        assert_eq!(round_trip(&density, -20.0).1, density.low);
        assert_eq!(round_trip(&density, 1e30).0, 255);
    }

    #[test]
    fn half_floats_round_to_nearest_and_stay_finite() {
        let encoding = color_encoding(Bits::F16);
        assert_eq!(round_trip(&encoding, 1e30).1, 65504.0);
        assert_eq!(round_trip(&encoding, 0.1).1, 0.099_975_586);
        assert_eq!(round_trip(&color_encoding(Bits::F32), -0.1).1, -0.1);
    }
}
