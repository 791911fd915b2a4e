//! SVRaster's voxels: by their own rules, at the nodes of boxes, and files that cannot be.

use std::collections::BTreeMap;

use crate::common::models::{
    Reference, farthest, is_typed, of_bytes, points_agree, read, renderer,
};
use crate::common::voxels::{Cube, Voxels};
use crate::common::{fixture, folder};
use mipvog::base::error::Error;
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog_inputs::{Source, SourceOptions, ViewChoice, open_with};

fn open(name: &str, options: &SourceOptions) -> Result<Source, Error> {
    open_with(&fixture("voxels").join(name), options, &Limits::default())
}

/// Colours and transmittances within 2e-6 of the reference, points within 1e-5.
fn agrees(name: &str, source: &Source) {
    let (model, reference) = (renderer(source), Reference::within("voxels", name));
    let light = model.ray_colors(&reference.rays(), 0, &Silent).expect("rays");
    let rgb = farthest(light.iter().flat_map(|ray| ray.color), &reference.values("rgb"));
    let left = farthest(light.iter().map(|r| r.transmittance), &reference.values("transmittance"));
    assert!(rgb < 2e-6 && left < 2e-6, "{name}: colours {rgb}, transmittance {left}");
    points_agree(name, &model, &reference);
}

#[test]
fn files_of_every_layout_follow_their_own_rules() {
    for name in ["svraster_unbounded", "svraster_quantized", "svraster_geosvr"] {
        let source = open(&format!("{name}.pt"), &SourceOptions::default()).expect(name);
        agrees(name, &source);
        let supersampled = source.assumptions.iter().any(|assumption| assumption.key == "ss");
        assert_eq!(supersampled, name == "svraster_geosvr");
    }
}

/// A checkpoint of this content.
fn small() -> Voxels {
    Voxels::small()
}

#[test]
fn a_ply_file_is_the_checkpoint_that_it_was_made_of() {
    let plain = SourceOptions::default();
    let [checkpoint, ply] = [small().checkpoint().to_bytes(), small().ply()];
    let [checkpoint, ply] = [checkpoint, ply].map(|bytes| of_bytes(bytes, &plain).expect("voxels"));
    let [a, b] = [&checkpoint, &ply].map(renderer);
    let rays = Reference::within("voxels", "svraster_quantized").rays();
    let [a, b] = [a, b].map(|model| model.ray_colors(&rays, 0, &Silent).expect("rays"));
    assert_eq!(a, b);
    assert!(a.iter().filter(|ray| ray.transmittance < 0.5).count() > 100);
    read(&ply).expect("a field");
}

/// The nodes of a box have the logits of densities between corners, or of the mean around a node;
/// compared on fields whose densities are the same everywhere, which few samples see as many do.
#[test]
fn nodes_have_the_densities_of_voxels() {
    let mut voxels = small();
    voxels.even(-1.0);
    let source =
        of_bytes(voxels.checkpoint().to_bytes(), &SourceOptions::default()).expect("voxels");
    let scene = &source.field.scene;
    let nodes = scene.nodes.0;
    assert_eq!(nodes, [17; 3]);
    let per_unit = f64::from(scene.activation.interval) / scene.march.interval_length();
    let expected = 100.0 * libm::exp(-0.909_090_909_091 - 0.904_689_820_196);
    let mut plane = vec![0.0; nodes[1] * nodes[2]];
    let mut full = 0;
    for x in 0..nodes[0] {
        source.field.density.read_plane(0, x, &mut plane, |_| {}).expect("a plane");
        for (node, raw) in plane.iter().enumerate() {
            let place = [x, node / nodes[2], node % nodes[2]];
            let touched = voxels.cubes().iter().any(|cube| cube.touches(place, 16));
            let density = scene.activation.density(f64::from(*raw)) * per_unit;
            if touched {
                full += 1;
                assert!((density / expected - 1.0).abs() < 1e-4, "{place:?}: {density}");
            } else {
                assert!(density < 1e-30, "{place:?}: {density}");
            }
        }
    }
    assert!(full > 100, "{full}");
}

