//! What tests and benchmarks share: fixtures, random fields, plain reference code in float64.

pub mod alone;
#[path = "../../../fuzz/src/archive.rs"]
pub mod archive;
pub mod asset;
pub mod boxes;
pub mod broken;
pub mod checkpoint;
pub mod chunks;
pub mod factored;
pub mod factored_values;
pub mod families;
pub mod fuzz;
pub mod grids;
pub mod harmonic_field;
pub mod merf;
pub mod model_lies;
pub mod models;
pub mod msgpack;
pub mod nerfacto;
pub mod ngp;
pub mod others;
pub mod pages;
pub mod plain;
pub mod plain_alpha;
pub mod plain_nested;
pub mod plain_render;
pub mod plain_shade;
pub mod planes;
pub mod rendered;
pub mod schema;
pub mod snerg;
pub mod stress;
pub mod stress_field;
pub mod stress_quantize;
pub mod stress_ray;
pub mod stress_scalar;
#[path = "../../../fuzz/src/targets.rs"]
pub mod targets;
pub mod torch;
pub mod transcoded;
pub mod voxels;
pub mod world;

pub use schema::{Schema, assert_follows, assert_schema};

use std::path::{Path, PathBuf};
use std::sync::Arc;

use mipvog::bake::{BakeOptions, Changes, Origin, bake, repack};
use mipvog::base::bytes::{Output, Storage, WriterSink};
use mipvog::base::error::Result;
use mipvog::base::limits::{Budget, Limits};
use mipvog::base::progress::Silent;
use mipvog::container::Container;
use mipvog::model::baked::Group;
use mipvog::model::field::{
    Activation, ColorDomain, FreeSpace, Grid, March, RadianceField, Scene, Volume,
};
use mipvog::model::grid::{Bounds, Element, Nodes};
use mipvog_inputs::SourceOptions;
use mipvog_inputs::open_with;
use mipvog_inputs::tensor::{self, TensorFile, Value};
use mipvog_outputs::unpack::{TensorFormat, write_tensors};

/// Sends a signal such as `-INT` to a program that runs. By the shell's own `kill`: a fresh Debian
/// has no program of that name.
#[cfg(unix)]
pub fn send(signal: &str, id: u32) {
    let kill = ["-c", "kill \"$0\" \"$1\"", signal, &id.to_string()].map(ToOwned::to_owned);
    let sent = std::process::Command::new("sh").args(kill).status();
    assert!(sent.expect("a shell").success());
}

/// The repository.
pub fn root() -> &'static Path {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    own.ancestors().nth(2).expect("tests/support lies two folders below it")
}

/// A file under `fixtures/`.
pub fn fixture(name: &str) -> PathBuf {
    root().join("fixtures").join(name)
}

/// A trained scene, as a bake without options takes it.
pub fn trained(name: &str) -> RadianceField {
    let path = fixture("trained").join(name);
    open_with(&path, &SourceOptions::default(), &Limits::default()).expect("a checkpoint").field
}

