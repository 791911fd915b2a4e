//! Damaged containers: no changed byte goes unnoticed, nothing panics.

mod common;

use std::path::Path;

use common::{Random, fixture};
use mipvog_bake::check::check;
use mipvog_bake::limits::Limits;

/// A small container with a mask, several levels and every kind of chunk.
fn container() -> Vec<u8> {
    std::fs::read(fixture("baked/dvgo.mask.mipvog")).expect("a golden container")
}

/// Whether the strict reader takes the bytes, having read everything.
fn reads(bytes: &[u8]) -> bool {
    common::open_bytes(bytes).and_then(|container| container.read()).is_ok()
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
            let interesting = [0, 1, 0x7f, 0x80, 0xff, random.next() as u8];
            damaged[at] = interesting[random.below(interesting.len())];
        }
        mend_checksums(&mut damaged);
        taken += usize::from(reads(&damaged));
    }
    assert!(taken < 3000);
}

/// Writes the checksums that a forger would: of each chunk where the directory says it is, then of
/// header and directory.
fn mend_checksums(bytes: &mut [u8]) {
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
        let baked = mipvog_bake::source::open(&path, &Default::default(), &Limits::default())
            .and_then(|source| common::baked_bytes(&source.field, &Default::default()));
        // What no bake reads (alignment, names of other entries) may change unnoticed; values not.
        if let Ok(bytes) = baked {
            let expected =
                common::baked_bytes(&common::trained("lego64/fine_last.tar"), &Default::default());
            assert!(bytes == expected.expect("a bake"), "a change of byte {at} went unnoticed");
        }
    }
}
