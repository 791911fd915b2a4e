//! Inputs as other programs write them: wrapped, beside things that nobody needs, and those of models
//! that are not read.

use std::path::PathBuf;

use crate::common::grids::{SmallGrid, Values, lightning, sampled, sampled_blocks};
use crate::common::models::{farthest, of_bytes, renderer, small};
use crate::common::{fixture, grid_values};
use glam::DVec3;
use mipvog::base::error::{Error, ErrorKind, Place};
use mipvog::base::limits::{Budget, Limits};
use mipvog::base::progress::Silent;
use mipvog::model::camera::Ray;
use mipvog_inputs::tensor::{self, Value};
use mipvog_inputs::{Source, SourceOptions, open_with};

fn input(name: &str) -> PathBuf {
    fixture("inputs").join(name)
}

fn open_path(path: &std::path::Path) -> Result<Source, Error> {
    open_with(path, &SourceOptions::default(), &Limits::default())
}

fn open(name: &str) -> Result<Source, Error> {
    open_path(&input(name))
}

/// All values of two fields are the same.
fn same(name: &str, found: &Source, wanted: &Source) {
    let (found, wanted) = (&found.field, &wanted.field);
    assert_eq!(found.scene, wanted.scene, "{name}");
    for (found, wanted) in found.grids().zip(wanted.grids()) {
        assert_eq!(grid_values(found), grid_values(wanted), "{name}");
    }
}

#[test]
fn wrappers_and_things_beside_the_scene_change_nothing() {
    let pairs = [
        ("plain.tar", &["wrapped.tar"][..]),
        ("with_sums.tar", &["without_sums.tar"]),
        (
            "beside_plain.tar",
            &[
                "beside_defaultdict.tar",
                "beside_namespace.tar",
                "beside_rng.tar",
                "beside_seed.tar",
                "beside_set.tar",
            ],
        ),
        ("plain.npz", &["from_a_mac.npz", "with_meta.npz", "with_names.npz"]),
    ];
    for (plain, others) in pairs {
        let wanted = open(plain).expect(plain);
        for other in others {
            same(other, &open(other).expect(other), &wanted);
        }
    }
}

#[test]
fn sums_that_no_entry_states_cover_no_values() {
    assert!(open("with_sums.tar").expect("a checkpoint").has_checksums);
    assert!(!open("without_sums.tar").expect("a checkpoint").has_checksums);
    // One entry alone whose sum is 0 is damaged.
    let mut bytes = std::fs::read(input("with_sums.tar")).expect("a fixture");
    let central = bytes.windows(4).position(|window| window == b"PK\x01\x02").expect("a directory");
    bytes[central + 16..central + 20].fill(0);
    let error = of_bytes(bytes, &SourceOptions::default()).expect_err("a wrong sum");
    assert!(matches!(error.kind(), ErrorKind::Checksum { .. }), "{error}");
}

#[test]
fn tensors_with_a_mark_are_refused_by_it() {
    let error = open("negative.tar").expect_err("marked");
    assert!(matches!(error.kind(), ErrorKind::Unsupported { .. }), "{error}");
    assert!(error.to_string().contains("neg"), "{error}");
    assert_eq!(error.place(), &Place::Tensor("model_state_dict.density".to_owned()));
}

#[test]
fn nerfstudio_on_several_devices_is_read_as_its_own_code_renders_it() {
    let source = open("nerfstudio_several.ckpt").expect("a checkpoint");
    let values = |file: &str, name: &str| {
        let file = tensor::open(&input(file), &Limits::default()).expect("a file");
        let found = file.root.get(name).and_then(Value::tensor).expect("a tensor");
        found.read_f32(&mut Budget::new(&Limits::default())).expect("values")
    };
    let vectors = |name: &str| -> Vec<DVec3> {
        let values = values("nerfstudio_several.rays.safetensors", name);
        values.as_chunks::<3>().0.iter().map(|v| DVec3::from_array(v.map(f64::from))).collect()
    };
    let rays: Vec<Ray> = vectors("origins")
        .into_iter()
        .zip(vectors("directions"))
        .map(|(origin, direction)| Ray { origin, direction })
        .collect();
    let light = renderer(&source).ray_colors(&rays, 0, &Silent).expect("rays");
    let rgb = values("nerfstudio_several.want.safetensors", "rgb");
    let left = values("nerfstudio_several.want.safetensors", "transmittance");
    assert!(farthest(light.iter().flat_map(|ray| ray.color), &rgb) < 1e-5);
    assert!(farthest(light.iter().map(|ray| ray.transmittance), &left) < 1e-5);
}

