//! The fuzz targets of `fuzz/` on seeded mutants of the fixtures: no panic, no hang, no memory
//! beyond the limit.
//!
//! `MIPVOG_FUZZ_RUNS` sets the number of mutants of each target, and `MIPVOG_FUZZ_SEED` picks
//! others. A failing input is written to `target/fuzz/` and belongs into `fuzz/found/TARGET/`, whose
//! files are run too. `MIPVOG_FUZZ_CORPUS` names a folder that gets the seeds, as cargo-fuzz takes
//! them.

use std::panic::catch_unwind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::alone::measured;
use super::factored::SMALL_MODELS;
use super::grids::SMALL_GRIDS;
use super::msgpack::zlib;
use super::nerfacto::nerfacto;
use super::ngp::small_ngp;
use super::targets::{self, TARGETS, Target};
use super::voxels::Voxels;
use super::{Random, chunks, fixture, root};
use mipvog::base::bytes::SourceFile;
use mipvog::container::json::to_canonical;
use mipvog::model::baked::Metadata;
use mipvog_inputs::tensor::Archive;

/// Bytes that any input may make the reader hold beyond its own length, under the targets' limits.
pub const MAX_MEMORY: usize = 256 << 20;
/// Longer files are no seeds: mutants of them would mostly be hashed and copied.
const LONGEST_SEED: u64 = 24 << 10;

/// Any input is handled in this time, though a machine of tests is busy.
const MAX_TIME: Duration = Duration::from_secs(20);
/// Settings of scenes in both syntaxes.
const SETTINGS: [&str; 2] = [
    r#"{"stepsize": 0.5, "near": 2, "far": 6.5, "background": [0, 0.5, 1], "color_threshold": 0}"#,
    "# trained with\nstepsize = 0.25\nnear = 2\nfar = 6e0\nbackground = 1\ncolor_threshold = 1e-4\n",
];

fn number(name: &str, default: u64) -> u64 {
    let text = std::env::var(name).ok();
    text.map_or(default, |text| text.parse().expect("a number"))
}

/// Files in a folder and those below it, in a fixed order.
fn files(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    paths
        .into_iter()
        .flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] })
        .collect()
}

/// Fixtures that a target's format has, or parts of them.
fn seeds(target: &str) -> Vec<Vec<u8>> {
    let extensions: &[&str] = match target {
        "zip" => &["tar", "npz", "zip", "pt"],
        "pickle" => &["tar"],
        "npy" => &["npz"],
        "safetensors" => &["safetensors"],
        "grids" | "models" | "snapshot" | "snerg" | "merf" => &[],
        "container" | "render" | "repack" => &["mipvog"],
        "gltf" => &["gltf", "glb"],
        "vdb" => &["vdb", "nvdb"],
        "cameras" => &["json"],
        "settings" => &["json", "toml"],
        _ => &["png"],
    };
    let folders = [fixture(""), root().join("docs/pictures")];
    let fits = |path: &PathBuf| {
        let known = path.extension().is_some_and(|e| extensions.iter().any(|known| e == *known));
        known && path.metadata().is_ok_and(|metadata| metadata.len() <= LONGEST_SEED)
    };
    let mut seeds: Vec<Vec<u8>> = folders
        .iter()
        .flat_map(|folder| files(folder))
        .filter(fits)
        .flat_map(|path| match target {
            "pickle" => entries(&path, "data.pkl"),
            "npy" => entries(&path, ".npy"),
            _ => vec![std::fs::read(path).expect("a fixture")],
        })
        .collect();
    if target == "grids" {
        seeds.extend(SMALL_GRIDS.map(|grid| grid().to_bytes()));
        seeds.push(Voxels::small().ply());
    }
    if target == "models" {
        seeds.extend(SMALL_MODELS.map(|model| model().to_seed()));
        seeds.extend([false, true].map(|by_tcnn| nerfacto(by_tcnn).to_seed()));
        seeds.push(Voxels::small().checkpoint().to_seed());
    }
    if target == "snapshot" {
        let model = small_ngp(1.4, false, 8, 1);
        seeds.push(model.snapshot(Some(1.4), true).bytes());
        seeds.push(zlib(&small_ngp(8.0, false, 8, 1).snapshot(None, false).bytes()));
    }
    if ["snerg", "merf"].contains(&target) {
        let files = if target == "snerg" { targets::snerg_files() } else { targets::merf_files() };
        let files = files.into_iter().zip(0u8..);
        seeds.extend(files.map(|((_, bytes), number)| [vec![number], bytes].concat()));
    }
    if target == "settings" {
        seeds.extend(SETTINGS.map(|text| text.as_bytes().to_vec()));
    }
    seeds.push(Vec::new());
    seeds
}

