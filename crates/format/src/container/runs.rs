//! Atlases as runs of frames. Each run is compressed on its own.
//!
//! A run holds consecutive frames of one group, in the form of [`crate::quantize::run_bytes`]. Runs
//! are independent zstd frames and decode in parallel. A run that zstd cannot shrink is stored
//! uncompressed. An atlas chunk is
//!
//! ```text
//! u32 frames of a full run, u32 runs,
//! then for each run u32 length (top bit: stored), then the runs
//! ```

use std::borrow::Cow;
use std::cell::RefCell;
use std::io::Write;
use std::ops::Range;
use std::sync::Arc;

use zstd::bulk::Decompressor;
use zstd::zstd_safe::{CParameter, Strategy};

use crate::base::bytes::{ByteReader, Spill};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{self, Budget, Limits};
use crate::base::parallel;
use crate::model::baked::{Codes, Encoding, with_codes};
use crate::quantize::{Code, Frame, FrameShape, RunBytes, run_bytes, run_codes};

/// Approximate bytes of codes in a full run: small enough for parallel decoding, large enough for
/// several modes.
pub const RUN_BYTES: usize = 512 << 10;
/// First bytes of a zstd frame.
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
/// Top bit of a run's length: the run is stored, not compressed.
const STORED: u32 = 1 << 31;

/// An atlas for writing.
#[derive(Debug, Default)]
pub struct EncodedAtlas {
    frames_per_run: u32,
    runs: Vec<CompressedRun>,
}

/// Frames of a full run.
pub fn frames_per_run(shape: FrameShape) -> usize {
    (RUN_BYTES / shape.bytes()).max(1)
}

/// A run for writing.
#[derive(Debug)]
pub struct CompressedRun {
    bytes: Held,
    length: u32,
    /// CRC-32 of the bytes.
    checksum: u32,
    stored: bool,
}

/// The bytes of a run, in memory or in a spill file.
#[derive(Debug)]
enum Held {
    InMemory(Vec<u8>),
    Spilled(Arc<Spill>, Range<u64>),
}

impl CompressedRun {
    /// Compresses a run of `frames`. Don't-care nodes get codes of at most `dont_care_max`.
    pub fn new(
        shape: FrameShape,
        frames: &[Frame],
        dont_care_max: u32,
        level: i32,
    ) -> Result<Self> {
        let run = run_bytes(shape, frames, dont_care_max);
        let packed = compress_sections(&run, level)?;
        let stored = packed.len() >= run.bytes.len();
        let mut bytes = if stored { run.bytes } else { packed };
        bytes.shrink_to_fit();
        let (length, checksum) = (fits_u32(bytes.len())?, crc32fast::hash(&bytes));
        Ok(Self { bytes: Held::InMemory(bytes), length, checksum, stored })
    }

    /// Length of the run in bytes.
    pub fn length(&self) -> u64 {
        self.length.into()
    }

    /// Moves the run's bytes from memory to a spill file.
    pub fn spill(&mut self, to: &Arc<Spill>) -> Result<()> {
        if let Held::InMemory(bytes) = &self.bytes {
            self.bytes = Held::Spilled(Arc::clone(to), to.append(bytes)?);
        }
        Ok(())
    }

    fn bytes(&self) -> Result<Cow<'_, [u8]>> {
        match &self.bytes {
            Held::InMemory(bytes) => Ok(Cow::Borrowed(bytes)),
            Held::Spilled(spill, range) => Ok(Cow::Owned(spill.read(range.clone())?)),
        }
    }
}

/// The shorter of two encodings: entropy-coded bytes and, above the lowest effort, a zstd frame.
/// Residuals hardly repeat, and zstd wastes bits on accidental matches.
fn compress_sections(run: &RunBytes, level: i32) -> Result<Vec<u8>> {
    let frequencies = [
        CParameter::Strategy(Strategy::ZSTD_fast),
        CParameter::MinMatch(7),
        CParameter::HashLog(6),
    ];
    let coded = pack(run, 1, &frequencies);
    let packed = match level {
        ..=1 => coded,
        _ => coded.and_then(|coded| {
            let searched = pack(run, level, &[])?;
            Ok(if searched.len() < coded.len() { searched } else { coded })
        }),
    };
    packed.map_err(|error| Error::new(ErrorKind::Io(error), Place::File))
}