#[test]
fn smaller_voxels_are_averaged() {
    let mut voxels = small();
    voxels.even(-1.0);
    let options = SourceOptions { resolution: Some(9), ..SourceOptions::default() };
    let source = of_bytes(voxels.checkpoint().to_bytes(), &options).expect("voxels");
    let scene = &source.field.scene;
    assert_eq!(scene.nodes.0, [9; 3]);
    let averaged = source.assumptions.iter().find(|assumption| assumption.key == "resolution");
    assert!(averaged.expect("a warning").message.contains("are averaged"));
    let per_unit = f64::from(scene.activation.interval) / scene.march.interval_length();
    let full = 100.0 * libm::exp(-0.909_090_909_091 - 0.904_689_820_196);
    let mut plane = vec![0.0; 81];
    for x in 0..9 {
        source.field.density.read_plane(0, x, &mut plane, |_| {}).expect("a plane");
        for (node, raw) in plane.iter().enumerate() {
            let place = [x, node / 9, node % 9];
            let Some(share) = voxels.share_around(place, 8) else { continue };
            let density = scene.activation.density(f64::from(*raw)) * per_unit;
            assert!((density - share * full).abs() < 1e-4 * full, "{place:?}: {density} {share}");
        }
    }
}

#[test]
fn colours_of_nodes_are_those_of_voxels_around_them() {
    let mut voxels = small();
    voxels.paint(|_| [0.25, -0.5, 1.5]);
    for view in [ViewChoice::Keep, ViewChoice::None] {
        let options = SourceOptions { view, ..SourceOptions::default() };
        let source = of_bytes(voxels.checkpoint().to_bytes(), &options).expect("voxels");
        let [_, ny, nz] = source.field.scene.nodes.0;
        let mut plane = vec![0.0; ny * nz];
        for (channel, expected) in [0.25f32, -0.5, 1.5].into_iter().enumerate() {
            let expected = match view {
                ViewChoice::None => (0.5 + 0.282_094_8 * expected).max(0.0),
                _ => expected,
            };
            source.field.color[0].read_plane(channel, 6, &mut plane, |_| {}).expect("a plane");
            let colored = (0..ny * nz).filter(|node| {
                let place = [6, node / nz, node % nz];
                voxels.cubes().iter().any(|cube| cube.touches(place, 16))
            });
            for node in colored {
                assert!((plane[node] - expected).abs() < 1e-5, "{channel}: {}", plane[node]);
            }
        }
    }
}

#[test]
fn a_world_around_has_boxes_as_far_as_it_is_wanted() {
    let count = |options: &SourceOptions| {
        let source = open("svraster_unbounded.pt", options).expect("voxels");
        source.field.check().expect("boxes around each other");
        (source.field.lattices().len(), source.is_unbounded)
    };
    let plain = SourceOptions::default();
    assert_eq!(count(&plain), (4, true));
    for (extent, boxes) in [(1.0, 1), (2.0, 2), (5.0, 4), (100.0, 4)] {
        assert_eq!(count(&SourceOptions { extent: Some(extent), ..plain.clone() }), (boxes, true));
    }
    assert_eq!(count(&SourceOptions { drop_background: true, ..plain }), (1, false));
}

