//! Values to codes and back, row by row.

use super::code_word::Code;
use super::nearest::Nearest;
use crate::model::baked::{Codes, Encoding, NumberType, with_codes};

/// Finds codes of values: the nearest for integers, including the code of emptiness if there is
/// one; the ordered bits for floats ([`float_code`]).
#[derive(Debug, Clone)]
pub struct Quantizer {
    encoding: Encoding,
    /// Of integers.
    nearest: Option<Nearest>,
}

impl Quantizer {
    /// For values of this encoding.
    pub fn new(encoding: Encoding) -> Self {
        let nearest = (!encoding.number.is_float()).then(|| Nearest::new(&encoding));
        Self { encoding, nearest }
    }

    /// The encoding.
    pub fn encoding(&self) -> &Encoding {
        &self.encoding
    }

    /// The code of each value.
    pub fn encode<T: Code>(&self, values: &[f32], codes: &mut [T]) {
        match (&self.nearest, self.encoding.number) {
            (Some(nearest), _) => nearest.codes(values, codes),
            (None, NumberType::F16) => {
                for (code, value) in codes.iter_mut().zip(values) {
                    let largest = half::f16::MAX.to_f32();
                    let nearest = half::f16::from_f32(value.clamp(-largest, largest));
                    *code = T::narrow(float_code(nearest.to_bits().into(), 16));
                }
            }
            (None, _) => {
                for (code, value) in codes.iter_mut().zip(values) {
                    *code = T::narrow(float_code(value.to_bits(), 32));
                }
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
    with_codes!(codes, codes => {
        decode_values(encoding, codes[run].iter().map(|code| code.code()), values);
    });
}

/// A float's bits as a number that grows with the float: the sign bit is flipped, and for negative
/// numbers all other bits too. Neighbouring values then have neighbouring codes, which predict
/// well.
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
    use crate::model::baked::DensityDomain;
    use crate::model::scene::Activation;
    use crate::quantize::{Bits, color_encoding, density_encoding};

    fn round_trip(encoding: &Encoding, value: f32) -> (u32, f32) {
        let (mut code, mut back) = ([0], [0.0]);
        Quantizer::new(encoding.clone()).encode(&[value], &mut code);
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

    fn activation() -> Activation {
        Activation::logits(-4.6, 0.5)
    }

    fn encodings(bits: Bits) -> [Encoding; 4] {
        let density = |domain| density_encoding(bits, domain, &activation());
        let [raw, depth, opacity] = DensityDomain::ALL.map(density);
        [raw, depth, opacity, color_encoding(bits)]
    }

    #[test]
    fn codes_survive_a_round_trip() {
        for bits in 4..=16 {
            let bits = Bits::Integer(bits);
            for encoding in encodings(bits) {
                let values: Vec<f32> = encoding.values().collect();
                let mut codes = vec![0u32; values.len()];
                Quantizer::new(encoding.clone()).encode(&values, &mut codes);
                assert!(codes.iter().enumerate().all(|(i, &code)| code as usize == i), "{bits}");
            }
        }
    }

    #[test]
    fn integers_round_to_nearest() {
        for bits in [4, 8, 11] {
            for encoding in encodings(Bits::Integer(bits)) {
                let values: Vec<f32> = encoding.values().collect();
                let quantizer = Quantizer::new(encoding);
                let mut value = -120.0f32;
                while value < 120.0 {
                    let mut code = [0u32];
                    quantizer.encode(&[value], &mut code);
                    let error = (values[code[0] as usize] - value).abs();
                    let least = values.iter().map(|v| (v - value).abs()).fold(f32::MAX, f32::min);
                    assert!(
                        error <= least * 1.000_01 + 1e-5,
                        "{bits}: {value}, {error} for {least}"
                    );
                    value += 0.0317;
                }
            }
        }
        let density = density_encoding(Bits::Integer(8), DensityDomain::Raw, &activation());
        assert_eq!(round_trip(&density, -1e30), (0, -100.0));
        assert_eq!(round_trip(&density, -100.05), (0, -100.0));
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
