//! Blosc 1 buffers with LZ4, as OpenVDB has them.
//!
//! ```text
//! u8 version, u8 version of LZ4, u8 flags, u8 size of a value, u32 x 3: bytes, bytes of a block,
//! bytes of the buffer; a u32 for each block: its start in the buffer
//! block   streams of LZ4, each with its length as a u32; a stream as long as its bytes is plain
//! flags   1: bytes of values are shuffled; 2: the bytes are plain; 16: a block is one stream;
//!         bits 5 to 7: the codec, of which 1 is LZ4
//! ```
//!
//! A block has a stream for each byte of a value, unless the flag says otherwise, values are wide,
//! or the block is the last and shorter.

use crate::base::bytes::ByteReader;
use crate::base::error::{Error, Place, Result};

const SHUFFLED: u8 = 1;
const PLAIN: u8 = 2;
const BITS_SHUFFLED: u8 = 4;
const ONE_STREAM: u8 = 16;
const LZ4: u8 = 1;
const HEADER: usize = 16;
/// Blocks of wider values are one stream.
const MOST_STREAMS: usize = 16;
/// So are blocks with fewer values.
const FEWEST_VALUES: usize = 128;

/// The `length` bytes in a buffer.
///
/// # Errors
/// `Malformed`, `Truncated`, and `Unsupported` for other codecs than LZ4.
pub fn decompress(buffer: &[u8], length: usize, place: &Place) -> Result<Vec<u8>> {
    let malformed =
        |found: String, expected: &str| Error::malformed(place.clone(), found, expected);
    let mut reader = ByteReader::new(buffer, 0);
    let [_, _, flags, size] = reader.array()?;
    let [bytes, block, _] = [reader.u32()?, reader.u32()?, reader.u32()?];
    let wide = |number: u32| usize::try_from(number).unwrap_or(usize::MAX);
    let (block, size) = (wide(block), usize::from(size).max(1));
    if wide(bytes) != length || (block == 0 && length > 0) {
        let found = format!("a Blosc buffer of {bytes} bytes in blocks of {block}");
        return Err(malformed(found, &format!("{length} bytes")));
    }
    if flags & PLAIN != 0 {
        return reader.take(length).map(<[u8]>::to_vec);
    }
    if flags >> 5 != LZ4 || flags & BITS_SHUFFLED != 0 {
        let found = format!("a Blosc buffer of codec {} with flags {flags:#x}", flags >> 5);
        return Err(Error::unsupported(place.clone(), found, "LZ4 with shuffled bytes"));
    }
    let mut out = Vec::with_capacity(length);
    while out.len() < length {
        let start = wide(reader.u32()?);
        let count = block.min(length - out.len());
        let whole = count == block;
        let values = count / size;
        let one = flags & ONE_STREAM != 0 || !whole || size > MOST_STREAMS;
        let streams = if one || values < FEWEST_VALUES { 1 } else { size };
        let rest = buffer.get(start..).filter(|_| start >= HEADER);
        let rest = rest.ok_or_else(|| malformed(format!("a block at {start}"), "one inside"))?;
        let mut stream = ByteReader::new(rest, 0);
        let mut plain = Vec::with_capacity(count);
        for _ in 0..streams {
            let own = count / streams;
            let packed = wide(stream.u32()?);
            let packed = stream.take(packed)?;
            if packed.len() == own {
                plain.extend_from_slice(packed);
                continue;
            }
            let before = plain.len();
            plain.resize(before + own, 0);
            let target = plain.get_mut(before..).unwrap_or_default();
            let found = lz4_flex::block::decompress_into(packed, target);
            if !found.as_ref().is_ok_and(|&found| found == own) {
                let found = format!("an LZ4 stream: {found:?}");
                return Err(malformed(found, &format!("{own} bytes")));
            }
        }
        if flags & SHUFFLED != 0 && size > 1 {
            plain = unshuffled(&plain, size);
        }
        out.append(&mut plain);
    }
    Ok(out)
}

/// Unshuffles bytes that are grouped by their place in a value; a remainder after whole values
/// stays.
fn unshuffled(bytes: &[u8], size: usize) -> Vec<u8> {
    let values = bytes.len() / size;
    let mut out = bytes.to_vec();
    for (number, value) in out.chunks_exact_mut(size).enumerate() {
        for (place, byte) in value.iter_mut().enumerate() {
            *byte = bytes.get(place * values + number).copied().unwrap_or(0);
        }
    }
    out
}