#[test]
fn settings_beside_a_file_are_followed() {
    let here = folder();
    let path = here.path().join("checkpoints");
    std::fs::create_dir(&path).expect("a folder");
    let path = path.join("iter1.pt");
    std::fs::write(&path, small().checkpoint().to_bytes()).expect("writable");
    let read = || open_with(&path, &SourceOptions::default(), &Limits::default());
    let background = |source: Source| source.field.scene.background;
    let said = |source: &Source| {
        source.assumptions.iter().map(|assumption| assumption.key).collect::<Vec<_>>()
    };
    let source = read().expect("without settings");
    assert_eq!(said(&source), ["config.yaml"]);
    assert_eq!(background(source), [1.0; 3]);
    let config = here.path().join("config.yaml");
    for (text, color, keys) in [
        ("model:\n  black_background: True\n  ss: 1.0\n", 0.0, vec![]),
        ("model:\n  white_background: true\n  ss: 1.5\n", 1.0, vec!["ss"]),
        ("model:\n  n_samp_per_vox: 3\n  ss: 1\n", 0.0, vec!["background"]),
    ] {
        std::fs::write(&config, text).expect("writable");
        let source = read().expect(text);
        assert_eq!(said(&source), keys, "{text}");
        assert_eq!(background(source), [color; 3], "{text}");
    }
    for text in
        ["model:\n  n_samp_per_vox: 0\n", "model:\n  ss: many\n", "model:\n  white_background: 2\n"]
    {
        std::fs::write(&config, text).expect("writable");
        let error = read().expect_err(text);
        assert!(is_typed(&error) && error.to_string().contains("config.yaml"), "{error}");
    }
}

#[test]
fn files_that_cannot_be_are_refused() {
    type Change = fn(&mut Voxels);
    let lies: BTreeMap<&str, Change> = BTreeMap::from([
        ("level 17", (|voxels| voxels.levels[1] = 17) as Change),
        ("level 0", |voxels| voxels.levels[0] = 0),
        ("overlaps", |voxels| voxels.paths[1] = voxels.paths[0]),
        ("zeros below the last", |voxels| voxels.paths[0] |= 1),
        ("distinct corner", |voxels| voxels.table.truncate(3)),
        ("not finite", |voxels| voxels.table[2] = f32::NAN),
        ("is not finite", |voxels| voxels.harmonics[5] = f32::INFINITY),
        ("active_sh_degree", |voxels| voxels.degree = 7),
        ("scene_extent", |voxels| voxels.extent = 0.0),
        ("inside_extent", |voxels| voxels.inside = 1.3),
        ("scene_center", |voxels| voxels.center[1] = f64::NAN),
    ]);
    for (said, lie) in lies {
        let mut voxels = small();
        lie(&mut voxels);
        let bytes = voxels.checkpoint().to_bytes();
        let error = of_bytes(bytes, &SourceOptions::default()).and_then(|source| read(&source));
        let error = error.expect_err(said);
        assert!(is_typed(&error) && error.to_string().contains(said), "{said}: {error}");
    }
}

#[test]
fn damaged_ply_files_are_refused() {
    let refused = |bytes: Vec<u8>, said: &str| {
        let error = of_bytes(bytes, &SourceOptions::default()).and_then(|source| read(&source));
        let error = error.expect_err(said);
        let text = format!("{error} {}", error.remedy());
        assert!(is_typed(&error) && text.contains(said), "{said}: {text}");
    };
    let sound = small().ply();
    refused(sound[..sound.len() - 5].to_vec(), "cut short");
    let mut even = small();
    even.forget_corners();
    refused(even.ply(), "NumPy 2");
    let header = |from: &str, to: &str| {
        let text = String::from_utf8_lossy(&sound[..2000]).into_owned();
        let end = text.find("end_header").expect("a header");
        let changed = text[..end].replace(from, to);
        [changed.as_bytes(), &sound[end..]].concat()
    };
    refused(header("binary_little_endian", "ascii"), "binary_little_endian");
    refused(header("comment scene_extent", "comment other_extent"), "scene_extent");
    refused(header("property float grid3_value", "property double grid3_value"), "cut short");
    refused(header("element vertex ", "element vertex 9999999"), "cut short");
    refused(header("property float x", "property list uchar float x"), "property list");
}

#[test]
fn a_cube_is_where_its_path_says() {
    let cube = Cube { corner: [3, 1, 2], edge: 1 };
    assert!(cube.touches([3, 1, 2], 16) && cube.touches([4, 2, 3], 16));
    assert!(!cube.touches([5, 1, 2], 16));
}
