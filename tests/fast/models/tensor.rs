//! File syntax: damaged or hostile bytes are a typed error in bounded memory, never a panic.

use crate::ONE_IN;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use mipvog::base::error::{ErrorKind, Place};
use mipvog::base::limits::{Budget, Limits};
use mipvog_inputs::tensor::{self, FileKind, Value};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/trained").join(name)
}

/// Limits low enough to show requests beyond a file's own size.
fn limits() -> Limits {
    Limits { memory: 1 << 20, header_bytes: 1 << 20, pickle_objects: 50_000, ..Limits::default() }
}

fn names(value: &Value, path: &str, into: &mut Vec<String>) {
    match value {
        Value::Tensor(tensor) => into.push(format!("{path} {:?}", tensor.shape())),
        value => {
            for (key, value) in value.entries() {
                names(value, &format!("{path}/{key}"), into);
            }
        }
    }
}

/// Reads every tensor of a file.
fn read_all(value: &Value) {
    match value {
        Value::Tensor(tensor) => {
            let _ = tensor.read_f32(&mut Budget::new(&limits()));
            let _ = tensor.read_f64(&mut Budget::new(&limits()));
            let _ = tensor.read_bool(&mut Budget::new(&limits()));
            let _ = tensor.volume(&limits());
        }
        Value::List(items) => items.iter().for_each(read_all),
        value => value.entries().iter().for_each(|(_, value)| read_all(value)),
    }
}

#[test]
fn kinds_are_told_by_content() {
    let kind = |name| tensor::open(&fixture(name), &limits()).expect(name).kind;
    assert_eq!(kind("tiny/fine_last.tar"), FileKind::Torch);
    assert_eq!(kind("dvgo/flat.npz"), FileKind::Npz);
    assert_eq!(kind("dvgo/flat_compressed.npz"), FileKind::Npz);
    assert_eq!(kind("dvgo/flat.safetensors"), FileKind::Safetensors);
}

#[test]
fn opening_reads_no_tensor() {
    let file = tensor::open(&fixture("tiny/fine_last.tar"), &limits()).expect("tiny scene");
    // The directory, a header for each of 29 entries, the pickle, and where the directory may be.
    assert!(file.file.bytes_read() < 90_000, "{}", file.file.bytes_read());
    assert!(file.file.length() > 1_300_000);
    let mut found = Vec::new();
    names(&file.root, "", &mut found);
    assert!(found.contains(&"/model_state_dict/k0 [1, 7, 32, 32, 32]".to_owned()), "{found:?}");
    assert!(found.contains(&"/model_state_dict/posfreq [0]".to_owned()), "{found:?}");
    let state = "/optimizer_state_dict/state/0/exp_avg [1, 1, 32, 32, 32]";
    assert!(found.contains(&state.to_owned()), "{found:?}");
    let settings = file.root.get("model_kwargs").expect("settings");
    assert_eq!(settings.get("alpha_init").map(|v| v.number("a").expect("number")), Some(0.01));
    let corner = settings.get("xyz_min").map(|v| v.vector3("xyz_min").expect("corner"));
    assert_eq!(corner.map(|c| c.map(|v| v as f32)), Some([-1.05, -0.8, -0.62]));
    let own = file.root.get("MaskCache_kwargs").expect("own mask");
    assert!(
        (own.get("act_shift").expect("numpy").number("s").expect("one") + 4.595_12).abs() < 1e-5
    );
    assert_eq!(own.get("voxel_size_ratio").expect("tensor").number("r").expect("one"), 1.0);
}

