//! Damaged containers: no changed byte goes unnoticed, nothing panics.

use crate::common;
use std::path::Path;

use crate::common::asset::{NAME, attached, changed, glb, open};
use crate::common::{Random, chunks, fixture, mend_checksums, open_bytes};
use mipvog::base::error::Error;
use mipvog::base::limits::Limits;
use mipvog_bake::check::check;
use mipvog_outputs::gltf::attach::AttachOptions;

const CONTAINER: &str = "dvgo.mask.mipvog";

/// A small container with a mask, several levels and every kind of chunk.
fn container() -> Vec<u8> {
    std::fs::read(fixture("baked").join(CONTAINER)).expect("a golden container")
}

/// True if the strict reader takes the bytes, having read everything.
fn reads(bytes: &[u8]) -> bool {
    open_bytes(bytes).and_then(|container| container.read()).is_ok()
}

fn findings(bytes: &[u8], path: &Path) -> usize {
    std::fs::write(path, bytes).expect("writable");
    let report = check(path, &Limits::default()).expect("readable");
    assert_eq!(report.valid, report.findings.is_empty());
    report.findings.len()
}

#[test]
fn every_prefix_and_one_byte_more_is_refused() {
    let whole = container();
    let folder = common::folder();
    let path = folder.path().join("x.mipvog");
    assert!(reads(&whole) && findings(&whole, &path) == 0);
    for end in 0..whole.len() {
        assert!(!reads(&whole[..end]), "the first {end} bytes were taken");
        if end % 17 == 0 {
            assert!(findings(&whole[..end], &path) > 0, "no finding in the first {end} bytes");
        }
    }
    for more in [1, 64] {
        let longer = [&whole[..], &vec![0; more]].concat();
        assert!(!reads(&longer) && findings(&longer, &path) > 0);
    }
}

#[test]
fn every_flipped_bit_is_noticed() {
    let whole = container();
    let folder = common::folder();
    let path = folder.path().join("x.mipvog");
    let mut random = Random::new(1);
    for byte in 0..whole.len() {
        let mut damaged = whole.clone();
        damaged[byte] ^= 1 << random.below(8);
        assert!(!reads(&damaged), "a flip in byte {byte} went unnoticed");
        if byte % 17 == 0 {
            assert!(findings(&damaged, &path) > 0, "no finding for byte {byte}");
        }
    }
}

#[test]
fn hostile_numbers_behind_good_checksums_are_errors_or_readings() {
    let whole = container();
    let mut random = Random::new(2);
    let mut taken = 0;
    for _ in 0..3000 {
        let mut damaged = whole.clone();
        for _ in 0..1 + random.below(3) {
            let at = random.below(damaged.len());
            let interesting = [0, 1, 0x7f, 0x80, 0xff, random.bits() as u8];
            damaged[at] = interesting[random.below(interesting.len())];
        }
        mend_checksums(&mut damaged);
        taken += usize::from(reads(&damaged));
    }
    assert!(taken < 3000);
}

#[test]
fn ancillary_chunks_belong_to_levels_that_there_are() {
    let parts = chunks::chunks(&container());
    let levels = open_bytes(&container()).expect("a container").metadata().levels.len() as u32;
    let last = parts.iter().rposition(|chunk| chunk.level.is_some()).expect("chunks of levels");
    let with = |kind: &[u8; 4], level: Option<u32>, at: usize| {
        let mut parts = parts.clone();
        parts.insert(at, chunks::Chunk { kind: *kind, level, bytes: b"{}".to_vec() });
        reads(&chunks::container(&parts))
    };
    assert!(with(b"note", None, 1) && with(b"note", None, last + 1));
    assert!(with(b"note", Some(0), last + 1) && with(b"note", Some(levels - 1), last + 1));
    assert!(!with(b"note", Some(levels), last + 1) && !with(b"note", Some(levels + 1), 1));
    // No chunk stands before META; provenance is of no level; critical chunks must be known.
    assert!(!with(b"note", None, 0) && !with(b"prov", Some(0), last + 1));
    assert!(!with(b"Note", None, last + 1) && !with(b"VMLP", Some(0), last + 1));
}

#[test]
fn every_reserved_byte_is_held_to_zero() {
    let whole = container();
    let entry = 64 + 36..64 + 64;
    for byte in (12..16).chain(44..48).chain(52..64).chain(entry) {
        let mut damaged = whole.clone();
        damaged[byte] = 1;
        mend_checksums(&mut damaged);
        assert!(!reads(&damaged), "a set byte {byte} was taken");
    }
}

