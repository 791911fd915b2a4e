//! Files that former versions wrote read to the same values for ever: `formats/compatibility.md`.
//! Nothing in `fixtures/frozen/` is ever written anew. A new folder there, with files that its
//! version wrote, gets the digests that this test prints.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::common::{chunks, fixture, mend_checksums, open_bytes, tensor_values, unpack};
use mipvog::base::bytes::SourceFile;
use mipvog::base::error::ErrorKind;
use mipvog::base::limits::Limits;
use mipvog::container::Container;
use mipvog::container::layout::META;
use mipvog_bake::check::check;
use mipvog_outputs::gltf::asset::{Asset, is_asset};
use serde_json::Value;
use sha2::{Digest, Sha256};

const DIGESTS: &str = "digests.txt";

/// Files in a folder, in a fixed order.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder").flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

/// The files of a version.
fn frozen(version: &Path) -> Vec<PathBuf> {
    let mut paths = entries(version);
    paths.retain(|path| !path.ends_with(DIGESTS));
    paths
}

/// The container that a file is, or the first one of an asset.
fn open(path: &Path) -> Container {
    let file = Arc::new(SourceFile::open(path).expect("a file"));
    let opened = match is_asset(&file) {
        true => Asset::open(file, &Limits::default()).and_then(|asset| asset.open_field(0)),
        false => Container::open(file, &Limits::default()),
    };
    opened.unwrap_or_else(|error| panic!("{error}"))
}

/// A line for each array of a container: SHA-256 of its values as little-endian f32, its shape, its
/// name.
fn digests(container: &Container, name: &str) -> String {
    let unpacked = unpack(container).expect("unpacks");
    let root = unpacked.file().root.entries();
    let mut lines: Vec<String> = root
        .iter()
        .filter_map(|(tensor, value)| {
            let shape = value.tensor()?.shape();
            let values = tensor_values(unpacked.file(), tensor)?;
            let mut sum = Sha256::new();
            values.iter().for_each(|value| sum.update(value.to_le_bytes()));
            let mut line = String::new();
            sum.finalize().iter().for_each(|byte| write!(line, "{byte:02x}").expect("text"));
            write!(line, " {name} {tensor} {shape:?}").expect("text");
            Some(line)
        })
        .collect();
    lines.sort_by(|a, b| a[64..].cmp(&b[64..]));
    lines.join("\n") + "\n"
}

#[test]
fn files_of_former_versions_decode_to_the_same_values() {
    let mut files = 0;
    for version in entries(&fixture("frozen")) {
        let mut found = String::new();
        for path in frozen(&version) {
            let report = check(&path, &Limits::default()).expect("readable");
            assert!(report.valid, "{}: {:?}", path.display(), report.findings);
            found += &digests(&open(&path), &path.file_name().expect("a name").to_string_lossy());
            files += 1;
        }
        let expected = std::fs::read_to_string(version.join(DIGESTS)).unwrap_or_default();
        let differs = expected.lines().zip(found.lines()).find(|(a, b)| a != b);
        assert!(expected == found, "{}: {differs:?}; all:\n{found}", version.display());
    }
    assert!(files >= 10, "only {files} files");
}

/// True if `new` says everything that `old` says; it may say more.
fn holds(new: &Value, old: &Value) -> bool {
    match (new, old) {
        (Value::Object(new), Value::Object(old)) => {
            old.iter().all(|(key, old)| new.get(key).is_some_and(|new| holds(new, old)))
        }
        (Value::Array(new), Value::Array(old)) => {
            new.len() == old.len() && new.iter().zip(old).all(|(new, old)| holds(new, old))
        }
        _ => new == old,
    }
}

#[test]
fn metadata_of_former_versions_means_the_same() {
    for path in entries(&fixture("frozen")).iter().flat_map(|version| frozen(version)) {
        let container = open(&path);
        let entry = container.entries().iter().find(|entry| entry.kind == META).expect("META");
        let bytes = container.file().read(entry.offset, entry.length, entry.length);
        let written: Value = serde_json::from_slice(&bytes.expect("readable")).expect("JSON");
        let read = serde_json::to_value(container.metadata()).expect("JSON");
        assert!(holds(&read, &written), "{}: {read}", path.display());
        assert!(!holds(&Value::Null, &written) && written["levels"][0]["density"].is_object());
    }
}

/// A frozen container with bytes of its header set, under a checksum that fits.
fn with_header(bytes: &[u8], at: usize, value: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    bytes[at..at + value.len()].copy_from_slice(value);
    mend_checksums(&mut bytes);
    bytes
}

#[test]
fn later_versions_are_read_or_refused_as_promised() {
    let sound = std::fs::read(fixture("frozen/0.1/dvgo.mask.mipvog")).expect("a container");
    let same = digests(&open_bytes(&sound).expect("a container"), "x");
    // A later minor version, with an unknown chunk: the same values.
    let mut parts = chunks::chunks(&sound);
    let ahead = chunks::Chunk { kind: *b"ahea", level: None, bytes: b"of its time".to_vec() };
    parts.insert(1, ahead);
    let later = with_header(&chunks::container(&parts), 10, &7u16.to_le_bytes());
    let read = open_bytes(&later).expect("a container");
    assert_eq!((read.header().version, digests(&read, "x")), ([1, 7], same));
    // Another major version, a required feature, a critical chunk: told apart from damage.
    parts[1].kind = *b"Ahea";
    for bytes in [
        with_header(&sound, 8, &2u16.to_le_bytes()),
        with_header(&sound, 16, &(1u64 << 63).to_le_bytes()),
        chunks::container(&parts),
    ] {
        let error = open_bytes(&bytes).expect_err("unknown");
        assert!(matches!(error.kind(), ErrorKind::Unsupported { .. }), "{error}");
    }
}
