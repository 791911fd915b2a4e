//! Measures the speed of bakes against the speed of the machine.
//!
//! ```text
//! cargo bench --bench bake -- [SCENE] [--sizes 128,256] [--half 1024] [--scenes DIR]
//!                             [--options "..."]
//!                             [--stepsize S] [--near T] [--far T]
//! ```
//!
//! Upsamples the scene to each size (`--half` in float16) once, in `--scenes` (default
//! `target/scenes`), and bakes it as users do, five times. Prints the medians: seconds, also once
//! with a cold file cache; the gain from threads; stages with bytes and GB/s; peak resident memory
//! as the operating system counts it. Also prints the ratio to a floor that is measured in the same
//! run: one pass over the density with all threads, a copy of the colour of retained nodes, and
//! zstd of the codes at the same level and threads.

mod arguments;
use mipvog_testing as common;
mod scaled;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use arguments::{Arguments, number};
use common::open_bytes;
use mipvog::base::bytes::SourceFile;
use mipvog::base::parallel;
use mipvog::model::baked::Codes;
use scaled::Element;
use serde_json::Value;

/// Bakes of each scene; their median counts.
const ROUNDS: usize = 5;
/// Bytes that are read or compressed at once.
const PIECE: u64 = 1 << 20;
/// Bytes of codes in a frame of zstd.
const FRAME: usize = 256 << 10;

fn main() {
    let arguments = Arguments::read(&["--sizes", "--half", "--scenes", "--options"]);
    let sizes = |name: &str, default: &'static str| -> Vec<usize> {
        let text = arguments.own(name).unwrap_or(default).to_owned();
        let sizes = text.split(',').filter(|size| !size.is_empty());
        sizes.map(number).collect()
    };
    let folder = arguments.own("--scenes").map_or_else(default_folder, PathBuf::from);
    std::fs::create_dir_all(&folder).expect("a folder that can be written");
    let options = arguments.own("--options").unwrap_or_default();
    let field = arguments.field();
    let all = sizes("--sizes", "128,256").into_iter().map(|size| (size, Element::F32));
    let all = all.chain(sizes("--half", "").into_iter().map(|size| (size, Element::F16)));
    println!(
        "| nodes | input | seconds | cold | one thread / all | stages | floor | ratio | peak memory | output |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for (side, element) in all {
        let kind = if element == Element::F32 { "f32" } else { "f16" };
        let path = folder.join(format!("scene{side}.{kind}.safetensors"));
        if !path.exists() {
            scaled::write(&field, side, element, &path);
        }
        measure(&path, side, options);
    }
}

fn default_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("target/scenes")
}

/// Bakes one scene and prints its row.
fn measure(scene: &Path, side: usize, options: &str) {
    let output = scene.with_extension("mipvog");
    let report = &median(scene, &output, options);
    let one_thread = median(scene, &output, &format!("{options} --threads 1"));
    let cold = forget(scene).then(|| seconds(&bake(scene, &output, options)));
    let cold = cold.map_or("-".to_owned(), |seconds| format!("{seconds:.3}"));
    let file = SourceFile::open(scene).expect("a scene");
    let element = file.length() / (8 * (side as u64).pow(3));
    let density = element * (side as u64).pow(3);
    let needed = report["pruned"][0]["needed_nodes"].as_u64().expect("nodes");
    let color = needed * element * color_channels(&output);
    let level = report["options"]["zstd_level"].as_i64().expect("a level") as i32;
    let floors = [pass_seconds(&file, density), copy_seconds(color), zstd_seconds(&output, level)];
    let floor: f64 = floors.iter().sum();
    let stages = report["stages"].as_array().expect("stages").iter().map(|stage| {
        let (seconds, bytes) = (seconds(stage), stage["bytes"].as_f64().expect("bytes"));
        let name = stage["name"].as_str().expect("a name");
        format!("{name} {seconds:.3} ({:.2} GB/s)", bytes / seconds.max(1e-9) / 1e9)
    });
    println!(
        "| {side} | {:.2} GB | {:.3} | {cold} | {:.2} | {} | {:.3} + {:.3} + {:.3} | {:.2} | {:.0} MB | {:.2} MB |",
        file.length() as f64 / 1e9,
        seconds(report),
        seconds(&one_thread) / seconds(report),
        stages.collect::<Vec<_>>().join(", "),
        floors[0],
        floors[1],
        floors[2],
        seconds(report) / floor,
        report["peak_memory_bytes"].as_f64().unwrap_or(0.0) / 1e6,
        report["output_bytes"].as_f64().expect("bytes") / 1e6,
    );
}