#[test]
fn the_head_of_a_mask_is_judged_number_by_number() {
    let parts = chunks::chunks(&container());
    let with = |at: usize, value: &[u8]| {
        let change = |bytes: &mut Vec<u8>| bytes[at..at + value.len()].copy_from_slice(value);
        reads(&chunks::with_chunk(&parts, b"MASK", None, change))
    };
    for axis in 0..3 {
        assert!(with(16 + 8 * axis, &2f64.to_le_bytes()) && with(40 + 8 * axis, &[0; 8]));
        for wrong in [f64::NAN, f64::INFINITY] {
            assert!(!with(16 + 8 * axis, &wrong.to_le_bytes()));
            assert!(!with(40 + 8 * axis, &wrong.to_le_bytes()));
        }
        assert!(!with(4 + 4 * axis, &1u32.to_le_bytes()));
    }
    let mask = parts.iter().find(|chunk| chunk.kind == *b"MASK").expect("a mask");
    let nearest = mask.bytes[..4] == [0; 4];
    // A threshold belongs to the trilinear lookup, and is finite.
    assert_eq!(with(64, &0.5f32.to_le_bytes()), !nearest);
    assert!(!with(64, &f32::NAN.to_le_bytes()) && !with(68, &[1]));
    // Values of the other lookup have another width.
    assert!(!with(0, &[u8::from(nearest)]) && !with(0, &[2]));
}

#[test]
fn changed_values_of_a_checkpoint_are_noticed() {
    let folder = common::folder();
    let path = folder.path().join("fine_last.tar");
    let whole = std::fs::read(fixture("trained/lego64/fine_last.tar")).expect("a checkpoint");
    let mut random = Random::new(3);
    for _ in 0..12 {
        let mut damaged = whole.clone();
        let at = random.below(damaged.len());
        // Without the sign and exponent bits the value stays finite and plausible.
        damaged[at] ^= 1 << random.below(4);
        std::fs::write(&path, &damaged).expect("writable");
        let baked = mipvog_inputs::open_with(&path, &Default::default(), &Limits::default())
            .and_then(|source| common::baked_bytes(&source.field, &Default::default()));
        // Bytes that no bake reads (alignment, names of other entries) may change without an error;
        // values may not.
        if let Ok(bytes) = baked {
            let expected =
                common::baked_bytes(&common::trained("lego64/fine_last.tar"), &Default::default());
            assert!(bytes == expected.expect("a bake"), "a change of byte {at} went unnoticed");
        }
    }
}

/// The error of strict readers for a damaged container in an asset: at the place that `validate`
/// finds.
fn strict(asset: &[u8], path: &Path) -> Error {
    let opened = open(asset, path).and_then(|asset| asset.open_field(0));
    let error = opened.and_then(|container| container.read()).expect_err("damaged");
    // The digest does not fit either, which strict readers leave to the validator.
    let findings = check(path, &Limits::default()).expect("checked").findings;
    let found: Vec<String> = findings.into_iter().map(|finding| finding.place).collect();
    assert!(found.contains(&error.place().to_string()), "{error}: {found:?}");
    error
}

#[test]
fn damage_in_a_container_in_an_asset_is_told_at_its_place_in_the_file() {
    let folder = common::folder();
    let container = container();
    let plain = glb("{\"asset\":{\"version\":\"2.0\"}}", &[]);
    let embedded =
        attached(folder.path(), &plain, CONTAINER, &AttachOptions::default()).expect("fits");
    let start = embedded.windows(8).position(|bytes| bytes == &container[..8]).expect("inside");
    let holder = folder.path().join("beside.mipvog");
    let outside = changed(&embedded, |document| {
        let field = &mut document["extensions"][NAME]["radianceFields"][0];
        field.as_object_mut().expect("a field").remove("bufferView");
        field["uri"] = "beside.mipvog".into();
    });
    let path = folder.path().join("x.glb");
    let entries = open_bytes(&container).expect("a container").entries().to_vec();
    let chunks = entries.iter().map(|entry| (entry.offset + entry.length / 2) as usize);
    // The signature, the checksum of header and directory, and each chunk.
    let mut damaged: Vec<Vec<u8>> = Vec::new();
    for at in [0, 48].into_iter().chain(chunks) {
        let mut bytes = container.clone();
        bytes[at] ^= 1;
        damaged.push(bytes);
    }
    // A byte after the last run of an atlas, under checksums that fit.
    let atlas = entries.iter().find(|entry| entry.kind == *b"DENS").expect("density");
    let mut bytes = container.clone();
    bytes[atlas.offset as usize + 8] -= 1;
    mend_checksums(&mut bytes);
    damaged.push(bytes);
    let mut last = None;
    for bytes in damaged {
        let mut inside = embedded.clone();
        inside[start..start + bytes.len()].copy_from_slice(&bytes);
        let error = strict(&inside, &path);
        assert_eq!(error.file(), Some(&*path), "{error}");
        let text = error.place().to_string();
        assert!(text.contains(&format!("container at byte {start}")), "{text}");
        last = text.split_once(", byte ").and_then(|(_, at)| at.parse::<u64>().ok());
        std::fs::write(&holder, bytes).expect("writable");
        let error = strict(&outside, &path);
        assert_eq!(error.file(), Some(&*holder), "{error}");
    }
    assert_eq!(last, Some(start as u64 + atlas.offset + atlas.length - 1));
}
