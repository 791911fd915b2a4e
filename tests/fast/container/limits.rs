//! Every limit: a file that asks for as much is read, one that asks for one more is refused, with
//! that limit's name.

use std::path::Path;
use std::sync::Arc;

use crate::common::fixture;
use mipvog::base::bytes::SourceFile;
use mipvog::base::error::{ErrorKind, Result};
use mipvog::base::limits::{LimitName, Limits};
use mipvog::base::progress::Silent;
use mipvog::container::Container;
use mipvog::model::baked::Group;
use mipvog_inputs::SourceOptions;

fn read_scene(path: &Path, limits: &Limits) -> Result<()> {
    mipvog_inputs::open_with(path, &SourceOptions::default(), limits).map(|_| ())
}

/// Reads a volume's values.
fn read_volume(path: &Path, limits: &Limits) -> Result<()> {
    let source = mipvog_inputs::open_with(path, &SourceOptions::default(), limits)?;
    source.field.prepare(&Silent)?;
    let nodes = source.field.scene.nodes.0;
    let mut plane = vec![0.0; nodes[1] * nodes[2]];
    source.field.density.read_plane(0, nodes[0] / 2, &mut plane, |_| {})
}

fn read_container(path: &Path, limits: &Limits) -> Result<()> {
    let file = Arc::new(SourceFile::open(path)?);
    Container::open(file, limits)?.read().map(|_| ())
}

fn limit(name: &str) -> LimitName {
    LimitName::ALL.iter().copied().find(|limit| limit.name() == name).expect("a limit")
}

fn with(name: &str, count: u64) -> Limits {
    let mut limits = Limits::default();
    *limits.get_mut(limit(name)) = count;
    limits
}

/// The least value of a limit under which a file is read; one below, the limit is the error.
fn least(name: &str, path: &Path, read: fn(&Path, &Limits) -> Result<()>) -> u64 {
    let (mut refused, mut taken) = (0, 1 << 40);
    read(path, &with(name, taken)).expect("a sound file");
    while taken - refused > 1 {
        let middle = refused + (taken - refused) / 2;
        match read(path, &with(name, middle)) {
            Ok(()) => taken = middle,
            Err(_) => refused = middle,
        }
    }
    let error = read(path, &with(name, taken - 1)).expect_err("one past the limit");
    match error.kind() {
        // The limit that the error names is the one that helps.
        ErrorKind::OverLimit { limit: named, asked, allowed, .. } => {
            assert!(*named == Some(limit(name)) && asked > allowed, "{name}: {error}");
        }
        _ => panic!("{name}: {error}"),
    }
    taken
}

#[test]
fn limits_hold_at_their_value_and_one_past_it() {
    let torch = fixture("trained/dvgo/protocol2.tar");
    let flat = fixture("trained/dvgo/flat.safetensors");
    let container = fixture("baked/dvgo.mask.mipvog");
    let header = u64::from_le_bytes(
        std::fs::read(&flat).expect("a file")[..8].try_into().expect("eight bytes"),
    );
    // 9 x 7 x 5 nodes of 7 channels.
    assert_eq!(least("axis-nodes", &flat, read_scene), 9);
    assert_eq!(least("nodes", &flat, read_scene), 9 * 7 * 5);
    assert_eq!(least("channels", &flat, read_scene), 7);
    assert_eq!(least("header-bytes", &flat, read_scene), header);
    let entries = std::fs::read(&torch).expect("a file");
    let count = entries.windows(4).filter(|bytes| bytes == b"PK\x01\x02").count() as u64;
    assert_eq!(least("entries", &torch, read_scene), count);
    assert!(least("pickle-objects", &torch, read_scene) > count);
    let opened = Container::open(
        Arc::new(SourceFile::open(&container).expect("a file")),
        &Limits::default(),
    );
    let opened = opened.expect("a container");
    assert_eq!(least("chunks", &container, read_container), opened.entries().len() as u64);
    let levels = &opened.metadata().levels;
    let blocks = levels.iter().map(|level| level.grid().total()).max().expect("levels") as u64;
    assert_eq!(least("blocks", &container, read_container), blocks);
    let codes: u64 = levels.iter().map(|level| level.blocks_stored as u64 * 8 * 512).sum();
    // Codes of one byte of 8 channels in blocks of 8, and tables.
    assert!(least("memory", &container, read_container) >= codes);
    // Other files that have many of a thing. A bound on memory is met first where it is the less.
    let volume = fixture("vdb/full.vdb");
    // A node of the root, one of 16 a side, and a leaf, for each grid of the file.
    assert_eq!(least("blocks", &volume, read_volume), 13);
    assert!(least("memory", &volume, read_volume) > 512);
    assert!(least("channels", &container, read_container) > 0);
}

/// A container under a limit of memory.
fn opened(name: &str, memory: u64) -> Container {
    let file = SourceFile::open(&fixture("baked").join(name)).expect("a file");
    Container::open(Arc::new(file), &with("memory", memory)).expect("little is read")
}

/// The least memory under which something is read; a byte less is refused as too much.
fn least_memory(name: &str, read: impl Fn(&Container) -> Result<()>, expected: usize) {
    let expected = expected as u64;
    read(&opened(name, expected)).unwrap_or_else(|error| panic!("{name}: {error}"));
    let error = read(&opened(name, expected - 1)).expect_err("a byte too few");
    assert!(matches!(error.kind(), ErrorKind::OverLimit { .. }), "{name}: {error}");
}

#[test]
fn memory_is_counted_to_the_byte() {
    for name in ["dvgo.mask.mipvog", "dvgo.f32.mipvog", "dvgo.coverage.mipvog", "tiny.code.mipvog"]
    {
        let container = opened(name, 1 << 30);
        for (number, level) in container.metadata().levels.iter().enumerate() {
            let chunk = |kind: &[u8; 4]| {
                let mut entries = container.entries().iter();
                let found = entries.find(|e| e.kind == *kind && e.level == Some(number as u32));
                found.map_or(0, |entry| entry.length as usize)
            };
            // A table is inflated and then made of it. A chunk is held while it is decoded.
            let mut held = 2 * level.grid().total();
            let mut bytes = held + chunk(b"TABL");
            for (group, kind) in Group::ALL.into_iter().zip([b"DENS", b"DIFF", b"FEAT"]) {
                let Some(encoding) = level.encoding(group) else { continue };
                let channels = group.channels(container.metadata().layout());
                let frame = level.block_size.pow(3) * encoding.number.bytes() * channels;
                held += level.blocks_stored * frame;
                bytes = bytes.max(held + chunk(kind));
            }
            least_memory(name, |container| container.read_level(number).map(|_| ()), bytes);
        }
    }
}
