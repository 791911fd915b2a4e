//! The nearest integer codes of values, many at a time.
//!
//! Up to 256 codes are looked up in a table ([`super::buckets`]).
//!
//! Codes are spaced by a cubic, `x (step + curve x^2)` from the middle, so the code of a value is
//! near the root of a cubic. With more codes, Halley's method finds the root, and a comparison with
//! the adjacent borders decides. Borders are computed by definition, so the result depends only on
//! the encoding, not on the method for the root. If the borders do not confirm a code (NaN, or
//! steps below the spacing of floats), each code is searched individually.

use multiversion::multiversion;

use super::buckets::Buckets;
use super::code_word::Code;
use crate::model::baked::Encoding;
use crate::model::grid::row::LANES;

/// Number of values in a batch, a multiple of all vector lengths.
const RUN: usize = 16;
/// Factor on the smaller of two bounds of a root for the initial guess, which is off by at most a
/// quarter.
const START: f32 = 0.85;
/// Iterations for a root. One leaves a relative error below 1e-2, two below 1e-6.
const STEPS: usize = 2;
/// Corrects the cube root's exponent after division by three.
const CUBE_ROOT_BIAS: u32 = 0x2a51_19f2;
/// Adding it rounds to nearest and leaves integers below 2^22 in the low bits: other conversions
/// are not vectorized, because of Rust's rules for out-of-range numbers.
const WHOLE: f32 = (1u32 << 23) as f32;

/// Finds the nearest codes of an integer encoding; a value on a border gets the upper code.
#[derive(Debug, Clone)]
pub struct Nearest {
    spacing: Spacing,
    /// True if values are in the order of their codes; otherwise roots are meaningless.
    ascends: bool,
    buckets: Option<Buckets>,
    /// Borders between the values of neighbouring codes.
    borders: Vec<f32>,
}

/// The spacing of codes' values, as in [`Encoding::value`].
#[derive(Debug, Clone, Copy)]
struct Spacing {
    center: f32,
    step: f32,
    curve: f32,
    /// Codes per unit of value, at the middle.
    codes_per_unit: f32,
    /// Ratio of `curve` to `step`.
    ratio: f32,
    /// Its reciprocal.
    per_ratio: f32,
    /// The value of code 0.
    lowest: f32,
    /// The value of the last code.
    highest: f32,
    /// The middle code.
    middle: f32,
    /// The last code.
    last: f32,
}

impl Nearest {
    /// For the codes of `encoding`.
    pub fn new(encoding: &Encoding) -> Self {
        let values: Vec<f32> = encoding.values().collect();
        let spacing = Spacing {
            center: encoding.center,
            step: encoding.step,
            curve: encoding.curve,
            codes_per_unit: 1.0 / encoding.step,
            ratio: encoding.curve / encoding.step,
            per_ratio: encoding.step / encoding.curve,
            lowest: encoding.value(0),
            highest: encoding.value(encoding.last_code()),
            middle: (1u32 << (encoding.bits - 1)) as f32,
            last: encoding.last_code() as f32,
        };
        let borders: Vec<f32> = values.windows(2).map(|pair| border(pair[0], pair[1])).collect();
        let ascends = values.is_sorted();
        let buckets = if ascends { Buckets::new(encoding, &borders) } else { None };
        Self { spacing, ascends, buckets, borders }
    }

    /// The code of each value.
    pub fn codes<T: Code>(&self, values: &[f32], codes: &mut [T]) {
        if let Some(buckets) = &self.buckets {
            return buckets.codes(values, codes);
        }
        let (vectors, rest) = values.as_chunks::<LANES>();
        let (codes, codes_of_rest) = codes.split_at_mut(vectors.as_flattened().len());
        for (vectors, codes) in vectors.chunks(RUN).zip(codes.chunks_mut(RUN * LANES)) {
            self.codes_of(vectors, codes);
        }
        if !rest.is_empty() {
            let mut vector = [self.spacing.center; LANES];
            vector[..rest.len()].copy_from_slice(rest);
            let mut codes = [T::default(); LANES];
            self.codes_of(&[vector], &mut codes);
            codes_of_rest.copy_from_slice(&codes[..rest.len()]);
        }
    }

    /// The code of each value of at most `RUN` vectors.
    fn codes_of<T: Code>(&self, vectors: &[[f32; LANES]], codes: &mut [T]) {
        let mut found = [[0; LANES]; RUN];
        let found = &mut found[..vectors.len()];
        if self.ascends && nearest(&self.spacing, vectors, found) {
            for (code, &found) in codes.iter_mut().zip(found.as_flattened()) {
                *code = T::narrow(found);
            }
        } else {
            for (code, value) in codes.iter_mut().zip(vectors.as_flattened()) {
                *code = T::narrow(self.search(*value));
            }
        }
    }

    /// The code of one value.
    fn search(&self, value: f32) -> u32 {
        self.borders.partition_point(|&border| border <= value) as u32
    }
}

