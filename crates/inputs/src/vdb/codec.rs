//! Values of a node: compressed, without those of inactive voxels.
//!
//! ```text
//! i8        0 and 1: inactive values are the background, or its negative
//!           2: one inactive value follows; 3 to 5: a mask picks between two
//!           6: all values are there
//! values    active ones only, unless 6 or the grid's flag says otherwise
//! ```
//!
//! Zlib and Blosc streams follow their length as an i64; a length of 0 or below means uncompressed
//! bytes. Empty values still have that length, except for numbers that were saved as half floats,
//! which have nothing.

use std::borrow::Cow;

use super::blosc;
use crate::base::bytes::ByteReader;
use crate::base::error::{Error, Place, Result};
use flate2::{Decompress, FlushDecompress, Status};
use half::f16;

/// Flags of a grid.
const ZIP: u32 = 1;
const ACTIVE_MASK: u32 = 2;
const BLOSC: u32 = 4;
/// All values are present.
const ALL: u8 = 6;

/// How the numbers of a grid are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// As float32.
    Full,
    /// Float32 in the program; the voxels of nodes were saved as half floats.
    SavedAsHalf,
    /// Half floats throughout, since OpenVDB 13.
    Half,
}

/// The values' type, and how they are compressed.
#[derive(Debug, Clone)]
pub struct Codec {
    /// Numbers of a value: 1 or 3.
    pub width: usize,
    /// How numbers are stored.
    pub precision: Precision,
    /// Flags.
    pub compression: u32,
    /// The background value, of voxels that are not stored.
    pub background: [f32; 3],
}

impl Codec {
    /// A value in the program's precision: backgrounds, tiles of the root, inactive values.
    pub fn full_value(&self, reader: &mut ByteReader) -> Result<[f32; 3]> {
        let mut value = [0.0; 3];
        for number in value.iter_mut().take(self.width) {
            *number = match self.precision {
                Precision::Half => f16::from_le_bytes(reader.array()?).to_f32(),
                Precision::Full | Precision::SavedAsHalf => f32::from_le_bytes(reader.array()?),
            };
        }
        Ok(value)
    }

    /// The values of a node with `count` voxels, of which `active` are. Calls `put` with the number
    /// of each and its value.
    pub fn read(
        &self,
        reader: &mut ByteReader,
        (count, active): (usize, &[u64]),
        inflater: &mut Inflater,
        mut put: impl FnMut(usize, [f32; 3]),
    ) -> Result<()> {
        let (place, kind) = (reader.place(), reader.u8()?);
        if kind > ALL {
            return Err(Error::malformed(place, format!("kind {kind} of values"), "0 to 6"));
        }
        let mut inactive = [self.background; 2];
        if kind == 1 {
            inactive[0] = self.background.map(|value| -value);
        }
        if kind == 3 {
            // The mask selects the background; other values are its negative.
            inactive[0] = self.background.map(|value| -value);
        }
        if matches!(kind, 2 | 4 | 5) {
            inactive[0] = self.full_value(reader)?;
        }
        if kind == 5 {
            inactive[1] = self.full_value(reader)?;
        }
        let mut second = Vec::new();
        if matches!(kind, 3..=5) {
            for _ in 0..count.div_ceil(64) {
                second.push(reader.u64()?);
            }
        }
        let is_on = |mask: &[u64], at: usize| {
            mask.get(at / 64).is_some_and(|word| word >> (at % 64) & 1 == 1)
        };
        let masked = kind != ALL && self.compression & ACTIVE_MASK != 0;
        let stored = match masked {
            true => (0..count).filter(|&at| is_on(active, at)).count(),
            false => count,
        };
        let size = self.width * if self.precision == Precision::Full { 4 } else { 2 };
        let bytes = self.bytes(reader, stored * size, inflater)?;
        let mut values = bytes.chunks_exact(size).map(|value| self.decode(value));
        for at in 0..count {
            let value = match masked && !is_on(active, at) {
                true if is_on(&second, at) => Some(inactive[1]),
                true => Some(inactive[0]),
                false => values.next(),
            };
            put(at, value.unwrap_or(self.background));
        }
        Ok(())
    }

    fn decode(&self, bytes: &[u8]) -> [f32; 3] {
        let mut value = [0.0; 3];
        if self.precision != Precision::Full {
            for (number, bytes) in value.iter_mut().zip(bytes.as_chunks::<2>().0) {
                *number = f16::from_le_bytes(*bytes).to_f32();
            }
        } else {
            for (number, bytes) in value.iter_mut().zip(bytes.as_chunks::<4>().0) {
                *number = f32::from_le_bytes(*bytes);
            }
        }
        value
    }

    /// This many bytes, decompressed.
    fn bytes<'a, 'file: 'a>(
        &self,
        reader: &mut ByteReader<'file>,
        length: usize,
        inflater: &'a mut Inflater,
    ) -> Result<Cow<'a, [u8]>> {
        if self.compression & (ZIP | BLOSC) == 0 {
            return reader.take(length).map(Cow::Borrowed);
        }
        if length == 0 && self.precision == Precision::SavedAsHalf {
            return Ok(Cow::Borrowed(&[]));
        }
        let (place, stated) = (reader.place(), reader.u64()?.cast_signed());
        let packed = usize::try_from(stated.unsigned_abs()).unwrap_or(usize::MAX);
        if stated <= 0 {
            if packed != length {
                let found = format!("{packed} bytes of values");
                return Err(Error::malformed(place, found, format!("{length}")));
            }
            return reader.take(length).map(Cow::Borrowed);
        }
        let packed = reader.take(packed)?;
        if self.compression & BLOSC != 0 {
            return blosc::decompress(packed, length, &place).map(Cow::Owned);
        }
        inflater.unzip(packed, length, &place).map(Cow::Borrowed)
    }
}

/// Inflates the streams of nodes, one after another: leaves are small, so tables of each one's own
/// would take as long as its codes.
pub struct Inflater {
    stream: Decompress,
    plain: Vec<u8>,
}

impl Default for Inflater {
    fn default() -> Self {
        Self { stream: Decompress::new(true), plain: Vec::new() }
    }
}

impl Inflater {
    fn unzip(&mut self, packed: &[u8], length: usize, place: &Place) -> Result<&[u8]> {
        self.stream.reset(true);
        if self.plain.len() < length {
            self.plain.resize(length, 0);
        }
        let plain = self.plain.get_mut(..length).unwrap_or_default();
        let found = match self.stream.decompress(packed, plain, FlushDecompress::Finish) {
            Ok(Status::StreamEnd) if self.stream.total_out() == length as u64 => return Ok(plain),
            Ok(Status::StreamEnd) => {
                format!("{} bytes in a zlib stream", self.stream.total_out())
            }
            Ok(_) => "a zlib stream without an end".to_owned(),
            Err(error) => format!("a zlib stream: {error}"),
        };
        Err(Error::malformed(place.clone(), found, format!("a whole one of {length} bytes")))
    }
}
