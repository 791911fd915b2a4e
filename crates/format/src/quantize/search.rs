//! The fewest bits that keep an error.
//!
//! Given are the largest error, and the lowest and the highest value ([`ValueRange`]). For 4 bits,
//! then 5, and so on, a few hundred layouts of codes over the range are tried. Their center ranges
//! from the steepest point of the activation to the middle of the range; their steps are uniform,
//! or down to a thousandth of that at the center and growing towards the ends. The first layout
//! with a proved bound ([`super::range`]) within the error is used.
//!
//! Layouts are ordered by their widest step, narrowest first. The widest step is at an end, far
//! outside the visible range, where the bound allows any error. But surfaces lie where
//! interpolation crosses from there into the visible range, and a picture loses tens of dB if
//! values there are out of proportion. So spare codes go to the ends, and steps at the center are
//! as wide as the bound allows.
//!
//! Everything is computed in f64 by `libm` in a fixed order: the same values give the same codes.

use super::linear;
use super::range::{Bits, Domain, code_error, is_laid_over_values, round_up};
use super::value_range::ValueRange;
use crate::model::baked::{Decode, DensityDomain, Encoding, NumberType};
use crate::model::scene::Activation;

/// Number of centers to try, from the steepest point of the activation to the middle.
const CENTERS: u32 = 5;
/// Number of halvings of the center step to try, and layouts per halving.
const HALVINGS: u32 = 10;
const CURVES_PER_HALVING: u32 = 8;
/// Codes whose errors are checked first; if one is too large, the others are skipped.
const PROBED_FIRST: u32 = 256;

/// The encoding with the fewest bits that keeps the values in `span` (and emptiness) within
/// `max_error`, in opacity over one interval or in colour from 0 to 1; f32 if 16 bits do not
/// suffice.
pub fn encoding_within(
    max_error: f32,
    decode: Decode,
    activation: &Activation,
    span: &ValueRange,
) -> Encoding {
    if decode.density().is_none() && decode != Decode::Logit {
        return linear::colors_within(max_error, decode, activation, span);
    }
    let search = Search::new(max_error, decode, activation, span);
    let found = (4..=16).find_map(|bits| search.with_bits(bits));
    found.unwrap_or_else(|| linear::planned_encoding(Bits::F32, decode, activation))
}

struct Search<'a> {
    max_error: f32,
    decode: Decode,
    activation: &'a Activation,
    domain: Domain,
    /// The range of codes' values.
    low: f64,
    high: f64,
    /// Activations of the lowest and the highest value.
    activations: [f64; 2],
    /// True if codes are centered on 0, which is empty, and extend below it.
    is_signed: bool,
}

impl<'a> Search<'a> {
    fn new(max_error: f32, decode: Decode, activation: &'a Activation, span: &ValueRange) -> Self {
        let domain = Domain::of(decode, activation);
        let activated = |value: f32| decode.activated(value.into(), activation);
        // Without values, any encoding works.
        let [low, high] = span.ends().unwrap_or([domain.steepest as f32; 2]);
        let is_signed = is_laid_over_values(decode, activation);
        let (low, high) = if is_signed { (low.min(0.0), high.max(0.0)) } else { (low, high) };
        let mut ceiling = domain.ceiling;
        if decode == Decode::Density(DensityDomain::Raw) {
            // Over short intervals, opacity saturates late.
            let almost = 1.0 - f64::from(max_error);
            ceiling = ceiling.max(activation.raw_at_opacity(almost));
        }
        Self {
            max_error,
            decode,
            activation,
            domain,
            low: f64::from(low).clamp(domain.floor, ceiling),
            high: f64::from(high).clamp(domain.floor, ceiling),
            activations: [low, high].map(activated),
            is_signed,
        }
    }

    fn activated(&self, value: f64) -> f64 {
        self.decode.activated(value, self.activation)
    }

    /// The best encoding of this many bits, if any keeps the error.
    fn with_bits(&self, bits: u32) -> Option<Encoding> {
        // No code can cover more than twice the error.
        let covered = f64::from(1u32 << bits) * 2.0 * f64::from(self.max_error);
        if self.activations[1] - self.activations[0] > covered {
            return None;
        }
        let mut ways: Vec<(f64, Encoding)> = self.ways(bits);
        ways.sort_by(|(one, _), (other, _)| one.total_cmp(other));
        ways.into_iter().find_map(|(_, encoding)| self.proved(encoding))
    }

    /// Codes of this many bits from the lowest to the highest value, with their widest steps.
    fn ways(&self, bits: u32) -> Vec<(f64, Encoding)> {
        let (mut low, high) = (self.low, self.high);
        let empty_code = self.decode.density().is_some() && !self.is_signed;
        // Codes below and above the center.
        let above = f64::from((1u32 << (bits - 1)) - 1);
        let mut below = above + 1.0;
        if empty_code {
            // The lowest code means emptiness; the next must be at least a step above.
            below = above;
            let empty = f64::from(self.domain.empty);
            low = low.max(empty + (high - empty) / (below + above + 1.0));
        }
        let steepest = self.domain.steepest.clamp(low, high);
        let middle = low + (high - low) * below / (below + above);
        let mut ways = Vec::new();
        let centers = if self.is_signed { 1 } else { CENTERS };
        for i in 0..centers {
            let share = f64::from(i) / f64::from(CENTERS - 1);
            let center = steepest + share * (middle - steepest);
            let sides = [(center - low, below), (high - center, above)];
            // Codes must be distinct f32 numbers, even if all values are equal.
            let least = (center.abs() + 1.0) / f64::from(1u32 << 20);
            let equal = sides.iter().fold(least, |max, (reach, codes)| max.max(reach / codes));
            for j in 0..=HALVINGS * CURVES_PER_HALVING {
                let step = equal * libm::exp2(-f64::from(j) / f64::from(CURVES_PER_HALVING));
                let curve = |(reach, codes): (f64, f64)| (reach - step * codes) / codes.powi(3);
                let curve = curve(sides[0]).max(curve(sides[1])).max(0.0);
                let widest = step + 3.0 * curve * below * below;
                let encoding = Encoding {
                    number: if bits > 8 { NumberType::U16 } else { NumberType::U8 },
                    bits,
                    center: center as f32,
                    step: step as f32,
                    curve: curve as f32,
                    empty: self.domain.empty,
                    empty_code,
                    decode: self.decode,
                    max_error: self.max_error,
                };
                ways.push((widest, encoding));
            }
        }
        ways
    }