/// Entries of a zip file whose names end so; none where it is broken.
fn entries(path: &Path, end: &str) -> Vec<Vec<u8>> {
    let file = Arc::new(SourceFile::open(path).expect("a fixture"));
    let Ok(archive) = Archive::open(&file, &targets::limits()) else { return Vec::new() };
    let numbers = (0..archive.entries().len())
        .filter(|&number| archive.entries()[number].name.ends_with(end));
    numbers.filter_map(|number| archive.read(number, LONGEST_SEED).ok()).collect()
}

/// Tokens of a dictionary of libFuzzer.
fn tokens(name: &str) -> Vec<Vec<u8>> {
    let path = root().join("fuzz/dictionaries").join(name).with_extension("dict");
    let text = std::fs::read_to_string(path).expect("a dictionary");
    let lines = text.lines().filter(|line| line.starts_with('"'));
    lines.map(|line| unescaped(&line[1..line.len() - 1])).collect()
}

fn unescaped(text: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        let escaped = if byte == b'\\' { rest.next() } else { None };
        bytes.push(match escaped {
            None => byte,
            Some(b'x') => {
                let digits = [rest.next(), rest.next()].map(|digit| digit.expect("two digits"));
                let digits = std::str::from_utf8(&digits).expect("ASCII").to_owned();
                u8::from_str_radix(&digits, 16).expect("hexadecimal")
            }
            Some(other) => other,
        });
    }
    bytes
}

/// Changes bytes the way that fuzzers do.
fn mutate(random: &mut Random, bytes: &mut Vec<u8>, seeds: &[Vec<u8>], tokens: &[Vec<u8>]) {
    let at = random.below(bytes.len() + 1);
    let most = 1 << random.below(8);
    let length = 1 + random.below(most);
    let range = at..(at + length).min(bytes.len());
    match random.below(9) {
        0 => bytes.truncate(at),
        1 => drop(bytes.drain(range)),
        2 => {
            let copy = bytes[range].to_vec();
            let to = random.below(bytes.len() + 1);
            bytes.splice(to..to, copy);
        }
        3 => {
            let token = tokens[random.below(tokens.len())].clone();
            let over = if random.below(2) == 0 { token.len() } else { 0 };
            bytes.splice(at..(at + over).min(bytes.len()), token);
        }
        4 => {
            let other = &seeds[random.below(seeds.len())];
            let from = random.below(other.len() + 1);
            let part = &other[from..(from + length).min(other.len())];
            bytes.splice(at..(at + part.len()).min(bytes.len()), part.iter().copied());
        }
        5 => {
            // Numbers at edges, of any width.
            let edge = [0, 1, 0x7f, 0x80, 0xffff, 0x7fff_ffff, 1 << 31, u64::MAX >> 1, u64::MAX];
            let value = edge[random.below(edge.len())].wrapping_add(random.below(3) as u64);
            let width = 1 << random.below(4);
            let value = &value.to_le_bytes()[..width.min(bytes.len() - at)];
            bytes[at..at + value.len()].copy_from_slice(value);
        }
        6 => bytes[range].iter_mut().for_each(|byte| *byte = random.bits() as u8),
        _ => {
            if let Some(byte) = bytes.get_mut(at) {
                *byte ^= 1 << random.below(8);
            }
        }
    }
}

/// Runs a target and keeps its failing inputs.
fn run((name, target): Target, bytes: &[u8]) {
    let clock = Instant::now();
    let (held, outcome) = measured(|| catch_unwind(|| target(bytes)));
    let took = clock.elapsed();
    if outcome.is_err() || held > MAX_MEMORY + bytes.len() || took > MAX_TIME {
        let path =
            root().join("target/fuzz").join(format!("{name}-{:08x}", crc32fast::hash(bytes)));
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("writable");
        std::fs::write(&path, bytes).expect("writable");
        panic!("{name} fails on {} (it held {held} bytes and took {took:?})", path.display());
    }
}