/// Numbers that a seed names: xorshift, no period that a test could reach.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    pub fn bits(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    pub fn below(&mut self, end: usize) -> usize {
        (self.bits() >> 33) as usize % end
    }

    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * (self.bits() >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// A field in memory: density `[x][y][z]`, colour `[channel][x][y][z]`.
pub fn field(nodes: [usize; 3], density: &[f32], color: &[f32]) -> RadianceField {
    let count: usize = nodes.iter().product();
    let bytes = |values: &[f32]| -> Arc<[u8]> {
        values.iter().flat_map(|value| value.to_le_bytes()).collect()
    };
    let volume = |values: &[f32]| Volume {
        nodes: Nodes(nodes),
        channels: values.len() / count,
        element: Element::F32,
        storage: Storage::Memory(bytes(values)),
        first: 0,
        strides: [count, nodes[1] * nodes[2], nodes[2]].map(|stride| stride as u64),
    };
    let scene = Scene {
        bounds: Bounds { min: [-1.0, -0.5, 0.0], max: [1.0, 0.75, 3.0] },
        nodes: Nodes(nodes),
        activation: Activation::logits(-4.595_12, 0.5),
        march: March {
            stepsize: 0.5,
            voxel_size: 0.1,
            near: 0.0,
            far: None,
            color_threshold: 1e-4,
            alpha_threshold: 0.0,
            sampled: None,
            voxel: None,
        },
        background: [1.0; 3],
    };
    RadianceField {
        scene,
        density: volume(density).into(),
        color: vec![volume(color).into()],
        color_domain: ColorDomain::Logit,
        view: None,
        free_space: None,
        shells: Vec::new(),
    }
}

/// A random field: a smooth body in empty space, `share` of it opaque, and `channels` of colour.
pub fn random_field(random: &mut Random, nodes: [usize; 3], channels: usize) -> RadianceField {
    let count: usize = nodes.iter().product();
    let center = nodes.map(|size| random.between(0.0, size as f32));
    let radius = random.between(0.5, 6.0);
    let mut density = Vec::with_capacity(count);
    for x in 0..nodes[0] {
        for y in 0..nodes[1] {
            for z in 0..nodes[2] {
                let at = [x as f32, y as f32, z as f32];
                let distance: f32 = (0..3).map(|axis| (at[axis] - center[axis]).powi(2)).sum();
                let inside = distance.sqrt() < radius;
                let raw = if inside { random.between(-3.0, 25.0) } else { -100.0 };
                density.push(if random.below(20) == 0 { random.between(-9.0, 1.0) } else { raw });
            }
        }
    }
    let color: Vec<f32> = (0..channels * count).map(|_| random.between(-9.0, 9.0)).collect();
    field(nodes, &density, &color)
}

/// The same field behind a free-space mask.
pub fn masked(mut field: RadianceField, free_space: FreeSpace) -> RadianceField {
    field.free_space = Some(free_space);
    field
}

/// The origin of a test's field.
pub fn origin() -> Origin {
    Origin {
        kind: "test".to_owned(),
        digest: [7; 32],
        covers_values: true,
        side_files: Vec::new(),
        assumptions: Vec::new(),
    }
}

/// A program, with nothing in its environment but wide lines and where `.ci/coverage` counts.
pub fn program(path: &str) -> std::process::Command {
    let mut command = std::process::Command::new(path);
    command.env_clear();
    // Lines of reports stay whole, so that tests find words in them.
    command.env("COLUMNS", "1000");
    let counts = "LLVM_PROFILE_FILE";
    command.envs(std::env::var_os(counts).map(|file| (counts, file)));
    command
}

/// Runs `work` with this many threads.
pub fn with_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    mipvog::base::parallel::with_threads(threads, work).expect("threads")
}

/// A temporary folder that goes with the value. It lies beside the build: a machine's own place for
/// temporary files may be small.
pub fn folder() -> tempfile::TempDir {
    let own = std::env::current_exe().expect("a program");
    let target = own.ancestors().nth(3).expect("it lies in target/PROFILE/deps");
    let here = target.join("tmp");
    std::fs::create_dir_all(&here).expect("writable");
    tempfile::tempdir_in(here).expect("a temporary folder")
}

/// Bakes to bytes.
pub fn baked_bytes(field: &RadianceField, options: &BakeOptions) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    bake(field, options, &origin(), &mut WriterSink::new(&mut bytes), &Silent)?;
    Ok(bytes)
}

/// Opens a container from bytes.
pub fn open_bytes(bytes: &[u8]) -> Result<Container> {
    Container::from_bytes(bytes.to_vec(), &Limits::default())
}

/// A container's dense arrays.
pub struct Unpacked {
    file: TensorFile,
    _written: Output,
    _folder: tempfile::TempDir,
}