#[test]
fn hostile_files_are_refused() {
    let cases = [
        ("os_system.tar", "os.system"),
        ("eval.tar", "builtins.eval"),
        ("holds_itself.tar", "holds itself"),
        ("laughs.tar", "pickle objects"),
        ("long_laughs.tar", "pickle objects"),
        ("sizes.tar", "bytes of pickle objects"),
        ("deep.tar", "pickle objects"),
        ("huge_storage.tar", "4611686018427387904 elements"),
        ("huge_shape.tar", "beyond 2^63"),
        ("huge_stride.tar", "inside its storage"),
        ("beyond.tar", "inside its storage"),
        ("negative.tar", "0 or more"),
        ("no_storage.tar", "no such entry"),
        ("huge_bytes.tar", "expected 4611686018427387904"),
        ("bomb.tar", "bytes of a header"),
        ("states_less.tar", "larger than"),
        ("states_more.tar", "1032 times"),
        ("duplicate.tar", "two entries of one name"),
        ("truncated.tar", "zip"),
        ("half.tar", "zip"),
        ("empty", "an empty file"),
        ("text.txt", "a text file"),
        ("empty.zip", "an empty zip file"),
        ("legacy.pt", "before 1.6"),
        ("huge_header.safetensors", "4611686018427387904"),
        ("twice.safetensors", "two tensors"),
        ("hole.safetensors", "data from 8"),
        ("overlap.safetensors", "data from 4"),
        ("outside.safetensors", "found 16 bytes, expected 32"),
        ("slack.safetensors", "8 bytes after"),
        ("other_size.safetensors", "inside its storage|expected 12|12 for"),
        ("overflow.safetensors", "beyond 2^63"),
        ("deep.safetensors", "header"),
        ("../refused/big_endian.tar", "\"big\""),
        ("../dvgo", "directory"),
        ("nowhere", "os error 2"),
    ];
    for (name, expected) in cases {
        let path = fixture("hostile").join(name);
        let error = tensor::open(&path, &limits()).expect_err(name);
        let text = error.to_string();
        assert!(expected.split('|').any(|part| text.contains(part)), "{name}: {text}");
        assert!(text.contains(name.rsplit('/').next().expect("a name")), "{text}");
    }
}

#[test]
fn foreign_types_are_refused_where_they_are_read() {
    for (name, expected) in [
        ("hostile/foreign_type.safetensors", "F8_E4M3"),
        ("refused/big_endian.npz", ">f4"),
        ("refused/structured.npz", r#"["a","<f4"]"#),
    ] {
        let file = tensor::open(&fixture(name), &limits()).expect("its structure is sound");
        let tensors: Vec<_> = file.root.entries().iter().filter_map(|(_, v)| v.tensor()).collect();
        let errors: Vec<String> = tensors
            .iter()
            .filter_map(|tensor| tensor.read_f32(&mut Budget::new(&limits())).err())
            .map(|error| error.to_string())
            .collect();
        assert!(errors.iter().any(|error| error.contains(expected)), "{name}: {errors:?}");
    }
}

#[test]
fn big_laughs_end_under_default_limits_too() {
    for name in ["laughs.tar", "long_laughs.tar", "deep.tar", "bomb.tar"] {
        let error = tensor::open(&fixture("hostile").join(name), &Limits::default());
        let kind = error.expect_err(name);
        let typed =
            matches!(kind.kind(), ErrorKind::OverLimit { .. } | ErrorKind::Malformed { .. });
        assert!(typed, "{name}: {kind}");
    }
}

#[test]
fn damage_in_what_is_read_is_found() {
    let file = tensor::open(&fixture("hostile/damaged_weight.tar"), &limits()).expect("structure");
    let weight = file.root.at(&["model_state_dict", "rgbnet.0.weight"]).expect("weight");
    let error = weight.tensor().expect("a tensor").read_f32(&mut Budget::new(&limits()));
    let error = error.expect_err("flipped bit");
    assert!(matches!(error.kind(), ErrorKind::Checksum { .. }), "{error}");
    let place = Place::Tensor("model_state_dict.rgbnet.0.weight".into());
    assert_eq!(error.place(), &place);
}

#[test]
fn stored_arrays_keep_a_checksum_of_their_own() {
    let bytes = std::fs::read(fixture("dvgo/flat.npz")).expect("fixture");
    let folder = tempfile::tempdir().expect("temporary folder");
    let open = |bytes: &[u8]| {
        let path = folder.path().join("x");
        std::fs::write(&path, bytes).expect("temporary file");
        tensor::open(&path, &limits()).expect("structure")
    };
    let read = |file: &tensor::TensorFile| {
        let array = file.root.get("model_state_dict.rgbnet.3.weight").expect("array").clone();
        let offset = array.tensor().and_then(tensor::Tensor::offset).expect("stored");
        (offset, array.tensor().expect("array").read_f32(&mut Budget::new(&limits())))
    };
    let (offset, whole) = read(&open(&bytes));
    assert_eq!(whole.expect("undamaged").len(), 48);
    let mut damaged = bytes.clone();
    damaged[offset as usize + 9] ^= 1;
    let error = read(&open(&damaged)).1.expect_err("flipped bit");
    assert!(matches!(error.kind(), ErrorKind::Checksum { .. }), "{error}");
}

#[test]
fn digests_follow_content() {
    let digest = |name| tensor::open(&fixture(name), &limits()).expect(name).digest;
    assert_eq!(digest("dvgo/protocol2.tar"), digest("dvgo/protocol2.tar"));
    let all =
        ["dvgo/protocol2.tar", "dvgo/protocol3.tar", "dvgo/flat.npz", "dvgo/flat.safetensors"];
    let all: std::collections::BTreeSet<_> = all.into_iter().map(digest).collect();
    assert_eq!(all.len(), 4);
}

/// Opens bytes as a file and reads all of it, if it opens.
fn try_all(bytes: &[u8]) -> bool {
    let mut file = tempfile::NamedTempFile::new().expect("temporary file");
    file.write_all(bytes).expect("temporary file");
    match tensor::open(file.path(), &limits()) {
        Ok(file) => {
            read_all(&file.root);
            true
        }
        Err(error) => {
            assert!(!error.to_string().is_empty() && !error.remedy().is_empty());
            false
        }
    }
}

#[test]
fn every_prefix_is_refused() {
    for name in ["dvgo/protocol2.tar", "dvgo/flat.safetensors", "dvgo/flat_compressed.npz"] {
        let whole = std::fs::read(fixture(name)).expect("fixture");
        assert!(try_all(&whole), "{name}");
        let mut file = tempfile::NamedTempFile::new().expect("temporary file");
        file.write_all(&whole).expect("temporary file");
        for end in (0..whole.len()).rev().step_by(ONE_IN) {
            file.as_file().set_len(end as u64).expect("cut");
            let error = tensor::open(file.path(), &limits()).expect_err("a prefix");
            let typed = match error.kind() {
                ErrorKind::Malformed { .. } | ErrorKind::Truncated { .. } => true,
                // A few bytes do not tell a kind.
                ErrorKind::WrongKind { .. } => end < 9,
                _ => false,
            };
            assert!(typed, "{name}: {end} bytes of {}: {error}", whole.len());
        }
    }
}

#[test]
fn flipped_bits_never_panic() {
    let mut state = 1u64;
    let mut random = move |below: usize| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) as usize) % below
    };
    let names = [
        "dvgo/protocol2.tar",
        "dvgo/protocol5.tar",
        "dvgo/deflated.tar",
        "dvgo/strided.tar",
        "dvgo/flat.npz",
        "dvgo/flat_compressed.npz",
        "dvgo/flat_fortran.npz",
        "dvgo/flat.safetensors",
    ];
    for name in names {
        let whole = std::fs::read(fixture(name)).expect("fixture");
        for _ in 0..300 / ONE_IN {
            let mut bytes = whole.clone();
            let structure =
                [0..2600.min(whole.len()), whole.len().saturating_sub(2600)..whole.len()];
            for _ in 0..=random(3) {
                let range = structure[random(2)].clone();
                let at = range.start + random(range.len());
                bytes[at] ^= 1 << random(8);
            }
            try_all(&bytes);
        }
    }
}

