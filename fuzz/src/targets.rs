//! Fuzz targets: every parser of bytes that strangers write, each as a function that must return.
//!
//! A target takes any bytes. Checksums would stop nearly every mutation at once; a target mends
//! them or puts the bytes at a place that only checks meaning. Errors and readings are both fine;
//! panics, hangs and memory beyond [`limits`] are not. `tests/support/src/fuzz.rs` runs the same
//! functions with a plain mutator.

use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::archive::archive;
use mipvog::bake::{Changes, repack as pack_again};
use mipvog::base::bytes::{SourceFile, WriterSink};
use mipvog::base::error::ErrorKind;
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::container::Container;
use mipvog::model::camera;
use mipvog::picture;
use mipvog::unpacked::Unpacked;
use mipvog::view::render::Renderer;
use mipvog_bake::check::{CheckOptions, check_file};
use mipvog_inputs::SourceOptions;
use mipvog_inputs::tensor;
use mipvog_inputs::{SceneSettings, inspect_tensors, open_tensors};

/// A target by its name.
pub type Target = (&'static str, fn(&[u8]));

/// All of them.
pub const TARGETS: [Target; 17] = [
    ("zip", zip),
    ("pickle", pickle),
    ("npy", npy),
    ("safetensors", safetensors),
    ("grids", grids),
    ("models", models),
    ("snapshot", snapshot),
    ("snerg", snerg),
    ("merf", merf),
    ("vdb", vdb),
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

/// Nodes along an axis at which models without nodes are sampled.
const SIDE: usize = 5;

/// Limits under which any input must be handled.
pub fn limits() -> Limits {
    Limits { memory: 64 << 20, header_bytes: 1 << 20, pickle_objects: 1 << 16, ..Limits::default() }
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
    model(&file(bytes.to_vec()));
}

/// The pickle and the storages of a checkpoint of TensoRF, DirectVoxGO, nerfacto or SVRaster, each
/// after its length in four bytes, in a sound zip file: shown by its own rules, and read as a bake
/// reads it.
pub fn models(bytes: &[u8]) {
    let mut rest = bytes;
    let mut parts = [&bytes[..0]; 3];
    for part in &mut parts {
        let Some((length, after)) = rest.split_first_chunk() else { break };
        let length = (u32::from_le_bytes(*length) as usize).min(after.len());
        (*part, rest) = after.split_at(length);
    }
    let [pickle, numbers, flags] = parts;
    model(&file(archive(&[
        ("archive/data.pkl", pickle),
        ("archive/data/0", numbers),
        ("archive/data/1", flags),
    ])));
}

/// A snapshot of Instant-NGP, likewise.
pub fn snapshot(bytes: &[u8]) {
    let (file, limits) = (file(bytes.to_vec()), limits());
    if let Ok(tensors) = tensor::open_file(&file, &limits) {
        inspect_tensors(&tensors, &SourceOptions::default(), &limits).ok();
    }
    let mut options = CheckOptions::default();
    options.source.resolution = Some(SIDE);
    check_file(Arc::clone(&file), &options, &limits).ok();
    model(&file);
}

/// A file of a small SNeRG folder whose others are sound: the first byte is its number in
/// [`snerg_files`]. Shown by the viewer's rules, and read as a bake reads it.
pub fn snerg(bytes: &[u8]) {
    changed_folder(bytes, &snerg_files());
}

/// The same of a small MERF folder, with [`merf_files`].
pub fn merf(bytes: &[u8]) {
    changed_folder(bytes, &merf_files());
}

/// A folder one of whose files has other bytes; the first file is the one to open.
fn changed_folder(bytes: &[u8], files: &[(String, Vec<u8>)]) {
    let [number, bytes @ ..] = bytes else { return };
    let folder = std::env::temp_dir().join(format!("mipvog-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&folder).ok();
    let changed = usize::from(*number) % files.len();
    for (at, (name, sound)) in files.iter().enumerate() {
        let content = if at == changed { bytes } else { &sound[..] };
        std::fs::write(folder.join(name), content).ok();
    }
    if let Ok(file) = SourceFile::open(&folder.join(&files[0].0)) {
        let file = Arc::new(file);
        model(&file);
        let mut options = CheckOptions::default();
        options.source.drop_background = true;
        check_file(file, &options, &limits()).ok();
    }
    std::fs::remove_dir_all(&folder).ok();
}

/// An OpenVDB file, as it is: all its trees and values, and read as a bake reads it.
pub fn vdb(bytes: &[u8]) {
    model(&file(bytes.to_vec()));
}

/// The parameters of a folder's network.
fn layers() -> String {
    let layer = |number: usize, inputs: usize, outputs: usize| {
        let row = format!("[{}]", vec!["0.25"; outputs].join(","));
        let rows = vec![row.as_str(); inputs].join(",");
        format!(r#","{number}_weights":[{rows}],"{number}_bias":{row}"#)
    };
    [layer(0, 34, 16), layer(1, 16, 16), layer(2, 16, 3)].concat()
}

/// A picture of red, green, blue and alpha.
fn rgba([width, height]: [usize; 2], seed: usize) -> Vec<u8> {
    let bytes: Vec<u8> = (0..4 * width * height).map(|at| ((at * seed) % 251) as u8).collect();
    picture::png(width, height, &bytes).unwrap_or_default()
}

/// The files of a MERF folder with planes of 4 texels, and a sparse grid of 4 voxels in blocks of 1.
pub fn merf_files() -> Vec<(String, Vec<u8>)> {
    let text = format!(
        r#"{{"triplane_resolution":4,"triplane_voxel_size":1,"sparse_grid_resolution":4,
"sparse_grid_voxel_size":1,"data_block_size":1,"atlas_width":4,"atlas_height":4,"atlas_depth":2,
"num_slices":2,"slice_depth":1,"range_features":[-7,7],"range_density":[-14,14]{}}}"#,
        layers()
    );
    let indices: Vec<u8> = (0..64)
        .flat_map(|at| [[at % 2, at / 2 % 2, 0], [255; 3]][usize::from(at % 5 == 4)])
        .collect();
    let mut files = vec![
        ("scene_params.json".to_owned(), text.into_bytes()),
        (
            "sparse_grid_block_indices.png".to_owned(),
            picture::png(4, 16, &indices).unwrap_or_default(),
        ),
    ];
    for cell in [8, 16, 32, 64, 128] {
        files.push((format!("occupancy_grid_{cell}.png"), rgba([1, 1], 3)));
    }
    for at in 0..3 {
        files.push((format!("plane_rgb_and_density_{at}.png"), rgba([4, 4], 7 + at)));
        files.push((format!("plane_features_{at}.png"), rgba([4, 4], 11 + at)));
    }
    for z in 0..2 {
        files.push((format!("sparse_grid_rgb_and_density_{z:03}.png"), rgba([4, 4], 13 + z)));
        files.push((format!("sparse_grid_features_{z:03}.png"), rgba([4, 4], 17 + z)));
    }
    files
}

/// The files of a SNeRG folder of one block.
pub fn snerg_files() -> Vec<(String, Vec<u8>)> {
    let text = format!(
        r#"{{"voxel_size":0.1,"block_size":6,"grid_width":6,"grid_height":5,"grid_depth":4,
"atlas_width":8,"atlas_height":8,"atlas_depth":8,"num_slices":2,"min_x":-1,"min_y":0,"min_z":1,
"worldspace_T_opengl":[[-1,0,0,0],[0,0,1,0],[0,1,0,0],[0,0,0,1]],"ndc":false,"format":"png"{}}}"#,
        layers()
    );
    let slice = |seed: usize| rgba([8, 32], seed);
    let files = [
        ("scene_params.json", text.into_bytes()),
        ("atlas_indices.png", picture::png(1, 1, &[0, 0, 0]).unwrap_or_default()),
        ("rgba_000.png", slice(7)),
        ("rgba_001.png", slice(11)),
        ("feature_000.png", slice(13)),
        ("feature_001.png", slice(17)),
    ];
    files.map(|(name, bytes)| (name.to_owned(), bytes)).into()
}

/// A model that is shown by its own rules and read as a bake reads it.
fn model(file: &Arc<SourceFile>) {
    let limits = limits();
    let Ok(tensors) = tensor::open_file(file, &limits) else { return };
    let mut options = SourceOptions { drop_background: true, ..SourceOptions::default() };
    let Ok(mut source) = open_tensors(&tensors, &options, &limits) else { return };
    if source.family.is_sampled() {
        options.resolution = Some(SIDE);
        match open_tensors(&tensors, &options, &limits) {
            Ok(smaller) => source = smaller,
            Err(_) => return,
        }
    }
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
    let Ok(renderer) = source.renderer(None, &limits) else { return };
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
