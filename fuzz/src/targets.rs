//! Fuzz targets: every parser of bytes that strangers write, each as a function that must return.
//!
//! A target takes any bytes. Checksums would stop nearly every mutation at once; a target mends
//! them or puts the bytes at a place that only checks meaning. Errors and readings are both fine;
//! panics, hangs and memory beyond [`limits`] are not. `tests/fuzz.rs` runs the same functions with
//! a plain mutator.

use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::archive::archive;
use mipvog_bake::unstable::app::check::{CheckOptions, check_file};
use mipvog_bake::unstable::bake::{Changes, repack as pack_again};
use mipvog_bake::unstable::base::bytes::{SourceFile, WriterSink};
use mipvog_bake::unstable::base::error::ErrorKind;
use mipvog_bake::unstable::base::limits::Limits;
use mipvog_bake::unstable::base::picture;
use mipvog_bake::unstable::base::progress::Silent;
use mipvog_bake::unstable::codec::container::Container;
use mipvog_bake::unstable::codec::unpack::Unpacked;
use mipvog_bake::unstable::input::SourceOptions;
use mipvog_bake::unstable::input::tensor;
use mipvog_bake::unstable::input::{SceneSettings, inspect_tensors, open_tensors};
use mipvog_bake::unstable::model::camera;
use mipvog_bake::unstable::view::render::Renderer;