/// Unpacks a container.
pub fn unpack(container: &Container) -> Result<Unpacked> {
    let folder = folder();
    let path = folder.path().join("unpacked.safetensors");
    let mut output = Output::create(&path, false)?;
    write_tensors(container, &[], TensorFormat::Safetensors, &mut output, &Silent)?;
    // Nothing needs its name, and no test the wait for the disk.
    let file = tensor::open(output.written(), &Limits::default())?;
    Ok(Unpacked { file, _written: output, _folder: folder })
}

/// Bakes an unpacked container again.
pub fn packed(input: &mipvog::unpacked::Unpacked, changes: &Changes) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    repack(input, changes, &Limits::default(), &mut WriterSink::new(&mut bytes), &Silent)?;
    Ok(bytes)
}

impl Unpacked {
    /// The open safetensors file.
    pub fn file(&self) -> &TensorFile {
        &self.file
    }

    /// Values of a tensor; none if there is no such tensor.
    pub fn get(&self, name: &str) -> Option<Vec<f32>> {
        tensor_values(&self.file, name)
    }

    /// One group of one level.
    pub fn level(&self, level: usize, group: Group) -> Vec<f32> {
        self.get(&format!("level{level}.{}", group.name())).expect("the level has this group")
    }

    /// True for each node that lies in a block with a frame.
    pub fn occupied(&self, level: usize, nodes: [usize; 3], edge: usize) -> Vec<bool> {
        let blocks = self.get(&format!("level{level}.occupied")).expect("a table");
        let counts = nodes.map(|size| size.div_ceil(edge));
        plain::all_nodes(nodes)
            .map(|[x, y, z]| {
                blocks[((x / edge) * counts[1] + y / edge) * counts[2] + z / edge] > 0.0
            })
            .collect()
    }
}

/// Values of a tensor of an open file.
pub fn tensor_values(file: &TensorFile, name: &str) -> Option<Vec<f32>> {
    let tensor = file.root.get(name).and_then(Value::tensor)?;
    Some(tensor.read_f32(&mut Budget::new(&Limits::default())).expect("readable"))
}

/// All values of a grid, `[channel][x][y][z]`.
pub fn grid_values(grid: &Grid) -> Vec<f32> {
    let [nx, ny, nz] = grid.nodes().0;
    let (mut all, mut plane) = (Vec::new(), vec![0.0; ny * nz]);
    for channel in 0..grid.channels() {
        for x in 0..nx {
            grid.read_plane(channel, x, &mut plane, |_| {}).expect("a plane");
            all.extend_from_slice(&plane);
        }
    }
    all
}

/// Holds bytes to a golden file, or rewrites it where the environment variable BLESS is set.
pub fn assert_golden(path: &Path, got: &[u8]) {
    if std::env::var_os("BLESS").is_some() {
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("writable");
        std::fs::write(path, got).expect("golden is writable");
        return;
    }
    let want = std::fs::read(path).unwrap_or_default();
    let first = want.iter().zip(got).position(|(a, b)| a != b);
    let (wanted, found) = (want.len(), got.len());
    assert!(want == got, "{}: differs at {first:?}, {found} for {wanted} bytes", path.display());
}

/// Writes the checksums that a forger would: of each chunk where the directory says it is, then of
/// header and directory.
pub fn mend_checksums(bytes: &mut [u8]) {
    let number = |bytes: &[u8], at: usize| -> Option<usize> {
        Some(u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?) as usize)
    };
    let count = u32::from_le_bytes(bytes[40..44].try_into().expect("four bytes")) as usize;
    for entry in (0..count.min(100)).map(|i| 64 + 64 * i) {
        let (Some(offset), Some(length)) = (number(bytes, entry + 8), number(bytes, entry + 16))
        else {
            return;
        };
        let Some(chunk) = bytes.get(offset..offset.saturating_add(length)) else { return };
        let sum = crc32fast::hash(chunk).to_le_bytes();
        bytes[entry + 32..entry + 36].copy_from_slice(&sum);
    }
    bytes[48..52].fill(0);
    let Some(head) = bytes.get(..64 + 64 * count) else { return };
    let sum = crc32fast::hash(head).to_le_bytes();
    bytes[48..52].copy_from_slice(&sum);
}