/// The report of the median of some bakes.
fn median(scene: &Path, output: &Path, options: &str) -> Value {
    let mut reports: Vec<Value> = (0..ROUNDS).map(|_| bake(scene, output, options)).collect();
    reports.sort_by(|a, b| seconds(a).total_cmp(&seconds(b)));
    reports.swap_remove(ROUNDS / 2)
}

/// Drops the system's cached pages of a file. `false` if it cannot be asked to.
fn forget(file: &Path) -> bool {
    let mut command = Command::new("dd");
    command.arg(format!("if={}", file.display())).args(["iflag=nocache", "count=0", "status=none"]);
    command.status().is_ok_and(|status| status.success())
}

fn seconds(of: &Value) -> f64 {
    of["seconds"].as_f64().expect("seconds")
}

/// The report of one bake, in a process of its own.
fn bake(scene: &Path, output: &Path, options: &str) -> Value {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"));
    command.arg("bake").arg(scene).arg("-o").arg(output);
    command.args(["--stepsize", "0.5", "--force", "--quiet", "--format", "json"]);
    let baked = command.args(options.split_whitespace()).output().expect("starts");
    assert!(baked.status.success(), "{}", String::from_utf8_lossy(&baked.stderr));
    serde_json::from_slice(&baked.stdout).expect("a report")
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

/// Reading `bytes` of a file and comparing every number, with all threads.
fn pass_seconds(file: &SourceFile, bytes: u64) -> f64 {
    best(|| {
        let above = parallel::map(bytes.div_ceil(PIECE) as usize, |piece| {
            let start = piece as u64 * PIECE;
            let read = file.read(start, PIECE.min(bytes - start), PIECE)?;
            let numbers = read
                .chunks_exact(4)
                .map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]]));
            Ok(numbers.filter(|&number| number > 0.0).count())
        });
        std::hint::black_box(above.expect("readable"));
    })
}

/// Copying `bytes` between pages that were touched before, with all threads.
fn copy_seconds(bytes: u64) -> f64 {
    let piece = (64 << 20).min(bytes as usize).max(1);
    let from = vec![1u8; piece];
    let mut to = vec![0u8; piece];
    let rounds = bytes as f64 / piece as f64;
    let share = piece.div_ceil(parallel::threads());
    let one = best(|| {
        let mut parts: Vec<_> = to.chunks_mut(share).zip(from.chunks(share)).collect();
        let copied = parallel::map_mut(&mut parts, |_, (to, from)| {
            to.copy_from_slice(from);
            Ok(())
        });
        std::hint::black_box(copied.expect("no errors"));
    });
    one * rounds
}

/// Colour channels of a container.
fn color_channels(container: &Path) -> u64 {
    let bytes = std::fs::read(container).expect("a container");
    3 + open_bytes(&bytes).expect("valid").metadata().features as u64
}

/// Compressing the codes of a container in frames, with all threads.
fn zstd_seconds(container: &Path, level: i32) -> f64 {
    let bytes = std::fs::read(container).expect("a container");
    let baked = open_bytes(&bytes).expect("valid").read().expect("levels");
    let mut codes: Vec<u8> = Vec::new();
    for level in &baked.levels {
        for group in level.atlases.iter().flatten() {
            match group {
                Codes::U8(of) => codes.extend(of),
                Codes::U16(of) => of.iter().for_each(|code| codes.extend(code.to_le_bytes())),
                Codes::U32(of) => of.iter().for_each(|code| codes.extend(code.to_le_bytes())),
            }
        }
    }
    let frames: Vec<&[u8]> = codes.chunks(FRAME).collect();
    best(|| {
        let sizes = parallel::map(frames.len(), |i| {
            Ok(zstd::bulk::compress(frames[i], level).expect("compresses").len())
        });
        std::hint::black_box(sizes.expect("no errors"));
    })
}