/// One zstd frame that states its length. Each section starts a new zstd block with its own tables.
fn pack(run: &RunBytes, level: i32, parameters: &[CParameter]) -> std::io::Result<Vec<u8>> {
    let mut encoder = zstd::stream::write::Encoder::new(Vec::new(), level)?;
    parameters.iter().try_for_each(|&parameter| encoder.set_parameter(parameter))?;
    encoder.include_contentsize(true)?;
    encoder.set_pledged_src_size(Some(run.bytes.len() as u64))?;
    let mut left = &run.bytes[..];
    let mut start = 0;
    for &end in &run.sections {
        let (section, rest) = left.split_at_checked(end - start).unwrap_or((left, &[]));
        encoder.write_all(section)?;
        (left, start) = (rest, end);
        if !section.is_empty() && !left.is_empty() {
            encoder.flush()?;
        }
    }
    encoder.finish()
}

impl EncodedAtlas {
    /// An atlas of these runs, in order.
    pub fn new(frames_per_run: usize, runs: Vec<CompressedRun>) -> Result<Self> {
        Ok(Self { frames_per_run: fits_u32(frames_per_run)?, runs })
    }

    /// Length of all runs in bytes.
    pub fn bytes(&self) -> u64 {
        self.runs.iter().map(CompressedRun::length).sum()
    }

    /// The codes of its `frames` frames.
    pub fn codes(&self, shape: FrameShape, encoding: &Encoding, frames: usize) -> Result<Codes> {
        let mut chunk = Vec::new();
        self.for_each_piece(|piece| {
            chunk.extend(piece);
            Ok(())
        })?;
        // Not read from a file, so its size is trusted.
        let mut budget = Budget::new(&Limits { memory: u64::MAX, ..Limits::default() });
        decode(shape, encoding, frames, &chunk, &Place::File, 0, &mut budget)
    }

    /// Calls `take` with the bytes of the chunk, piece by piece.
    pub fn for_each_piece(&self, mut take: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        take(&self.head()?)?;
        self.runs.iter().try_for_each(|run| take(&run.bytes()?))
    }

    /// Length and CRC-32 of the chunk, combined from those of its runs.
    pub fn length_and_checksum(&self) -> Result<(u64, u32)> {
        let head = self.head()?;
        let mut sum = crc32fast::Hasher::new();
        sum.update(&head);
        for run in &self.runs {
            sum.combine(&crc32fast::Hasher::new_with_initial_len(run.checksum, run.length()));
        }
        Ok((head.len() as u64 + self.bytes(), sum.finalize()))
    }

    /// The chunk's bytes before the runs.
    fn head(&self) -> Result<Vec<u8>> {
        let mut head = Vec::with_capacity(8 + 4 * self.runs.len());
        head.extend(self.frames_per_run.to_le_bytes());
        head.extend(fits_u32(self.runs.len())?.to_le_bytes());
        for run in &self.runs {
            head.extend((run.length | if run.stored { STORED } else { 0 }).to_le_bytes());
        }
        Ok(head)
    }
}

/// Compresses to one zstd frame, without a checksum because the chunk has one.
pub fn compress(bytes: &[u8], level: i32) -> Result<Vec<u8>> {
    zstd::bulk::compress(bytes, level)
        .map_err(|error| Error::new(ErrorKind::Io(error), Place::File))
}

thread_local! {
    // The tables of a context are larger than most inflated runs, so contexts are reused.
    static DECOMPRESSOR: RefCell<Decompressor<'static>> = RefCell::default();
}

/// Decompresses to exactly `length` bytes.
pub fn decompress(bytes: &[u8], length: usize, place: &Place) -> Result<Vec<u8>> {
    let wrong = |found: String| {
        Err(Error::malformed(place.clone(), found, format!("a zstd frame of {length} bytes")))
    };
    // One frame, no skippable frames, and nothing after it, so that content has one encoding.
    let is_one = bytes.starts_with(&ZSTD_MAGIC)
        && zstd::zstd_safe::find_frame_compressed_size(bytes).is_ok_and(|size| size == bytes.len());
    if !is_one {
        return wrong("bytes that are not one zstd frame".to_owned());
    }
    match DECOMPRESSOR.with_borrow_mut(|context| context.decompress(bytes, length)) {
        Ok(out) if out.len() == length => Ok(out),
        Ok(out) => wrong(format!("a zstd frame of {} bytes", out.len())),
        Err(error) => wrong(format!("a broken zstd frame ({error})")),
    }
}