/// A target by its name.
pub type Target = (&'static str, fn(&[u8]));

/// All of them.
pub const TARGETS: [Target; 13] = [
    ("zip", zip),
    ("pickle", pickle),
    ("npy", npy),
    ("safetensors", safetensors),
    ("grids", grids),
    ("models", models),
    ("container", container),
    ("render", render),
    ("repack", repack),
    ("gltf", gltf),
    ("cameras", cameras),
    ("settings", settings),
    ("png", png),
];

/// Nothing lies here, so that no name in a file leads anywhere.
const NOWHERE: &str = "/nonexistent/folder/file";

/// Limits under which any input must be handled.
pub fn limits() -> Limits {
    let mut limits = Limits::default();
    limits.memory = 64 << 20;
    limits.header_bytes = 1 << 20;
    limits.pickle_objects = 1 << 16;
    limits
}

fn file(bytes: Vec<u8>) -> Arc<SourceFile> {
    Arc::new(SourceFile::decoded(bytes, Path::new(NOWHERE)))
}

/// A zip file of a checkpoint or arrays, as it is.
pub fn zip(bytes: &[u8]) {
    tensors(bytes.to_vec());
}

/// The bytes are the pickle of a checkpoint whose zip file is sound.
pub fn pickle(bytes: &[u8]) {
    tensors(archive(&[("archive/data.pkl", bytes), ("archive/data/0", &[0x3f; 256])]));
}

/// The bytes are the density array of a sound npz file.
pub fn npy(bytes: &[u8]) {
    tensors(archive(&[("density.npy", bytes), ("k0.npy", bytes)]));
}

/// A safetensors file, as it is.
pub fn safetensors(bytes: &[u8]) {
    tensors(bytes.to_vec());
}

/// A safetensors file of Plenoxels, of a PlenOctree or of sampled arrays: shown by its own rules,
/// and read as a bake reads it.
pub fn grids(bytes: &[u8]) {
    shown(bytes.to_vec());
}

/// The pickle and the storages of a checkpoint of TensoRF or DirectVoxGO, each after its length in
/// four bytes, in a sound zip file: shown by its own rules, and read as a bake reads it.
pub fn models(bytes: &[u8]) {
    let mut rest = bytes;
    let mut parts = [&bytes[..0]; 3];
    for part in &mut parts {
        let Some((length, after)) = rest.split_first_chunk() else { break };
        let length = (u32::from_le_bytes(*length) as usize).min(after.len());
        (*part, rest) = after.split_at(length);
    }
    let [pickle, numbers, flags] = parts;
    shown(archive(&[
        ("archive/data.pkl", pickle),
        ("archive/data/0", numbers),
        ("archive/data/1", flags),
    ]));
}

fn shown(bytes: Vec<u8>) {
    let (file, limits) = (file(bytes), limits());
    let Ok(tensors) = tensor::open_file(&file, &limits) else { return };
    let options = SourceOptions { drop_background: true, ..SourceOptions::default() };
    let Ok(source) = open_tensors(&tensors, &options, &limits) else { return };
    let nodes = source.field.scene.nodes;
    // Grids that a file states in a few bytes may be large; a bake of them takes its time.
    if nodes.count() > 1 << 15 {
        return;
    }
    let mut plane = vec![0.0; nodes.0[1] * nodes.0[2]];
    for grid in source.field.grids() {
        for x in 0..nodes.0[0] {
            for channel in 0..grid.channels() {
                grid.read_plane(channel, x, &mut plane, |_| {}).ok();
            }
        }
    }
    let Ok(renderer) = Renderer::of_source(&source, None, &limits) else { return };
    for camera in camera::turntable(&source.field.scene.bounds, 2, [2, 2]) {
        renderer.picture(&camera).ok();
    }
}

fn tensors(bytes: Vec<u8>) {
    let (file, limits) = (file(bytes), limits());
    if let Ok(tensors) = tensor::open_file(&file, &limits) {
        inspect_tensors(&tensors, &SourceOptions::default(), &limits).ok();
    }
    check_file(file, &CheckOptions::default(), &limits).ok();
}

/// A container around whose numbers all checksums are mended.
pub fn container(bytes: &[u8]) {
    let mut bytes = bytes.to_vec();
    mend_checksums(&mut bytes);
    let (file, limits) = (file(bytes), limits());
    let strict = Container::open(Arc::clone(&file), &limits).and_then(|container| container.read());
    let report = check_file(file, &CheckOptions::default(), &limits);
    // A file that strict readers take has no finding. A file without findings is taken, as long as
    // all of it fits in memory at once.
    let valid = report.is_ok_and(|report| report.valid);
    let fits =
        !matches!(&strict, Err(error) if matches!(error.kind(), ErrorKind::OverLimit { .. }));
    assert!(strict.is_ok() == valid || !fits, "{:?}", strict.err());
}

/// A container, as [`container`] mends it, shown by a few rays and read at a few places.
pub fn render(bytes: &[u8]) {
    let Some(container) = opened(bytes) else { return };
    let Ok(renderer) = Renderer::of_container(&container) else { return };
    let bounds = renderer.view().bounds;
    for camera in camera::turntable(&bounds, 2, [2, 2]) {
        renderer.picture(&camera).ok();
    }
    for level in 0..=renderer.levels() {
        for corner in [bounds.min, bounds.max] {
            renderer.sample(corner.map(Into::into), level).ok();
        }
    }
}

/// A container, as [`container`] mends it, unpacked and packed again: as it is, and with other
/// bits. The result must be valid.
pub fn repack(bytes: &[u8]) {
    let Some(container) = opened(bytes) else { return };
    let Ok(unpacked) = Unpacked::of_container(&container) else { return };
    let coarser = Changes { max_error: "0.1".parse().ok(), ..Changes::default() };
    for changes in [Changes::default(), coarser] {
        let mut packed = Vec::new();
        let mut sink = WriterSink::new(&mut packed);
        if pack_again(&unpacked, &changes, &limits(), &mut sink, &Silent).is_err() {
            continue;
        }
        let read = Container::from_bytes(packed, &limits()).and_then(|container| container.read());
        assert!(read.is_ok(), "{:?}", read.err());
    }
}

fn opened(bytes: &[u8]) -> Option<Container> {
    let mut bytes = bytes.to_vec();
    mend_checksums(&mut bytes);
    Container::open(file(bytes), &limits()).ok()
}

/// Settings of a scene, in both syntaxes.
pub fn settings(bytes: &[u8]) {
    for name in ["scene.json", "scene.toml"] {
        SceneSettings::parse(bytes, Path::new(name)).ok();
    }
}

/// A glTF asset, text or binary.
pub fn gltf(bytes: &[u8]) {
    check_file(file(bytes.to_vec()), &CheckOptions::default(), &limits()).ok();
}

/// A camera file.
pub fn cameras(bytes: &[u8]) {
    if let Ok(text) = std::str::from_utf8(bytes) {
        camera::parse(text, PathBuf::from(NOWHERE), None).ok();
        camera::parse(text, PathBuf::from(NOWHERE), Some([3, 2])).ok();
    }
}

/// A picture to compare with.
pub fn png(bytes: &[u8]) {
    picture::decode(Cursor::new(bytes), Path::new(NOWHERE), limits().memory).ok();
}

/// Writes the checksums that a forger would: of each chunk where the directory says it is, then of
/// header and directory.
fn mend_checksums(bytes: &mut [u8]) {
    let number = |bytes: &[u8], at: usize, width: usize| -> Option<usize> {
        let mut wide = [0; 8];
        wide[..width].copy_from_slice(bytes.get(at..at + width)?);
        Some(u64::from_le_bytes(wide) as usize)
    };
    let Some(count) = number(bytes, 40, 4) else { return };
    for entry in (0..count.min(4096)).map(|i| 64 + 64 * i) {
        let (offset, length) = (number(bytes, entry + 8, 8), number(bytes, entry + 16, 8));
        let (Some(offset), Some(length)) = (offset, length) else { break };
        let Some(chunk) = bytes.get(offset..offset.saturating_add(length)) else { continue };
        let sum = crc32fast::hash(chunk).to_le_bytes();
        if let Some(stated) = bytes.get_mut(entry + 32..entry + 36) {
            stated.copy_from_slice(&sum);
        }
    }
    if let Some(stated) = bytes.get_mut(48..52) {
        stated.fill(0);
        let Some(head) = bytes.get(..count.saturating_mul(64).saturating_add(64)) else { return };
        let sum = crc32fast::hash(head).to_le_bytes();
        bytes[48..52].copy_from_slice(&sum);
    }
}