    /// The encoding with its proved bound, if it is within the error.
    fn proved(&self, mut encoding: Encoding) -> Option<Encoding> {
        let activated = |value| self.activated(value);
        let error = |code| code_error(&encoding, code, self.activations, &activated);
        let count = encoding.last_code() + 1;
        let max_error = f64::from(self.max_error);
        let stride = count.div_ceil(PROBED_FIRST) as usize;
        if (0..count).step_by(stride).any(|code| error(code) > max_error) {
            return None;
        }
        if !encoding.values().is_sorted_by(|low, high| low < high) {
            return None;
        }
        // Emptiness, and values below it, decode to emptiness.
        let emptied = if encoding.empty_code { activated(encoding.empty.into()) } else { 0.0 };
        let bound = (0..count).fold(emptied, |max, code| max.max(error(code)));
        encoding.max_error = round_up(bound);
        (encoding.max_error <= self.max_error).then_some(encoding)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantize::code::{Quantizer, decode_values};

    fn activation(interval: f32) -> Activation {
        Activation::logits(-4.595_12, interval)
    }

    fn span(decode: Decode, activation: &Activation, values: &[f32]) -> ValueRange {
        let mut span = ValueRange::new(decode, activation);
        span.take(values);
        span
    }

    #[test]
    fn every_value_of_the_span_is_within_the_bound() {
        let ranges = [[0.001, 0.02], [0.3, 0.31], [1e-4, 1.0], [0.4, 1.0], [1.0, 1.0]];
        let wide = [[-90.0, 80.0], [-8.0, 9.0], [-50.0, -3.0], [2.0, 31.0], [-99.0, 1e30]];
        for decode in Decode::ALL {
            let is_raw = matches!(decode, Decode::Density(DensityDomain::Raw) | Decode::Logit);
            for ([low, high], interval) in [ranges, wide][usize::from(is_raw)]
                .into_iter()
                .flat_map(|r| [0.05, 0.5, 2.0].map(|i| (r, i)))
            {
                let activation = activation(interval);
                let span = span(decode, &activation, &[low, high]);
                for max_error in [0.2, 0.03, 0.01, 0.001] {
                    let encoding = encoding_within(max_error, decode, &activation, &span);
                    assert!(encoding.max_error <= max_error);
                    let mut values: Vec<f32> =
                        (0..=2000).map(|i| low + (high - low) * (i as f32 / 2000.0)).collect();
                    if !encoding.number.is_float() {
                        let decoded: Vec<f32> = encoding.values().collect();
                        values.extend(decoded.windows(2).flat_map(|pair| {
                            let border = 0.5 * pair[0] + 0.5 * pair[1];
                            [border.next_down(), border, border.next_up()]
                        }));
                    }
                    values.retain(|value| (low..=high).contains(value));
                    let (mut codes, mut back) = (vec![0; values.len()], vec![0.0; values.len()]);
                    Quantizer::new(encoding.clone()).encode(&values, &mut codes);
                    decode_values(&encoding, codes.into_iter(), &mut back);
                    for (&value, &back) in values.iter().zip(&back) {
                        let [got, want] =
                            [back, value].map(|v| decode.activated(v.into(), &activation));
                        let error = (got - want).abs();
                        assert!(
                            error <= encoding.max_error.into(),
                            "{value} as {back}: {encoding:?}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn whole_ranges_take_no_more_bits_than_the_fixed_encodings() {
        let activation = activation(0.5);
        for bits in 4..=12 {
            let fixed = |decode| linear::planned_encoding(Bits::Integer(bits), decode, &activation);
            let bounded = Decode::ALL.into_iter();
            let bounded = bounded.filter(|&decode| !is_laid_over_values(decode, &activation));
            for decode in bounded {
                let fixed = fixed(decode);
                let values: Vec<f32> = fixed.values().collect();
                let span = span(decode, &activation, &values);
                let found = encoding_within(fixed.max_error, decode, &activation, &span);
                assert!(found.bits <= bits, "{fixed:?}: {found:?}");
            }
        }
    }

    #[test]
    fn narrow_spans_take_few_bits_and_none_or_one_value_four() {
        let activation = activation(0.5);
        // The range of anisotropy always includes 0.
        for decode in Decode::ALL.into_iter().filter(|&decode| decode != Decode::Anisotropy) {
            let bits = |values: &[f32]| {
                encoding_within(1e-3, decode, &activation, &span(decode, &activation, values)).bits
            };
            for values in [&[][..], &[0.7], &[0.7, 0.7 + 1e-7]] {
                assert_eq!(bits(values), 4, "{decode:?} {values:?}");
            }
            let steepest = Domain::of(decode, &activation).steepest as f32;
            let around = |far: f32| [steepest - far, steepest + far];
            assert!(bits(&around(0.05)) < bits(&around(0.4)), "{decode:?}");
        }
    }
}