#[test]
fn other_models_are_named_with_a_way_out() {
    for (file, name, way) in [
        ("nerfacto.ckpt", "nerfacto", "python -m mipvog_bake.nerfstudio"),
        ("splatfacto.ckpt", "splatfacto", "no density"),
        ("ngp_pl.ckpt", "ngp_pl", "from_model"),
        ("vanilla.ckpt", "vanilla NeRF", "from_model"),
    ] {
        let error = open(file).expect_err(file);
        assert!(matches!(error.kind(), ErrorKind::Unsupported { .. }), "{error}");
        assert!(error.to_string().contains(name), "{error}");
        assert!(error.remedy().contains(way), "{}", error.remedy());
    }
    for (file, name, way) in [
        ("web_page.npz", "web page", "download the scene again"),
        ("lfs_pointer.tar", "Git LFS pointer", "git lfs pull"),
    ] {
        let error = open(file).expect_err(file);
        assert!(matches!(error.kind(), ErrorKind::Unsupported { .. }), "{error}");
        assert!(error.to_string().contains(name), "{error}");
        assert!(error.remedy().contains(way), "{}", error.remedy());
    }
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\n\
                  property float f_dc_0\nproperty float rot_0\nend_header\n";
    let error = of_bytes(header.into(), &SourceOptions::default()).expect_err("splats");
    assert!(error.to_string().contains("Gaussian splats"), "{error}");
}

#[test]
fn colours_beyond_white_are_told() {
    let told = |factor: f32| {
        let mut grid = sampled();
        grid.settings.clear();
        grid.arrays.retain(|(name, ..)| *name != "sh");
        let colors = (0..180).map(|i| factor * (i % 100) as f32 / 99.0).collect();
        grid.arrays.push(("color", vec![5, 4, 3, 3], Values::F32(colors)));
        let source = small(&grid).expect("a grid");
        let told = source.assumptions.into_iter().find(|assumption| assumption.key == "color");
        told.map(|assumption| assumption.message)
    };
    assert_eq!(told(1.0), None);
    assert!(told(255.0).expect("a warning").contains("up to 255"));
}

#[test]
fn the_first_value_that_is_not_finite_is_told_by_its_node() {
    let mut grid = sampled();
    let Values::F32(densities) = &mut grid.array("density").2 else { panic!("floats") };
    // Node (3, 1, 2) of 5 x 4 x 3.
    densities[(3 * 4 + 1) * 3 + 2] = f32::NAN;
    let source = small(&grid).expect("opens");
    let error = source.renderer(None, &Limits::default()).expect_err("no number");
    let ErrorKind::NonFinite { count: 1, first: [0, 3, 1, 2] } = error.kind() else {
        panic!("{error}")
    };
    assert!(!error.remedy().contains("pass"), "{}", error.remedy());
}

#[test]
fn cells_that_no_file_states_are_an_option() {
    let opened = |side: Option<usize>, grid: &_| {
        let options = SourceOptions { resolution: side, ..SourceOptions::default() };
        of_bytes(SmallGrid::to_bytes(grid), &options)
    };
    let sixteen = lightning();
    let wanted = opened(None, &sixteen).expect("16 cells");
    assert!(wanted.assumptions.iter().any(|told| told.message.contains("option resolution")));
    // The same cells in a box of 24 a side, whose first ones are where they were.
    let mut larger = lightning();
    let Values::I32(cells) = &mut larger.array("state_dict.model.links_idx").2 else {
        panic!("numbers")
    };
    for cell in cells.iter_mut() {
        let [x, y, z] = [*cell / 256, *cell / 16 % 16, *cell % 16];
        *cell = (x * 24 + y) * 24 + z;
    }
    larger.arrays.push(("model.radius", vec![3], Values::F32(vec![1.5; 3])));
    larger.arrays.push(("model.center", vec![3], Values::F32(vec![0.5; 3])));
    let found = opened(Some(24), &larger).expect("24 cells");
    assert!(!found.assumptions.iter().any(|told| told.key == "cells"));
    assert_eq!(found.field.scene.nodes.0, [26; 3]);
    let [found, wanted] = [renderer(&found), renderer(&wanted)];
    for at in 0..200 {
        let share = |step: usize| f64::from((at * step % 97) as f32) / 97.0 * 1.8 - 0.9;
        let position = [share(31), share(17), share(5)];
        let [found, wanted] =
            [&found, &wanted].map(|model| model.sample(position, 0).expect("inside").density);
        assert!((found - wanted).abs() < 1e-4, "{found} {wanted} at {position:?}");
    }
    for side in [15, 1025] {
        let error = opened(Some(side), &sixteen).expect_err("too few or too many");
        assert!(matches!(error.kind(), ErrorKind::InvalidOption { option: "resolution", .. }));
    }
}