/// The value between those of two neighbouring codes.
pub(super) fn border(low: f32, high: f32) -> f32 {
    0.5 * low + 0.5 * high
}

impl Spacing {
    /// The value of a code.
    #[inline(always)]
    fn value(&self, code: f32) -> f32 {
        let x = code - self.middle;
        let value = self.center + x * (self.step + self.curve * (x * x));
        if code > 0.0 { value } else { self.lowest }
    }

    /// A code that is usually right, and otherwise next to the right one.
    #[inline(always)]
    fn guess(&self, value: f32) -> f32 {
        let from_center = value.max(self.lowest).min(self.highest) - self.center;
        // In steps: |x| + ratio |x|^3 = distance.
        let (distance, ratio) = (from_center.abs() * self.codes_per_unit, self.ratio);
        let cube_root = f32::from_bits((distance * self.per_ratio).to_bits() / 3 + CUBE_ROOT_BIAS);
        // Both are upper bounds, too large by half if they are equal.
        let mut x = START * distance.min(cube_root);
        for _ in 0..STEPS {
            let bent = ratio * (x * x);
            let (off, slope) = (x + x * bent - distance, 1.0 + 3.0 * bent);
            x -= off * slope / (slope * slope - 3.0 * ratio * x * off);
        }
        let code = self.middle + x.copysign(from_center);
        code.max(0.0).min(self.last) + WHOLE - WHOLE
    }
}

/// Codes of values. Returns `false` if any is uncertain.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn nearest(spacing: &Spacing, values: &[[f32; LANES]], codes: &mut [[u32; LANES]]) -> bool {
    let mut uncertain = [0; LANES];
    for (codes, values) in codes.iter_mut().zip(values) {
        for lane in 0..LANES {
            let value = values[lane];
            let guess = spacing.guess(value);
            let own = spacing.value(guess);
            let is_above = value >= own;
            let (side, end) = if is_above { (1.0, spacing.last) } else { (-1.0, 0.0) };
            let [next, second] = [1.0, 2.0].map(|by| spacing.value(guess + by * side));
            // A value on a border belongs to the code above it.
            let is_past = |border: f32| (value >= border) == is_above;
            let past = is_past(border(own, next)) & (guess != end);
            let moved = guess + if past { side } else { 0.0 };
            let far = past & is_past(border(next, second)) & (moved != end);
            uncertain[lane] |= u32::from(far | value.is_nan());
            codes[lane] = (moved + WHOLE).to_bits() - WHOLE.to_bits();
        }
    }
    uncertain == [0; LANES]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::baked::DensityDomain;
    use crate::model::scene::Activation;
    use crate::quantize::{Bits, color_encoding, density_encoding};

    /// Compares codes with a search through all borders, for values on and around each border and
    /// far from all.
    fn hold(encoding: &Encoding) {
        let nearest = Nearest::new(encoding);
        let mut values = vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, 1e-40];
        values.extend([1e30, -1e30, 1e5, -1e5, 300.0, -300.0]);
        for &border in &nearest.borders {
            values.extend([border.next_down(), border, border.next_up(), border + 0.1]);
        }
        // NaN makes a batch uncertain; tests with and without.
        for values in [&values[..], &values[3..]] {
            let mut codes = vec![0u32; values.len()];
            nearest.codes(values, &mut codes);
            for (value, code) in values.iter().zip(codes) {
                assert_eq!(code, nearest.search(*value), "{value} in {encoding:?}");
            }
        }
    }

    #[test]
    fn codes_are_those_of_a_search() {
        let activation = Activation::logits(-4.6, 0.5);
        for bits in 4..=16 {
            let bits = Bits::Integer(bits);
            for domain in DensityDomain::ALL {
                hold(&density_encoding(bits, domain, &activation));
            }
            hold(&color_encoding(bits));
        }
    }

    #[test]
    fn encodings_of_up_to_8_bits_have_a_table() {
        for bits in 4..=9 {
            let number = Bits::Integer(bits);
            for interval in [0.05, 0.5, 4.0] {
                let activation = Activation::logits(-4.6, interval);
                let density = |domain| density_encoding(number, domain, &activation);
                for encoding in
                    DensityDomain::ALL.map(density).iter().chain([&color_encoding(number)])
                {
                    let has_table = Nearest::new(encoding).buckets.is_some();
                    assert_eq!(has_table, bits <= 8, "{encoding:?}");
                }
            }
        }
    }

    #[test]
    fn codes_of_encodings_that_others_laid_are_those_of_a_search() {
        let sound = color_encoding(Bits::Integer(8));
        let spacings = [
            (0.0, 0.125, 0.0),
            (1000.0, 1e-4, 0.0),
            (0.0, 0.0, 1e-3),
            (0.0, 1e-30, 1e20),
            (-3.0, 1.0, -1e-5),
        ];
        for (center, step, curve) in spacings {
            for (empty, empty_code) in [(sound.empty, false), (-1e6, true)] {
                hold(&Encoding { center, step, curve, empty, empty_code, ..sound.clone() });
            }
        }
    }
}
