//! A second reader, written in Python from `formats/mipvog.md` alone, reads the same values as the
//! crate, bit for bit.
//!
//! It needs `pip install -r tests/second_reader/requirements.txt`; `others::python` says where.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::{chunks, folder, mend_checksums, others, root};

/// Holds the reader to an exit status, if it is here, and to something that it prints.
fn reads(arguments: &[&Path], status: i32, says: &str) {
    let Some(mut python) = others::python() else { return };
    python.arg(root().join("tests/second_reader/reader.py")).args(arguments);
    let output = python.output().expect("starts");
    let printed = [output.stdout, output.stderr].map(|b| String::from_utf8_lossy(&b).into_owned());
    let printed = printed.concat();
    assert!(output.status.code() == Some(status) && printed.contains(says), "{printed}");
}

/// Entries of a folder, in a fixed order.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder of containers");
    let mut found: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
    found.sort();
    found
}

/// The committed containers, of this version and of former ones; never none.
fn containers() -> Vec<PathBuf> {
    let mut folders = entries(&root().join("fixtures/frozen"));
    folders.insert(0, root().join("fixtures/baked"));
    let containers = |folder: &PathBuf| {
        let mut found = entries(folder);
        found.retain(|path| path.extension().is_some_and(|extension| extension == "mipvog"));
        assert!(!found.is_empty(), "no .mipvog file in {}", folder.display());
        found
    };
    folders.iter().flat_map(containers).collect()
}

fn unpack(container: &Path, output: &Path) {
    let status = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"))
        .args(["--quiet", "unpack", "--output"])
        .args([output, container])
        .status()
        .expect("the program runs");
    assert!(status.success(), "{}: unpack failed", container.display());
}

#[test]
fn both_readers_decode_the_same_bits() {
    let folder = folder();
    for container in containers() {
        let unpacked = folder.path().join("unpacked.safetensors");
        unpack(&container, &unpacked);
        reads(&[&container, "--compare".as_ref(), &unpacked], 0, "");
        std::fs::remove_file(&unpacked).expect("the unpacked file");
    }
}

#[test]
fn both_readers_read_a_thumbnail() {
    let folder = folder();
    let [container, unpacked] = ["t.mipvog", "t.safetensors"].map(|name| folder.path().join(name));
    let status = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"))
        .args(["--quiet", "transcode", "--thumbnail", "16", "--output"])
        .args([&container, &root().join("fixtures/baked/tiny.rate.mipvog")])
        .status()
        .expect("the program runs");
    assert!(status.success());
    unpack(&container, &unpacked);
    reads(&[&container, "--compare".as_ref(), &unpacked], 0, "");
    let broken = root().join("fixtures/broken/thumbnail.mipvog");
    reads(&[&broken, "--compare".as_ref(), &unpacked], 2, "thmb is no PNG file");
}

/// A container of former versions, but for a rule that bends.
fn bent(features: u64) -> Vec<u8> {
    let container = root().join("fixtures/frozen/0.1/dvgo.mask.mipvog");
    let mut parts = chunks::chunks(&std::fs::read(&container).expect("a container"));
    let metadata = String::from_utf8(parts[0].bytes.clone()).expect("JSON");
    let bent = metadata.replacen(r#","bias":"#, r#","bends":[[0.5,0.25],[2.0,-0.125]],"bias":"#, 1);
    assert_ne!(metadata, bent);
    parts[0].bytes = bent.into_bytes();
    let mut bytes = chunks::container(&parts);
    bytes[10..12].copy_from_slice(&2u16.to_le_bytes());
    bytes[16..24].copy_from_slice(&features.to_le_bytes());
    mend_checksums(&mut bytes);
    bytes
}

#[test]
fn both_readers_read_a_rule_that_bends() {
    let folder = folder();
    let path = folder.path().join("bent.mipvog");
    let unpacked = folder.path().join("unpacked.safetensors");
    std::fs::write(&path, bent(4)).expect("writable");
    unpack(&path, &unpacked);
    reads(&[&path, "--compare".as_ref(), &unpacked], 0, "");
    // The header must say so.
    std::fs::write(&path, bent(0)).expect("writable");
    reads(&[&path, "--compare".as_ref(), &unpacked], 2, "");
}

/// Reads the additions that `formats/compatibility.md` allows in a later minor version.
#[test]
fn the_second_reader_takes_a_later_minor_version() {
    let folder = folder();
    let container = root().join("fixtures/frozen/0.1/dvgo.mask.mipvog");
    let unpacked = folder.path().join("unpacked.safetensors");
    unpack(&container, &unpacked);
    let mut parts = chunks::chunks(&std::fs::read(&container).expect("a container"));
    let ahead = chunks::Chunk { kind: *b"ahea", level: None, bytes: b"of its time".to_vec() };
    parts.insert(1, ahead);
    let mut later = chunks::container(&parts);
    later[10..12].copy_from_slice(&7u16.to_le_bytes());
    mend_checksums(&mut later);
    let path = folder.path().join("later.mipvog");
    std::fs::write(&path, later).expect("writable");
    reads(&[&path, "--compare".as_ref(), &unpacked], 0, "");
}

#[test]
fn the_second_reader_refuses_rays_without_end() {
    let container = root().join("fixtures/broken/ray-samples.mipvog");
    reads(&[&container, "--compare".as_ref(), &container], 2, "2^20 samples");
}

/// The comparison above would be worth nothing if it never failed.
#[test]
fn the_second_reader_sees_a_difference_and_damage() {
    let folder = folder();
    let container = containers().remove(0);
    let unpacked = folder.path().join("unpacked.safetensors");
    unpack(&container, &unpacked);

    let mut bytes = std::fs::read(&unpacked).expect("the unpacked file");
    *bytes.last_mut().expect("bytes") ^= 1;
    std::fs::write(&unpacked, bytes).expect("the changed file");
    reads(&[&container, "--compare".as_ref(), &unpacked], 1, "");

    let mut bytes = std::fs::read(&container).expect("the container");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    let damaged = folder.path().join("damaged.mipvog");
    std::fs::write(&damaged, bytes).expect("the damaged file");
    reads(&[&damaged, "--compare".as_ref(), &unpacked], 2, "");
}
