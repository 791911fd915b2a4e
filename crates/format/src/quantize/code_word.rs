//! Arithmetic of codes, the same for each width.

use std::fmt::Debug;
use std::num::Wrapping;
use std::ops::{Add, Mul, Shr, Sub};

use crate::model::baked::{Codes, NumberType};

/// A stored code: `u8`, `u16` or `u32`.
pub trait Code: Copy + Default + Debug + Ord + Send + Sync + 'static {
    /// Type for sums of codes times weights in 32nds, modulo the code's width.
    type Wide: Wide;
    /// Type for sums of products of two terms of predictions: an integer if that is exact.
    type Sum: Sum;
    /// Number of nodes whose products fit into such a sum.
    const SUMMED: usize;
    /// Bytes of a code.
    const BYTES: usize;

    /// The codes, if they have this type.
    fn of(codes: &Codes) -> &[Self];
    /// The same number.
    fn wide(self) -> Self::Wide;
    /// A term of a prediction, ready for products.
    fn factor(term: Self::Wide) -> Self::Sum;
    /// The number modulo the width.
    fn wrap(wide: Self::Wide) -> Self;
    /// A third of the sum of three codes, rounded down.
    fn third(sum: Self::Wide) -> Self;
    /// Half of each byte's range, which is added to stored residuals, so that small residuals of
    /// either sign have the same upper bytes.
    fn bias() -> Self::Wide;
    /// Itself if all bits of `mask` are set, `other` if none is.
    fn choose(self, other: Self, mask: Self) -> Self;
    /// All bits if `set`, else itself.
    fn with_all_if(self, set: bool) -> Self;
    /// The lowest bits of a code in 32 bits.
    fn narrow(code: u32) -> Self;
    /// The code in 32 bits.
    fn code(self) -> u32;
    /// Byte `i` of the code, the lowest first.
    fn byte(self, i: usize) -> u8;

    /// The mean of a block's first node, which has no neighbours: the code of +0 for floats.
    fn origin(number: NumberType) -> Self {
        Self::narrow(match number {
            NumberType::U8 | NumberType::U16 => 0,
            NumberType::F16 => 1 << 15,
            NumberType::F32 => 1 << 31,
        })
    }
}

/// A signed number wider than a code. Sums and differences of a few codes are exact; products are
/// exact at least in all bits that predictions use.
pub trait Wide:
    Copy
    + Default
    + Debug
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Shr<usize, Output = Self>
{
    /// A weight.
    fn from_i8(weight: i8) -> Self;
}

/// An accumulator for products.
pub trait Sum: Copy + Default + Debug + Add<Output = Self> + Mul<Output = Self> {
    /// Its size.
    fn size(self) -> Self;
    /// The nearest f64.
    fn to_f64(self) -> f64;
}

impl Sum for i32 {
    #[inline(always)]
    fn size(self) -> Self {
        self.abs()
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self.into()
    }
}

impl Sum for f64 {
    #[inline(always)]
    fn size(self) -> Self {
        self.abs()
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
}

macro_rules! wide {
    ($number:ty) => {
        impl Wide for Wrapping<$number> {
            #[inline(always)]
            fn from_i8(weight: i8) -> Self {
                Self(weight.into())
            }
        }
    };
}

wide!(i16);
wide!(i32);
wide!(i64);

macro_rules! code {
    ($code:ty, $variant:ident, $wide:ty, $sum:ty, $summed:expr, $bias:expr, $third:expr) => {
        impl Code for $code {
            type Wide = Wrapping<$wide>;
            type Sum = $sum;
            const SUMMED: usize = $summed;
            const BYTES: usize = size_of::<$code>();

            fn of(codes: &Codes) -> &[Self] {
                if let Codes::$variant(codes) = codes { codes } else { &[] }
            }
            #[inline(always)]
            fn wide(self) -> Self::Wide {
                Wrapping(self.into())
            }
            #[inline(always)]
            fn factor(term: Self::Wide) -> $sum {
                term.0 as $sum
            }
            #[inline(always)]
            fn wrap(wide: Self::Wide) -> Self {
                wide.0 as $code
            }
            #[inline(always)]
            fn third(sum: Self::Wide) -> Self {
                let third: fn($wide) -> $wide = $third;
                third(sum.0) as $code
            }
            #[inline(always)]
            fn bias() -> Self::Wide {
                Wrapping($bias)
            }
            #[inline(always)]
            fn choose(self, other: Self, mask: Self) -> Self {
                (self & mask) | (other & !mask)
            }
            #[inline(always)]
            fn with_all_if(self, set: bool) -> Self {
                self | (set as $code).wrapping_neg()
            }
            #[inline(always)]
            fn narrow(code: u32) -> Self {
                code as $code
            }
            #[inline(always)]
            fn code(self) -> u32 {
                self.into()
            }
            #[inline(always)]
            fn byte(self, i: usize) -> u8 {
                (self.code() >> (8 * i)) as u8
            }
        }
    };
}

// Of a u8 prediction, only the low 8 bits count, which are the 13 lowest of sums in 32nds, so 16
// bits suffice for vectors. The upper half of a product replaces the division, which vectors lack:
// exact up to 765. A term of u8 is at most three codes' difference, 765: 3,000 squares of it fit 31
// bits.
code!(u8, U8, i16, i32, 3000, 0x80, |sum| ((sum as u16 as u32 * 21_846) >> 16) as i16);
code!(u16, U16, i32, f64, usize::MAX, 0x8080, |sum| sum / 3);
code!(u32, U32, i64, f64, usize::MAX, 0x8080_8080, |sum| sum / 3);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thirds_are_rounded_down() {
        for sum in 0..=3 * 255 {
            assert_eq!(i16::from(u8::third(Wrapping(sum))), sum / 3);
        }
        assert_eq!(u16::third(Wrapping(3 * 65_535)), u16::MAX);
        assert_eq!(u32::third(Wrapping(3 * i64::from(u32::MAX) - 1)), u32::MAX - 1);
    }
}
