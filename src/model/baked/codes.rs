//! Codes of an atlas, in integers of three widths.

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
