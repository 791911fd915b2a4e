//! NanoVDB files, as `vdb_tool` writes the volume of `fixtures/vdb/full.vdb`.

use std::path::{Path, PathBuf};

use crate::common::models::is_typed;
use crate::common::msgpack::unzlib;
use crate::common::{fixture, folder};
use mipvog::base::error::{Error, ErrorKind};
use mipvog::base::limits::{Budget, Limits};
use mipvog_inputs::tensor::{self, FileKind};
use mipvog_inputs::vdb::{LEAF_VOXELS, VdbGrid, read_grid};
use mipvog_inputs::{Source, SourceOptions, open_with};

fn volume(name: &str) -> PathBuf {
    fixture("vdb").join(name)
}

fn grid(path: &Path, name: &str) -> Result<VdbGrid, Error> {
    let limits = Limits::default();
    read_grid(&tensor::open(path, &limits)?, name, &limits, &mut Budget::new(&limits))
}

fn open(path: &Path) -> Result<Source, Error> {
    open_with(path, &SourceOptions::default(), &Limits::default())
}

/// Active voxels and their values, by place.
fn voxels(grid: &VdbGrid) -> Vec<([i32; 3], Vec<f32>)> {
    let of_leaf = grid.tree.leaves.iter().flat_map(|leaf| {
        let on = (0..LEAF_VOXELS).filter(|voxel| leaf.active[voxel / 64] >> (voxel % 64) & 1 == 1);
        on.map(|voxel| {
            let inside = [voxel >> 6, voxel >> 3 & 7, voxel & 7];
            let at = std::array::from_fn(|axis| leaf.origin[axis] + inside[axis] as i32);
            (at, leaf.values[voxel * grid.width..][..grid.width].to_vec())
        })
    });
    let mut found: Vec<_> = of_leaf.collect();
    found.sort_by_key(|(at, _)| *at);
    found
}

/// The bytes of a grid in memory, out of a file whose first grid zlib has packed.
fn unpacked(name: &str) -> Vec<u8> {
    let bytes = std::fs::read(volume(name)).expect("a fixture");
    let header = 16 + 176 + "density\0".len();
    let length = u64::from_le_bytes(*bytes[header..].first_chunk().expect("a length"));
    unzlib(&bytes[header + 8..][..length as usize])
}

#[test]
fn every_type_and_codec_has_the_voxels_of_the_vdb_file() {
    let expected = grid(&volume("full.vdb"), "density").expect("a grid");
    // Densities are whole sixteenths up to 4; a leaf's codes span its own range.
    for (name, off) in [
        ("float", 0.0),
        ("blosc", 0.0),
        ("fp16", 4.0 / 65535.0),
        ("fp8", 4.0 / 255.0),
        ("fp4", 4.0 / 15.0),
        // The tolerance of the fixture, on both sides.
        ("fpn", 0.02),
    ] {
        let path = volume(&format!("{name}.nvdb"));
        let found = grid(&path, "density").expect(name);
        assert_eq!((found.placed, found.width), (expected.placed, 1), "{name}");
        assert_eq!(found.tree.tiles, expected.tree.tiles, "{name}");
        let (own, other) = (voxels(&found), voxels(&expected));
        assert_eq!(own.len(), other.len(), "{name}");
        for ((at, value), (place, expected)) in own.iter().zip(&other) {
            let far = (value[0] - expected[0]).abs();
            assert!(at == place && far <= 0.51 * off, "{name}: {value:?} {expected:?} at {at:?}");
        }
        let source = open(&path).expect(name);
        assert_eq!((source.kind, source.kind.name()), (FileKind::NanoVdb, "NanoVDB file"));
    }
    let [own, other] =
        ["float.nvdb", "full.vdb"].map(|name| grid(&volume(name), "Cd").expect("Cd"));
    assert_eq!(own.width, 3);
    assert_eq!(voxels(&own), voxels(&other));
    let [own, other] = ["float.nvdb", "full.vdb"].map(|name| open(&volume(name)).expect("a field"));
    assert_eq!(own.field.scene, other.field.scene);
}

#[test]
fn a_grid_as_it_is_in_memory_is_read() {
    let here = folder();
    let path = here.path().join("raw.nvdb");
    for magic in [b'0', b'1'] {
        let mut bytes = unpacked("float.nvdb");
        bytes[7] = magic;
        std::fs::write(&path, &bytes).expect("writable");
        let found = grid(&path, "density").expect("a grid");
        assert_eq!(voxels(&found), voxels(&grid(&volume("full.vdb"), "density").expect("a grid")));
    }
}

#[test]
fn files_that_lie_are_refused() {
    let here = folder();
    let path = here.path().join("lie.nvdb");
    let refused = |bytes: &[u8], name: &str| {
        std::fs::write(&path, bytes).expect("writable");
        let error = open(&path).map(|_| ()).expect_err(name);
        assert!(is_typed(&error), "{name}: {error}");
        error.to_string()
    };
    let whole = std::fs::read(volume("float.nvdb")).expect("a fixture");
    let lie = |at: usize, with: &[u8], name: &str| {
        let mut bytes = whole.clone();
        bytes[at..at + with.len()].copy_from_slice(with);
        refused(&bytes, name)
    };
    let version = lie(8, &(29u32 << 21).to_le_bytes(), "an older version");
    assert!(version.contains("NanoVDB 29.0"), "{version}");
    assert!(lie(14, &[9], "an unknown codec").contains("codec 9"));
    assert!(lie(12, &[0], "no grids").contains("without grids"));
    assert!(lie(16, &[255; 8], "a grid larger than memory").contains("byte"));
    lie(24, &[255; 8], "a grid beyond the end");
    assert!(lie(48, &[20], "indices").contains("OnIndex"));
    assert!(lie(52, &[1], "a level set").contains("level set"));
    lie(16 + 136, &[255; 4], "a name without end");
    for end in (9..whole.len()).step_by(97) {
        refused(&whole[..end], "a cut file");
    }
    let raw = unpacked("float.nvdb");
    let place = |at: usize| i64::from_le_bytes(*raw[at..].first_chunk().expect("a place")) as usize;
    let root = 672 + place(672 + 24);
    let tile = root + 64;
    let upper = root + place(tile + 8);
    let child = (0..32768).find(|bit| raw[upper + 32 + 4096 + bit / 8] >> (bit % 8) & 1 == 1);
    let child = upper + 8256 + 8 * child.expect("a child");
    let lie = |at: usize, with: &[u8], name: &str| {
        let mut bytes = raw.clone();
        bytes[at..at + with.len()].copy_from_slice(with);
        refused(&bytes, name);
    };
    lie(root + 24, &[255; 4], "more tiles than bytes");
    lie(tile + 8, &(-32i64).to_le_bytes(), "a child before its root");
    lie(child, &i64::MAX.to_le_bytes(), "a child beyond the grid");
    lie(child, &0i64.to_le_bytes(), "a node that is its own child");
    lie(296 + 88, &f64::NAN.to_le_bytes(), "a map that is no number");
    let error = grid(&volume("fpn.nvdb"), "nothing").expect_err("no such grid");
    assert!(matches!(error.kind(), ErrorKind::Malformed { .. }), "{error}");
}
