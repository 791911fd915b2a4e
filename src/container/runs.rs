//! Atlases as runs of frames, each compressed on its own.
//!
//! A run holds consecutive frames of one group: for each channel, for each byte of the code's
//! width, the residual bytes of all frames. Runs are independent zstd frames, so they decode in
//! parallel; one that zstd cannot shrink is stored as it is. An atlas chunk is
//!
//! ```text
//! u32 frames of a full run, u32 runs, then for each run u32 length (top bit: stored), then the runs
//! ```

use crate::baked::{Codes, Encoding, NumberType};
use crate::bytes::ByteReader;
use crate::error::{Error, ErrorKind, Place, Result};
use crate::limits::{self, Budget};
use crate::parallel;
use crate::quantize::unpredict;

/// Uncompressed bytes of a full run, about: small enough for many at once, large enough that
/// compression loses nothing.
const RUN_BYTES: usize = 256 << 10;
/// First bytes of a zstd frame.
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
/// Top bit of a run's length: the run is stored, not compressed.
const STORED: u32 = 1 << 31;

/// Shape of the frames of an atlas.
#[derive(Debug, Clone, Copy)]
pub struct RunCodec {
    /// How codes are stored.
    pub number: NumberType,
    /// Channels of a frame.
    pub channels: usize,
    /// Nodes along a block's edge.
    pub edge: usize,
}

/// An atlas as it is written.
#[derive(Debug, Clone, Default)]
pub struct EncodedAtlas {
    frames_per_run: u32,
    runs: Vec<Vec<u8>>,
    stored: Vec<bool>,
}

impl RunCodec {
    /// Residual bytes of one channel of a frame.
    pub fn channel_bytes(&self) -> usize {
        self.edge.pow(3) * self.number.bytes()
    }

    /// Residual bytes of a frame.
    pub fn frame_bytes(&self) -> usize {
        self.channels * self.channel_bytes()
    }

    /// Frames of a full run.
    pub fn frames_per_run(&self) -> usize {
        (RUN_BYTES / self.frame_bytes()).max(1)
    }

    /// Compresses one run. `frames` hold each frame's residual bytes: for each channel, for each
    /// byte of the width, all nodes.
    pub fn compress(&self, frames: &[Vec<u8>], level: i32) -> Result<CompressedRun> {
        let nodes = self.edge.pow(3);
        let planes = self.channels * self.number.bytes();
        let mut bytes = Vec::with_capacity(frames.len() * self.frame_bytes());
        for plane in 0..planes {
            for frame in frames {
                bytes.extend_from_slice(
                    frame.get(plane * nodes..(plane + 1) * nodes).unwrap_or(&[]),
                );
            }
        }
        let packed = compress(&bytes, level)?;
        let stored = packed.len() >= bytes.len();
        Ok(CompressedRun { bytes: if stored { bytes } else { packed }, stored })
    }
}

/// A run as it is written.
#[derive(Debug, Clone)]
pub struct CompressedRun {
    bytes: Vec<u8>,
    stored: bool,
}

impl EncodedAtlas {
    /// An atlas of these runs, in order.
    pub fn new(frames_per_run: usize, runs: Vec<CompressedRun>) -> Result<Self> {
        let stored = runs.iter().map(|run| run.stored).collect();
        let frames_per_run = fits_u32(frames_per_run)?;
        Ok(Self { frames_per_run, stored, runs: runs.into_iter().map(|run| run.bytes).collect() })
    }

    /// The chunk's bytes, in pieces.
    pub fn chunk(&self) -> Result<Vec<Vec<u8>>> {
        let mut head = Vec::new();
        head.extend(self.frames_per_run.to_le_bytes());
        head.extend(fits_u32(self.runs.len())?.to_le_bytes());
        for (run, &stored) in self.runs.iter().zip(&self.stored) {
            let flag = if stored { STORED } else { 0 };
            head.extend((fits_u32(run.len())? | flag).to_le_bytes());
        }
        let mut pieces = vec![head];
        pieces.extend(self.runs.iter().cloned());
        Ok(pieces)
    }
}

/// zstd, one frame, without a checksum of its own: the chunk has one.
pub fn compress(bytes: &[u8], level: i32) -> Result<Vec<u8>> {
    zstd::bulk::compress(bytes, level)
        .map_err(|error| Error::new(ErrorKind::Io(error), Place::File))
}

/// Inflates to exactly `length` bytes.
pub fn decompress(bytes: &[u8], length: usize, place: &Place) -> Result<Vec<u8>> {
    let wrong = |found: String| {
        Err(Error::malformed(place.clone(), found, format!("a zstd frame of {length} bytes")))
    };
    // One frame, no skippable ones, nothing after it: there is one way to write the same content.
    let is_one = bytes.starts_with(&ZSTD_MAGIC)
        && zstd::zstd_safe::find_frame_compressed_size(bytes).is_ok_and(|size| size == bytes.len());
    if !is_one {
        return wrong("bytes that are not one zstd frame".to_owned());
    }
    match zstd::bulk::decompress(bytes, length) {
        Ok(out) if out.len() == length => Ok(out),
        Ok(out) => wrong(format!("a zstd frame of {} bytes", out.len())),
        Err(error) => wrong(format!("a broken zstd frame ({error})")),
    }
}

