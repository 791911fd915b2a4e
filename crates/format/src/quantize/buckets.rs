//! Looks up the codes of values in a table of buckets.
//!
//! A bucket's number is the value's distance from the middle plus a bias, truncated to its exponent
//! and a few bits. Bucket numbers are monotone in the value, and no bucket has two borders between
//! codes. So a value's code is the number of borders in the buckets below, plus one if the value
//! has reached the border of its own bucket.

use multiversion::multiversion;

use super::code_word::Code;
use crate::model::baked::Encoding;

/// Buckets of a table, which takes 5 KiB and fits into the first-level cache.
const BUCKETS: usize = 1024;
/// Values that are looked up together.
const RUN: usize = 256;
/// Candidate numbers of mantissa bits in a bucket's number; the smallest sufficient one is used.
const DIGITS: std::ops::RangeInclusive<u32> = 2..=8;
/// Candidate biases as powers of two, in steps of codes.
const BIASES: std::ops::Range<i32> = 0..10;

/// Borders between codes, by bucket.
#[derive(Debug, Clone)]
pub struct Buckets {
    place: Place,
    /// The border in each bucket, or NaN without a border, which no value reaches.
    borders: Box<[f32; BUCKETS]>,
    /// Number of borders in the buckets below each.
    below: Box<[u8; BUCKETS]>,
}

/// The mapping from values to buckets.
#[derive(Debug, Clone, Copy)]
struct Place {
    center: f32,
    /// Values beyond these are in their buckets.
    lowest: f32,
    highest: f32,
    bias: f32,
    /// Number of truncated bits.
    cut: u32,
    /// The truncated bias.
    first: i32,
}

impl Place {
    fn new(encoding: &Encoding, digits: u32, bias: i32) -> Self {
        let (bias, cut) = (encoding.step * (1 << bias) as f32, f32::MANTISSA_DIGITS - 1 - digits);
        Self {
            center: encoding.center,
            lowest: encoding.value(0),
            highest: encoding.value(encoding.last_code()),
            bias,
            cut,
            first: (bias.to_bits() >> cut) as i32,
        }
    }

    /// The bucket of a value, counted from the middle. NaN is in the lowest.
    #[inline(always)]
    fn off_middle(&self, value: f32) -> i32 {
        let inside = value.max(self.lowest).min(self.highest);
        let distance = (inside - self.center).abs() + self.bias;
        let bucket = (distance.to_bits() >> self.cut) as i32 - self.first;
        // All bits turned: -1 - bucket.
        bucket ^ -i32::from(inside < self.center)
    }

    /// The number of a value's bucket, clamped to the table.
    #[inline(always)]
    fn bucket(&self, value: f32) -> u16 {
        ((self.off_middle(value) + (BUCKETS / 2) as i32) as usize % BUCKETS) as u16
    }

    /// True if all values have a bucket of the table.
    fn fits(&self) -> bool {
        let ends = -(BUCKETS as i32 / 2)..BUCKETS as i32 / 2;
        [self.lowest, self.highest].iter().all(|&end| ends.contains(&self.off_middle(end)))
    }
}

impl Buckets {
    /// For at most 256 codes of an encoding with these ascending `borders`. None if no table has a
    /// bucket for each border.
    pub fn new(encoding: &Encoding, borders: &[f32]) -> Option<Self> {
        if borders.len() > usize::from(u8::MAX) {
            return None;
        }
        let places = DIGITS.flat_map(|digits| BIASES.map(move |bias| (digits, bias)));
        let mut places = places.map(|(digits, bias)| Place::new(encoding, digits, bias));
        let apart = |place: &Place| {
            let mut buckets = borders.iter().map(|&border| place.off_middle(border));
            let mut last = i32::MIN;
            buckets.all(|bucket| std::mem::replace(&mut last, bucket) < bucket)
        };
        let place = places.find(|place| place.fits() && apart(place))?;
        let mut table =
            Self { place, borders: Box::new([f32::NAN; BUCKETS]), below: Box::new([0; BUCKETS]) };
        for &border in borders {
            table.borders[usize::from(place.bucket(border))] = border;
        }
        let mut below = 0;
        for (count, border) in table.below.iter_mut().zip(&*table.borders) {
            *count = below;
            below += u8::from(!border.is_nan());
        }
        Some(table)
    }

    /// The code of each value.
    pub fn codes<T: Code>(&self, values: &[f32], codes: &mut [T]) {
        codes_of(self, values, codes);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn codes_of<T: Code>(table: &Buckets, values: &[f32], codes: &mut [T]) {
    let place = table.place;
    let (borders, below) = (&*table.borders, &*table.below);
    for (values, codes) in values.chunks(RUN).zip(codes.chunks_mut(RUN)) {
        // The first loop is vectorized; the second one reads the table one by one.
        let mut buckets = [0; RUN];
        for (bucket, &value) in buckets.iter_mut().zip(values) {
            *bucket = place.bucket(value);
        }
        for ((code, &value), &bucket) in codes.iter_mut().zip(values).zip(&buckets) {
            let bucket = usize::from(bucket) % BUCKETS;
            let reached = u32::from(value >= borders[bucket]);
            *code = T::narrow(u32::from(below[bucket]) + reached);
        }
    }
}