#[test]
fn scales_and_boxes_that_no_camera_can_stand_around_name_their_setting() {
    let scaled = |scale: f32| {
        let options = SourceOptions { scene_scale: Some(scale), ..SourceOptions::default() };
        of_bytes(sampled().to_bytes(), &options)
    };
    scaled(1e-5).expect("a large box");
    for scale in [1e-45, 1e-30, 1e30, f32::INFINITY] {
        let error = scaled(scale).expect_err("no box");
        let ErrorKind::InvalidOption { option: "scene_scale", .. } = error.kind() else {
            panic!("{scale}: {error}")
        };
    }
    for (key, value, place) in [
        ("invradius3", 1e-20, Place::Key("invradius3".to_owned())),
        ("offset", 1e20, Place::Key("offset".to_owned())),
    ] {
        let mut tree = crate::common::grids::plenoctree();
        tree.arrays.retain(|(name, ..)| *name != key);
        tree.arrays.push((key, vec![3], Values::F32(vec![value; 3])));
        let error = small(&tree).expect_err(key);
        assert_eq!(error.place(), &place, "{error}");
    }
    let mut arrays = sampled();
    arrays.array("aabb").2 = Values::F32(vec![-1e20, -1.0, -1.0, 1e20, 1.0, 1.0]);
    let error = small(&arrays).expect_err("a huge box");
    assert_eq!(error.place(), &Place::Tensor("aabb".to_owned()));
}

#[test]
fn sampled_arrays_that_cannot_be_heeded_are_refused() {
    let color = || ("color", vec![5, 4, 3, 3], Values::F32(vec![0.5; 180]));
    let refused = |grid: &SmallGrid, told: &str| {
        let error = small(grid).expect_err(told).to_string();
        assert!(error.contains(told), "{error}");
    };
    let mut both = sampled();
    both.arrays.push(color());
    refused(&both, "color beside sh");
    let mut plain = sampled();
    plain.arrays[1] = color();
    small(&plain).expect("settings that colours have no use for");
    for (key, value) in [("clamp", "relu"), ("offset", "nan")] {
        plain.settings = vec![(key, value)];
        refused(&plain, key);
    }
    for dimensions in ["4.5,4,2", "-4,4,2", "nan,4,2", "0,4,2"] {
        let mut blocks = sampled_blocks();
        blocks.settings.push(("dimensions", dimensions));
        refused(&blocks, "dimensions");
    }
}

#[test]
fn volumes_are_found_by_other_names_and_in_turned_boxes() {
    let volume = |name: &str| open_path(&fixture("vdb").join(name));
    let exact = volume("exact.vdb").expect("a volume");
    same("rounded.vdb", &volume("rounded.vdb").expect("turned in float32"), &exact);
    for (file, name) in [("smoke.vdb", "smoke"), ("unnamed.vdb", "(unnamed)")] {
        let source = volume(file).expect(file);
        let told = source.assumptions.iter().find(|told| told.key == "density").expect("told");
        assert!(told.message.contains(name), "{}", told.message);
        assert!(grid_values(&source.field.density).iter().any(|density| *density > 0.0));
    }
    // A second grid shares the tree of the first one, which is whole.
    let two = volume("two.vdb").expect("a volume");
    assert!(two.assumptions.iter().all(|told| told.key != "density"));
    assert!(grid_values(&two.field.density).iter().any(|density| *density > 0.0));
    let bytes = std::fs::read(fixture("vdb/two.vdb")).expect("a fixture");
    let swapped = swap(&swap(&bytes, b"temperature", b"TEMPERATURE"), b"density", b"DENSITY");
    let swapped = of_bytes(swapped, &SourceOptions::default()).expect("names of other letters");
    same("DENSITY", &swapped, &two);
    let class = "level set is no class of fog volumes";
    let error = volume("surface.vdb").expect_err(class);
    assert!(matches!(error.kind(), ErrorKind::Unsupported { .. }), "{error}");
}