/// Decodes an atlas chunk that starts at `offset` in its file and holds `frames` frames.
pub fn decode(
    codec: RunCodec,
    encoding: &Encoding,
    frames: usize,
    chunk: &[u8],
    place: &Place,
    offset: u64,
    budget: &mut Budget,
) -> Result<Codes> {
    let runs = split(codec, frames, chunk, place, offset)?;
    let values = limits::product(
        &[frames as u64, codec.channels as u64, codec.edge.pow(3) as u64],
        "code count",
        place,
    )?;
    budget.spend(values as u64 * codec.number.bytes() as u64, "bytes of codes", place)?;
    let allowed = encoding.codes();
    let decoded = parallel::map(runs.len(), |i| {
        let Some(run) = runs.get(i) else { return Ok(Vec::new()) };
        let length = run.frames * codec.frame_bytes();
        let inflated;
        let bytes = if run.stored {
            run.bytes
        } else {
            inflated = decompress(run.bytes, length, place)?;
            &inflated
        };
        let codes = run_codes(codec, run.frames, bytes);
        match codes.iter().position(|code| !allowed.contains(code)) {
            None => Ok(codes),
            Some(at) => Err(Error::malformed(
                place.clone(),
                format!("code {} at value {at} of run {i}", codes.get(at).copied().unwrap_or(0)),
                format!("codes from {} to {}", allowed.start(), allowed.end()),
            )),
        }
    })?;
    let codes = decoded.iter().flatten().copied();
    // Codes were made from, or checked against, the width that they are narrowed to.
    #[allow(clippy::cast_possible_truncation)]
    Ok(match codec.number {
        NumberType::U8 => Codes::U8(codes.map(|code| code as u8).collect()),
        NumberType::U16 | NumberType::F16 => Codes::U16(codes.map(|code| code as u16).collect()),
        NumberType::F32 => Codes::U32(codes.collect()),
    })
}

struct Run<'a> {
    frames: usize,
    stored: bool,
    bytes: &'a [u8],
}

/// Finds the runs of a chunk and holds their lengths against the chunk's.
fn split<'a>(
    codec: RunCodec,
    frames: usize,
    chunk: &'a [u8],
    place: &Place,
    offset: u64,
) -> Result<Vec<Run<'a>>> {
    let mut reader = ByteReader::new(chunk, offset);
    let per_run = reader.u32()? as usize;
    let count = reader.u32()? as usize;
    if per_run == 0 || frames.div_ceil(per_run) != count {
        let found = format!("{count} runs of {per_run} frames");
        return Err(Error::malformed(place.clone(), found, format!("runs for {frames} frames")));
    }
    let mut table = ByteReader::new(reader.take(count.saturating_mul(4))?, 0);
    let mut runs = Vec::with_capacity(count);
    for i in 0..count {
        let length = table.u32()?;
        let bytes = reader.take((length & !STORED) as usize)?;
        let run =
            Run { frames: per_run.min(frames - i * per_run), stored: length & STORED != 0, bytes };
        if run.stored && run.frames.checked_mul(codec.frame_bytes()) != Some(bytes.len()) {
            let found = format!("{} stored bytes in run {i}", bytes.len());
            let expected = format!("{} frames of {} bytes", run.frames, codec.frame_bytes());
            return Err(Error::malformed(place.clone(), found, expected));
        }
        runs.push(run);
    }
    if reader.left() > 0 {
        let found = format!("{} bytes after the last run", reader.left());
        return Err(Error::malformed(reader.place(), found, "the end of the chunk"));
    }
    Ok(runs)
}

/// The codes of a run, `[frame][channel][node]`.
fn run_codes(codec: RunCodec, frames: usize, bytes: &[u8]) -> Vec<u32> {
    let nodes = codec.edge.pow(3);
    let width = codec.number.bytes();
    let mut codes = vec![0; frames * codec.channels * nodes];
    for (i, codes) in codes.chunks_exact_mut(nodes).enumerate() {
        let (frame, channel) = (i / codec.channels, i % codec.channels);
        let plane = |byte: usize| {
            let at = ((channel * width + byte) * frames + frame) * nodes;
            bytes.get(at..at + nodes).unwrap_or_default()
        };
        unpredict(codec.number, codec.edge, plane, codes);
    }
    codes
}

pub(super) fn fits_u32(count: usize) -> Result<u32> {
    u32::try_from(count)
        .ok()
        .filter(|count| count & STORED == 0)
        .ok_or_else(|| Error::new(ErrorKind::Overflow { what: "run" }, Place::File))
}
