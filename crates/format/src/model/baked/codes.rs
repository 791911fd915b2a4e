//! Codes of an atlas, in integers of three widths.

use std::ops::Range;

use super::NumberType;

/// Codes of one group of one level: `[frame][channel][node]`, z fastest within a block.
#[derive(Debug, Clone, PartialEq)]
pub enum Codes {
    /// Quantized to at most 8 bits.
    U8(Vec<u8>),
    /// Quantized to 9 to 16 bits, or the bits of a binary16.
    U16(Vec<u16>),
    /// The bits of a binary32.
    U32(Vec<u32>),
}

/// The same with codes of each width.
macro_rules! with_codes {
    ($codes:expr, $vector:ident => $value:expr) => {
        match $codes {
            $crate::model::baked::Codes::U8($vector) => $value,
            $crate::model::baked::Codes::U16($vector) => $value,
            $crate::model::baked::Codes::U32($vector) => $value,
        }
    };
}
pub(crate) use with_codes;

/// Codes of the same width from codes of each width.
macro_rules! map_codes {
    ($codes:expr, $vector:ident => $value:expr) => {
        match $codes {
            Self::U8($vector) => Self::U8($value),
            Self::U16($vector) => Self::U16($value),
            Self::U32($vector) => Self::U32($value),
        }
    };
}

impl Codes {
    /// This many zeros, in the width of `number`.
    pub fn zeroed(number: NumberType, count: usize) -> Self {
        match number {
            NumberType::U8 => Self::U8(vec![0; count]),
            NumberType::U16 | NumberType::F16 => Self::U16(vec![0; count]),
            NumberType::F32 => Self::U32(vec![0; count]),
        }
    }

    /// Codes in all.
    pub fn len(&self) -> usize {
        with_codes!(self, codes => codes.len())
    }

    /// True if these are this many codes in the width of `number`.
    pub fn fit(&self, number: NumberType, count: usize) -> bool {
        self.number_bytes() == number.bytes() && self.len() == count
    }

    /// Bytes of one code.
    pub fn number_bytes(&self) -> usize {
        match self {
            Self::U8(_) => 1,
            Self::U16(_) => 2,
            Self::U32(_) => 4,
        }
    }

    /// True if empty.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The code at a place.
    pub fn code(&self, at: usize) -> u32 {
        match self {
            Self::U8(codes) => codes[at].into(),
            Self::U16(codes) => codes[at].into(),
            Self::U32(codes) => codes[at],
        }
    }

    /// A copy of a range.
    #[must_use]
    pub fn slice(&self, range: Range<usize>) -> Self {
        map_codes!(self, codes => codes[range].to_vec())
    }

    /// A copy of the frames of `length` codes each that `keep` marks, in their order.
    #[must_use]
    pub fn kept_frames(&self, length: usize, keep: &[bool]) -> Self {
        fn kept<T: Copy>(codes: &[T], length: usize, keep: &[bool]) -> Vec<T> {
            let frames = codes.chunks_exact(length).zip(keep).filter(|(_, keep)| **keep);
            frames.flat_map(|(frame, _)| frame).copied().collect()
        }
        map_codes!(self, codes => kept(codes, length, keep))
    }
}