#[test]
fn flips_behind_a_right_checksum_never_panic() {
    let whole = std::fs::read(fixture("dvgo/protocol4.tar")).expect("fixture");
    let length = u32::from_le_bytes(whole[22..26].try_into().expect("four bytes")) as usize;
    let name = u16::from_le_bytes(whole[26..28].try_into().expect("two bytes")) as usize;
    let pickle = 30 + name..30 + name + length;
    let central = whole.windows(4).position(|w| w == b"PK\x01\x02").expect("directory");
    let (mut opened, mut refused) = (0, 0);
    for at in pickle.clone().step_by(ONE_IN) {
        for flip in [0x01, 0x80, 0x24] {
            let mut bytes = whole.clone();
            bytes[at] ^= flip;
            let sum = crc32fast::hash(&bytes[pickle.clone()]).to_le_bytes();
            bytes[14..18].copy_from_slice(&sum);
            bytes[central + 16..central + 20].copy_from_slice(&sum);
            if try_all(&bytes) { opened += 1 } else { refused += 1 }
        }
    }
    assert!(opened * ONE_IN > 100 && refused * ONE_IN > 1000, "{opened} opened, {refused} refused");
}

#[test]
fn single_texts_of_an_archive_are_read() {
    for name in ["dvgo/flat.npz", "dvgo/flat_compressed.npz"] {
        let file = tensor::open(&fixture(name), &limits()).expect(name);
        let found = file.root.get("model_kwargs.density_type");
        assert!(matches!(found, Some(Value::Text(text)) if text == "DenseGrid"), "{found:?}");
    }
}