/// Files that ask for as much as they can, under the limits that users have.
pub fn hostile_files() -> Vec<(PathBuf, Vec<u8>)> {
    let mut hostile: Vec<(PathBuf, Vec<u8>)> = files(&fixture("trained/hostile"))
        .into_iter()
        .map(|path| (path.clone(), std::fs::read(path).expect("a fixture")))
        .collect();
    // A table of as many blocks as may be, and of one too many along each axis, in a few bytes.
    let sound = std::fs::read(fixture("broken/sound.mipvog")).expect("a container");
    for side in [406, 407] {
        let mut parts = chunks::chunks(&sound);
        for chunk in parts.iter_mut().filter(|chunk| chunk.level.is_none_or(|level| level == 0)) {
            match &chunk.kind {
                b"META" => {
                    let mut metadata: Metadata =
                        serde_json::from_slice(&chunk.bytes).expect("metadata");
                    metadata.levels[0].dimensions = [side; 3];
                    metadata.levels[0].block_size = 1;
                    chunk.bytes = to_canonical(&metadata).expect("JSON").into_bytes();
                }
                b"TABL" => {
                    let table = vec![0; side * side * side];
                    chunk.bytes = zstd::bulk::compress(&table, 1).expect("compresses");
                }
                _ => {}
            }
        }
        hostile
            .push((format!("a table of {side} blocks a side").into(), chunks::container(&parts)));
    }
    hostile
}

/// Runs a target on all that once failed, on its seeds, and on so many mutants of them.
///
/// # Panics
///
/// It panics, hangs, or takes too much.
pub fn stands_mutants(name: &str, runs: u64, seed: u64) {
    let target = TARGETS.into_iter().find(|target| target.0 == name).expect("a target");
    for path in files(&root().join("fuzz/found").join(name)) {
        run(target, &std::fs::read(path).expect("a file"));
    }
    let seeds = seeds(name);
    assert!(seeds.len() > 1, "no seeds for {name}");
    if let Some(corpus) = std::env::var_os("MIPVOG_FUZZ_CORPUS") {
        let folder = Path::new(&corpus).join(name);
        std::fs::create_dir_all(&folder).expect("writable");
        for seed in &seeds {
            let path = folder.join(format!("{:08x}", crc32fast::hash(seed)));
            std::fs::write(path, seed).expect("writable");
        }
    }
    let tokens = match name {
        "zip" | "pickle" | "npy" | "models" => tokens("pickle"),
        "safetensors" | "grids" | "gltf" | "cameras" | "settings" | "snerg" | "merf" => {
            tokens("json")
        }
        _ => tokens("container"),
    };
    seeds.iter().for_each(|seed| run(target, seed));
    let mut random = Random::new(number("MIPVOG_FUZZ_SEED", seed));
    for _ in 0..number("MIPVOG_FUZZ_RUNS", runs) {
        let mut bytes = seeds[random.below(seeds.len())].clone();
        for _ in 0..1 + random.below(6) {
            mutate(&mut random, &mut bytes, &seeds, &tokens);
        }
        run(target, &bytes);
    }
}

/// A test of each target, in a process of its own: so many mutants, of this seed.
#[macro_export]
macro_rules! tests_of_targets {
    ($runs:expr, $seed:expr; $($target:ident)*) => {
        $(#[test]
        fn $target() {
            if $crate::alone::is_alone(module_path!(), stringify!($target)) {
                $crate::fuzz::stands_mutants(stringify!($target), $runs, $seed);
            }
        })*

        #[test]
        fn every_target_has_its_test() {
            let tested = [$(stringify!($target)),*];
            assert_eq!(tested, $crate::targets::TARGETS.map(|target| target.0));
        }
    };
    ($runs:expr, $seed:expr) => {
        $crate::tests_of_targets! { $runs, $seed;
            zip pickle npy safetensors grids models snapshot snerg merf vdb container render repack
            gltf cameras settings png
        }
    };
}
