//! Snapshots of Instant-NGP that lie about themselves, or are cut short.

use super::lies::{malformed, unsupported};
use super::ngp::{open, open_with, with};
use crate::common::msgpack::{Pack, gzip, zlib};
use crate::common::ngp::{CELLS, small_ngp};
use mipvog::base::error::ErrorKind;
use mipvog::base::limits::Limits;
use mipvog_inputs::SourceOptions;

#[test]
fn lies_are_found() {
    use Pack::{Bool, Bytes, Float, Int, Raw, Text};
    malformed(with(&["snapshot", "n_params"], Int(12345)), "12345");
    malformed(with(&["snapshot", "n_params"], Int(i64::MAX)), "for this configuration");
    malformed(with(&["encoding", "n_levels"], Int(1_000_000_000)), "1000000000 levels");
    malformed(with(&["encoding", "n_levels"], Int(-1)), "-1");
    malformed(with(&["encoding", "log2_hashmap_size"], Int(60)), "60");
    malformed(with(&["encoding", "per_level_scale"], Float(f64::NAN)), "2^20");
    malformed(with(&["encoding", "per_level_scale"], Float(1e30)), "2^20");
    malformed(with(&["network", "n_neurons"], Int(1 << 40)), "1099511627776");
    malformed(with(&["snapshot", "params_binary"], Bytes(vec![0; 16])), "16 bytes");
    malformed(with(&["snapshot", "params_binary"], Text("none")), "binary");
    malformed(with(&["snapshot", "density_grid_binary"], Bytes(vec![0; 16])), "16 bytes");
    malformed(with(&["snapshot", "nerf", "dataset", "scale"], Float(0.0)), "scale");
    unsupported(with(&["snapshot", "density_grid_size"], Int(24)), "24");
    unsupported(with(&["snapshot", "version"], Int(2)), "version 2");
    unsupported(with(&["snapshot", "mode"], Text("sdf")), "sdf");
    malformed(with(&["snapshot", "nerf", "aabb_scale"], Int(4)), "each of 3 cubes");
    unsupported(with(&["snapshot", "nerf", "dataset", "is_hdr"], Bool(true)), "upper bound");
    unsupported(with(&["encoding", "otype"], Text("TriangleWave")), "TriangleWave");
    unsupported(with(&["network", "activation"], Text("Squareplus")), "Squareplus");
    unsupported(with(&["snapshot", "extra"], Raw(vec![0xd4, 1, 2])), "extension type");
    unsupported(
        with(&["snapshot", "extra"], Raw(vec![0xc9, 0xff, 0xff, 0xff, 0xff, 1])),
        "extension",
    );
    let nan = {
        let mut model = small_ngp(1.4, false, CELLS, 2);
        model.table[7] = f32::NAN;
        let source = open(model.snapshot(Some(1.4), false).bytes()).expect("opens");
        source.renderer(None, &Limits::default()).expect_err("no numbers")
    };
    malformed(nan, "which is not finite");
    // Lists inside of lists, and maps.
    for marker in [0x91u8, 0x81] {
        malformed(with(&["snapshot", "deep"], Raw(vec![marker; 1_000_000])), "");
    }
    // A long name, of which each value below it would have a copy.
    let mut long = vec![0xdb, 0, 0, 0x20, 0];
    long.extend([b'a'; 0x2000]);
    let map = [&[0x81], &long[..], &[0x81, 0xa1, b'b', 0xc4, 0]].concat();
    let error = with(&["snapshot", "named"], Raw(map));
    assert!(error.to_string().contains("bytes of a name, expected at most 4096"), "{error}");
    for raw in [vec![0xdd, 0xff, 0xff, 0xff, 0xff], vec![0xdb, 0x7f, 0xff, 0xff, 0xff, b'a']] {
        let error = with(&["snapshot", "long"], Raw(raw));
        let known =
            matches!(error.kind(), ErrorKind::Truncated { .. } | ErrorKind::OverLimit { .. });
        assert!(known, "{error}");
    }
    malformed(with(&["snapshot", "text"], Raw(vec![0xa2, 0xff, 0xfe])), "UTF-8");
    malformed(with(&["snapshot", "byte"], Raw(vec![0xc1])), "c1");
}

#[test]
fn packed_lies_are_found() {
    let bytes = small_ngp(1.4, false, CELLS, 2).snapshot(Some(1.4), false).bytes();
    for packed in [zlib(&bytes), gzip(&bytes)] {
        let cut = packed[..packed.len() / 2].to_vec();
        let error = open(cut).expect_err("cut short");
        assert!(matches!(error.kind(), ErrorKind::Malformed { .. }), "{error}");
        let mut damaged = packed.clone();
        let at = damaged.len() - 2;
        damaged[at] ^= 0x40;
        assert!(open(damaged).is_err(), "the checksum at the end is wrong");
    }
    for end in [1, bytes.len() / 2, bytes.len() - 1] {
        let error = open(bytes[..end].to_vec()).expect_err("cut short");
        assert!(!matches!(error.kind(), ErrorKind::Io(_)), "{error}");
    }
    assert!(open([bytes.clone(), vec![0]].concat()).is_err(), "bytes behind the document");
    // A document, then nothing but zeros: 200 MB in 200 kB.
    let mut bomb = bytes[..600].to_vec();
    bomb.resize(200 << 20, 0);
    let limits = Limits { memory: 8 << 20, ..Limits::default() };
    let error = open_with(zlib(&bomb), &SourceOptions::default(), &limits).expect_err("a bomb");
    assert!(matches!(error.kind(), ErrorKind::OverLimit { .. }), "{error}");
}
