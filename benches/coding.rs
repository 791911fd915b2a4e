//! Measures the gain and the cost of the coding of atlases.
//!
//! ```text
//! cargo bench --bench coding -- CONTAINER...
//! ```
//!
//! For each group of level 0, and all of them: bytes, and their share of the plain codes with zstd
//! at level 19 (frame by frame, each with all channels); how fast one thread makes codes of runs,
//! with the share of zstd in it, as a ratio to a copy of the codes; and how fast one thread makes
//! runs of codes, with the share of compression in it. MB are of codes; the best of some rounds
//! counts.

use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use mipvog::base::bytes::SourceFile;
use mipvog::base::error::Place;
use mipvog::base::limits::Limits;
use mipvog::base::parallel;
use mipvog::container::{CompressedRun, Container};
use mipvog::model::baked::{Codes, Group};
use mipvog::quantize::{Code, Frame, FrameShape, run_bytes, run_codes};

/// Rounds of each measurement.
const ROUNDS: usize = 7;
/// Compression level of runs: the default.
const LEVEL: i32 = 1;

fn main() {
    println!(
        "| container | group | bytes | of plain zstd -19 | decode MB/s | zstd's share | copy's speed | encode MB/s | zstd's share |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for path in std::env::args().skip(1).filter(|argument| !argument.starts_with("--")) {
        parallel::with_threads(1, || measure(Path::new(&path))).expect("a thread");
    }
}

/// Figures of one group, or of all.
#[derive(Default, Clone, Copy)]
struct Figures {
    bytes: usize,
    plain: usize,
    codes: usize,
    inflate: f64,
    restore: f64,
    copy: f64,
    make: f64,
    compress: f64,
}

fn measure(path: &Path) {
    let file = Arc::new(SourceFile::open(path).expect("a file"));
    let container = Container::open(file, &Limits::default()).expect("a container");
    let level = container.read_level(0).expect("level 0");
    let metadata = &container.metadata().levels[0];
    let entries = container.entries().iter().filter(|entry| entry.level == Some(0));
    // The first chunk of a level is its table.
    let chunks: Vec<Vec<u8>> = entries
        .skip(1)
        .map(|entry| container.file().read(entry.offset, entry.length, u64::MAX).expect("a chunk"))
        .collect();
    let name = path.file_name().expect("a name").to_string_lossy();
    let (mut all, mut frames) = (Figures::default(), Vec::new());
    let groups = Group::ALL.into_iter().zip(&level.atlases);
    let present = groups.filter_map(|(group, codes)| Some((group, codes.as_ref()?)));
    for ((group, codes), chunk) in present.zip(&chunks) {
        let channels = group.channels(container.metadata().layout());
        let encoding = metadata.encoding(group).expect("an encoding");
        let shape = FrameShape { number: encoding.number, channels, edge: metadata.block_size };
        let made = split(shape, codes);
        frames.resize(frames.len().max(made.len()), Vec::new());
        frames.iter_mut().zip(&made).for_each(|(all, frame)| all.extend(bytes(&frame.codes)));
        let figures = group_figures(shape, codes, &made, chunk);
        print(&name, group.name(), figures);
        all.bytes += figures.bytes;
        all.codes += figures.codes;
        all.inflate += figures.inflate;
        all.restore += figures.restore;
        all.copy += figures.copy;
        all.make += figures.make;
        all.compress += figures.compress;
    }
    all.plain = compressed(&frames.concat());
    print(&name, "all", all);
}

fn print(container: &str, group: &str, figures: Figures) {
    let Figures { bytes, plain, codes, inflate, restore, copy, make, compress } = figures;
    let speed = |seconds: f64| codes as f64 / seconds / 1e6;
    println!(
        "| {container} | {group} | {bytes} | {:.1} % | {:.0} | {:.0} % | {:.1} | {:.0} | {:.0} % |",
        100.0 * bytes as f64 / plain as f64,
        speed(inflate + restore),
        100.0 * inflate / (inflate + restore),
        (inflate + restore) / copy,
        speed(make + compress),
        100.0 * compress / (make + compress),
    );
}

fn group_figures(shape: FrameShape, codes: &Codes, frames: &[Frame], chunk: &[u8]) -> Figures {
    let number =
        |at: usize| u32::from_le_bytes(chunk[at..at + 4].try_into().expect("four bytes")) as usize;
    let (full, count) = (number(0), number(4));
    let mut at = 8 + 4 * count;
    let mut packed = Vec::new();
    for run in 0..count {
        let (length, stored) = (number(8 + 4 * run) & 0x7fff_ffff, number(8 + 4 * run) >> 31 == 1);
        packed.push((&chunk[at..at + length], stored));
        at += length;
    }
    let mut runs = vec![Vec::new(); count];
    let inflate = best(|| {
        for (run, &(bytes, stored)) in runs.iter_mut().zip(&packed) {
            *run = if stored {
                bytes.to_vec()
            } else {
                zstd::bulk::decompress(bytes, shape.max_bytes(full).expect("a size"))
                    .expect("a run")
            };
        }
    });
    let (restore, copy) = match codes {
        Codes::U8(codes) => decode_seconds(shape, full, &runs, codes),
        Codes::U16(codes) => decode_seconds(shape, full, &runs, codes),
        Codes::U32(codes) => decode_seconds(shape, full, &runs, codes),
    };
    let make = best(|| {
        for frames in frames.chunks(full) {
            black_box(run_bytes(shape, frames, u32::MAX));
        }
    });
    let both = best(|| {
        for frames in frames.chunks(full) {
            black_box(CompressedRun::new(shape, frames, u32::MAX, LEVEL).expect("compresses"));
        }
    });
    let plain = compressed(&bytes(codes));
    let codes = frames.len() * shape.bytes();
    let compress = (both - make).max(0.0);
    Figures { bytes: chunk.len(), plain, codes, inflate, restore, copy, make, compress }
}

/// Seconds from inflated runs to codes, and of a copy of the codes.
fn decode_seconds<T: Code>(
    shape: FrameShape,
    full: usize,
    runs: &[Vec<u8>],
    codes: &[T],
) -> (f64, f64) {
    let mut out = vec![T::default(); codes.len()];
    let length = full * shape.channels * shape.nodes();
    let restore = best(|| {
        for (run, out) in runs.iter().zip(out.chunks_mut(length)) {
            run_codes(shape, run, out, &Place::File).expect("a run");
        }
    });
    assert!(out == codes);
    let copy = best(|| black_box(&mut out).copy_from_slice(codes));
    (restore, copy)
}

/// Every frame of an atlas, all of it retained.
fn split(shape: FrameShape, codes: &Codes) -> Vec<Frame> {
    let size = shape.channels * shape.nodes();
    let frame = |i: usize| Frame {
        codes: codes.slice(i * size..(i + 1) * size),
        retained: vec![true; shape.nodes()].into(),
    };
    (0..codes.len() / size).map(frame).collect()
}

fn bytes(codes: &Codes) -> Vec<u8> {
    match codes {
        Codes::U8(codes) => codes.clone(),
        Codes::U16(codes) => codes.iter().flat_map(|code| code.to_le_bytes()).collect(),
        Codes::U32(codes) => codes.iter().flat_map(|code| code.to_le_bytes()).collect(),
    }
}

/// Bytes of plain codes with zstd at level 19.
fn compressed(codes: &[u8]) -> usize {
    zstd::bulk::compress(codes, 19).expect("compresses").len()
}

/// The best of some runs.
fn best(mut run: impl FnMut()) -> f64 {
    let time = |_| {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64()
    };
    (0..ROUNDS).map(time).fold(f64::INFINITY, f64::min)
}