/// Decompresses a run to the length that it states, at most `max_bytes` bytes.
pub(super) fn decompress_run(bytes: &[u8], max_bytes: usize, place: &Place) -> Result<Vec<u8>> {
    let stated = zstd::zstd_safe::get_frame_content_size(bytes).ok().flatten();
    let stated = stated.and_then(|length| usize::try_from(length).ok());
    match stated.filter(|&length| length <= max_bytes) {
        Some(length) => decompress(bytes, length, place),
        None => {
            let found = format!("a run that states {stated:?} bytes");
            Err(Error::malformed(place.clone(), found, format!("one of at most {max_bytes} bytes")))
        }
    }
}

/// Decodes an atlas chunk that starts at `offset` in its file and holds `frames` frames.
pub fn decode(
    shape: FrameShape,
    encoding: &Encoding,
    frames: usize,
    chunk: &[u8],
    place: &Place,
    offset: u64,
    budget: &mut Budget,
) -> Result<Codes> {
    let runs = split(frames, chunk, place, offset)?;
    let values = limits::product(
        &[frames as u64, shape.channels as u64, shape.edge.pow(3) as u64],
        "code count",
        place,
    )?;
    budget.spend(values as u64 * shape.number.bytes() as u64, "bytes of codes", place)?;
    let mut codes = Codes::zeroed(shape.number, values);
    with_codes!(&mut codes, codes => decode_runs(shape, encoding, &runs, codes, place))?;
    Ok(codes)
}

fn decode_runs<T: Code>(
    shape: FrameShape,
    encoding: &Encoding,
    runs: &[Run],
    codes: &mut [T],
    place: &Place,
) -> Result<()> {
    let allowed = encoding.codes();
    let (lowest, highest) = (T::narrow(*allowed.start()), T::narrow(*allowed.end()));
    let full = runs.first().map_or(1, |run| run.frames * shape.channels * shape.nodes());
    let mut parts: Vec<&mut [T]> = codes.chunks_mut(full.max(1)).collect();
    parallel::map_mut(&mut parts, |i, codes| {
        let Some(run) = runs.get(i) else { return Ok(()) };
        let inflated;
        let bytes = if run.stored {
            run.bytes
        } else {
            let max_bytes = shape.max_bytes(run.frames).unwrap_or(usize::MAX);
            inflated = decompress_run(run.bytes, max_bytes, place)?;
            &inflated
        };
        run_codes(shape, bytes, codes, place)?;
        let ends = |(low, high): (T, T), &code: &T| (low.min(code), high.max(code));
        let (low, high) = codes.iter().fold((highest, lowest), ends);
        if (lowest..=highest).contains(&low) && (lowest..=highest).contains(&high) {
            return Ok(());
        }
        Err(Error::malformed(
            place.clone(),
            format!("codes from {} to {} in run {i}", low.code(), high.code()),
            format!("codes from {} to {}", allowed.start(), allowed.end()),
        ))
    })?;
    Ok(())
}

struct Run<'a> {
    frames: usize,
    stored: bool,
    bytes: &'a [u8],
}

/// Finds the runs of a chunk and checks their total length.
fn split<'a>(frames: usize, chunk: &'a [u8], place: &Place, offset: u64) -> Result<Vec<Run<'a>>> {
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
        runs.push(run);
    }
    if reader.left() > 0 {
        let found = format!("{} bytes after the last run", reader.left());
        return Err(Error::malformed(reader.place(), found, "the end of the chunk"));
    }
    Ok(runs)
}

pub(super) fn fits_u32(count: usize) -> Result<u32> {
    u32::try_from(count)
        .ok()
        .filter(|count| count & STORED == 0)
        .ok_or_else(|| Error::new(ErrorKind::Overflow { what: "run" }, Place::File))
}