#[test]
fn the_grid_of_density_may_be_named() {
    let volume = |name: &str, grid: &str| {
        let options = SourceOptions { grid: Some(grid.to_owned()), ..SourceOptions::default() };
        open_with(&fixture("vdb").join(name), &options, &Limits::default())
    };
    let own = open_path(&fixture("vdb/two.vdb")).expect("a volume");
    same("density", &volume("two.vdb", "density").expect("by its name"), &own);
    let other = volume("two.vdb", "temperature").expect("another grid");
    assert!(other.assumptions.iter().all(|told| told.key != "density"));
    for grid in ["Density", "heat", ""] {
        let error = volume("two.vdb", grid).expect_err(grid);
        assert!(matches!(error.kind(), ErrorKind::InvalidOption { .. }), "{error}");
        assert!(error.to_string().contains("temperature"), "{error}");
    }
    let error = volume("full.vdb", "Cd").expect_err("a colour");
    assert!(error.to_string().contains("one number per voxel"), "{error}");
    let options = SourceOptions { grid: Some("density".to_owned()), ..SourceOptions::default() };
    let error = of_bytes(sampled().to_bytes(), &options).expect_err("no volume");
    assert!(matches!(error.kind(), ErrorKind::Usage { .. }), "{error}");
}

/// A file of one leaf of half floats, as OpenVDB 13 writes them: version 225, no compression.
fn half_volume(value: impl Fn(usize) -> f32) -> Vec<u8> {
    let text = |text: &str| [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
    let half = |value: f32| half::f16::from_f32(value).to_le_bytes();
    let mask = |words: usize, first: u64| {
        let rest = std::iter::repeat_n(0u64, words - 1);
        std::iter::once(first).chain(rest).flat_map(u64::to_le_bytes).collect::<Vec<u8>>()
    };
    let mut file = vec![0x20, 0x42, 0x44, 0x56, 0, 0, 0, 0];
    file.extend([225u32, 13, 0].iter().flat_map(|number| number.to_le_bytes()));
    file.push(1);
    file.extend([b'0'; 36]);
    file.extend([0u32, 1].iter().flat_map(|number| number.to_le_bytes()));
    for word in ["density", "Tree_half_5_4_3", ""] {
        file.extend(text(word));
    }
    let mut grid = [0u32, 0].iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>();
    grid.extend(text("UniformScaleMap"));
    // The scale, and what follows from it, which nobody reads.
    grid.extend([0.5f64; 15].iter().flat_map(|number| number.to_le_bytes()));
    grid.extend(1u32.to_le_bytes());
    grid.extend(half(0.0));
    grid.extend([0u32, 1, 0, 0, 0].iter().flat_map(|number| number.to_le_bytes()));
    for places in [32usize * 32 * 32, 16 * 16 * 16] {
        grid.extend(mask(places / 64, 1));
        grid.extend(mask(places / 64, 0));
        // All values are there.
        grid.push(6);
        grid.extend((0..places).flat_map(|_| half(0.0)));
    }
    let active = [u64::MAX; 8].iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    grid.extend(&active);
    let blocks = grid.len();
    grid.extend(&active);
    grid.push(6);
    grid.extend((0..512).flat_map(|at| half(value(at))));
    let start = file.len() + 24;
    for place in [start, start + blocks, start + grid.len()] {
        file.extend((place as u64).to_le_bytes());
    }
    [file, grid].concat()
}

#[test]
fn grids_of_half_floats_are_read() {
    let value = |at: usize| at as f32 / 8.0;
    let source = of_bytes(half_volume(value), &SourceOptions::default()).expect("a volume");
    // One node of nothing beyond each face.
    assert_eq!(source.field.scene.nodes.0, [10; 3]);
    let found = grid_values(&source.field.density);
    for at in 0..512 {
        let [x, y, z] = [at / 64 + 1, at / 8 % 8 + 1, at % 8 + 1];
        assert_eq!(found[(x * 10 + y) * 10 + z], value(at), "{at}");
    }
    let bytes = half_volume(value);
    for length in [bytes.len() - 1, bytes.len() / 2, 150] {
        assert!(of_bytes(bytes[..length].to_vec(), &SourceOptions::default()).is_err());
    }
}

/// Bytes in which one word of the same length stands for another.
fn swap(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let mut swapped = bytes.to_vec();
    for at in 0..bytes.len().saturating_sub(from.len()) {
        if bytes[at..].starts_with(from) {
            swapped[at..at + to.len()].copy_from_slice(to);
        }
    }
    swapped
}
