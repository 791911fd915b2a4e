//! Whole scenes: what they show by their own rules, and the boxes around each other that a bake
//! takes.

use crate::common::boxes::{Boxes, psnr};
use crate::common::factored::contracted;
use crate::common::fixture;
use crate::common::models::{Reference, farthest, is_typed, of_bytes, renderer};
use crate::common::torch::Item;
use mipvog::base::error::{Error, ErrorKind};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::model::camera::Ray;
use mipvog::model::field::RadianceField;
use mipvog_inputs::tensor::{Row, safetensors_header};
use mipvog_inputs::{Source, SourceOptions, open_with};
use std::collections::BTreeMap;

/// Half the edge of the inner box of the reference scene of DirectVoxGO, and its middle.
const RADIUS: f64 = 1.7;
const CENTER: [f64; 3] = [0.4, -0.3, 0.2];

fn open(name: &str, options: &SourceOptions) -> Result<Source, Error> {
    open_with(&fixture("worlds").join(name), options, &Limits::default())
}

fn black() -> SourceOptions {
    SourceOptions { background: Some([0.0; 3]), ..SourceOptions::default() }
}

/// The share of rays whose colours are within 2e-4, and the largest difference of transmittances.
fn rays_agree(name: &str, source: &Source) -> (f64, f32) {
    let (model, reference) = (renderer(source), Reference::within("worlds", name));
    let light = model.ray_colors(&reference.rays(), 0, &Silent).expect("rays");
    let expected = reference.values("rgb");
    let near = light.iter().zip(expected.as_chunks::<3>().0).filter(|(ray, expected)| {
        ray.color.iter().zip(*expected).all(|(a, b)| (a - b).abs() < 2e-4)
    });
    let left = farthest(light.iter().map(|r| r.transmittance), &reference.values("transmittance"));
    (near.count() as f64 / light.len() as f64, left)
}

fn colors_agree(name: &str, source: &Source) {
    let (model, reference) = (renderer(source), Reference::within("worlds", name));
    let directions = reference.points("color_directions");
    let (positions, colors) = (reference.points("positions"), reference.values("color"));
    for (position, expected) in positions.iter().zip(colors.chunks_exact(3 * directions.len())) {
        let found = model.point_colors(*position, &directions, 0).expect("a point");
        let off = farthest(found.into_iter().flatten(), expected);
        assert!(off < 1e-5, "{name}: colours {off} off at {position:?}");
    }
}

#[test]
fn an_unbounded_scene_of_directvoxgo_follows_its_own_rules() {
    let source = open("dvgo_unbounded.tar", &SourceOptions::default()).expect("a scene");
    let (near, left) = rays_agree("dvgo_unbounded", &source);
    assert!(near == 1.0 && left < 2e-5, "{near}, {left}");
    colors_agree("dvgo_unbounded", &source);
    let (model, reference) = (renderer(&source), Reference::within("worlds", "dvgo_unbounded"));
    let contracted = reference.points("contracted");
    let mut inner = 0;
    for ((position, expected), contracted) in
        reference.points("positions").into_iter().zip(reference.values("density")).zip(contracted)
    {
        let found = f64::from(model.sample(position, 0).expect("a point").density);
        assert_eq!(found > 0.0, expected > 0.0, "the mask at {position:?}");
        if contracted.iter().all(|at| at.abs() < 1.0) {
            inner += 1;
            let expected = f64::from(expected) / RADIUS;
            assert!((found - expected).abs() <= 1e-5 * expected, "{found} for {expected}");
        }
    }
    assert!(inner > 50, "{inner} places in the inner box");
}

#[test]
fn scenes_of_several_unit_cubes_follow_instant_ngps_rules() {
    for name in ["ngp_aabb4", "ngp_aabb16"] {
        let source = open(&format!("{name}.ingp"), &black()).expect(name);
        let (near, left) = rays_agree(name, &source);
        assert!(near >= 0.995, "{name}: {near}, {left}");
        colors_agree(name, &source);
        let (model, reference) = (renderer(&source), Reference::within("worlds", name));
        let points = reference.points("positions").into_iter().zip(reference.values("density"));
        for (position, expected) in points {
            let found = model.sample(position, 0).expect("a point").density;
            assert!((found - expected).abs() <= 1e-5 * expected, "{name}: {found} for {expected}");
        }
    }
}

fn nested(field: &RadianceField) {
    field.check().expect("boxes fit around each other");
    let lattices = field.lattices();
    assert!(lattices.iter().all(|one| one.nodes.0.iter().all(|count| count % 2 == 1)));
}

#[test]
fn boxes_reach_as_far_as_they_are_told_to() {
    let with = |extent: Option<f32>, resolution: Option<usize>| SourceOptions {
        extent,
        resolution,
        ..SourceOptions::default()
    };
    let reach = |source: &Source, center: f64| {
        let last = *source.field.lattices().last().expect("a box");
        f64::from(last.bounds.max[0]) - center
    };
    let dvgo = |extent, resolution| {
        open("dvgo_unbounded.tar", &with(extent, resolution)).expect("a scene")
    };
    for (extent, resolution, boxes) in
        [(None, None, 8), (Some(1.0), None, 1), (Some(8.0), None, 3), (Some(8.0), Some(20), 3)]
    {
        let source = dvgo(extent, resolution);
        nested(&source.field);
        assert_eq!(source.field.lattices().len(), boxes, "{extent:?}");
        let least = RADIUS * f64::from(extent.unwrap_or(256.0));
        assert!(reach(&source, CENTER[0]) >= 0.998 * least, "{extent:?}");
        assert_eq!(resolution.is_some(), source.field.scene.nodes.0 == [21; 3]);
    }
    for (name, boxes) in [("ngp_aabb4.ingp", 3), ("ngp_aabb16.ingp", 5)] {
        let source = open(name, &with(None, Some(16))).expect(name);
        nested(&source.field);
        assert_eq!(source.field.lattices().len(), boxes, "{name}");
        let source = open(name, &with(Some(2.0), Some(16))).expect(name);
        assert_eq!(source.field.lattices().len(), 2, "{name}");
    }
}

#[test]
fn nodes_have_the_models_densities() {
    let options = SourceOptions { extent: Some(8.0), ..SourceOptions::default() };
    let source = open("dvgo_unbounded.tar", &options).expect("a scene");
    let (model, scene) = (renderer(&source), &source.field.scene);
    let per_unit = f64::from(scene.activation.interval) / scene.march.interval_length();
    let lattices = source.field.lattices();
    let shells = source.field.shells.iter().map(|shell| &shell.density);
    let grids = std::iter::once(&source.field.density).chain(shells);
    for (number, (lattice, grid)) in lattices.iter().zip(grids).enumerate() {
        let [_, ny, nz] = lattice.nodes.0;
        let mut plane = vec![0.0; ny * nz];
        let mut compared = 0;
        for x in (0..lattice.nodes.0[0]).step_by(5) {
            grid.read_plane(0, x, &mut plane, |_| {}).expect("a plane");
            for (at, raw) in plane.iter().enumerate().step_by(7) {
                let position = lattice.position([x, at / nz, at % nz]);
                let far = (0..3).map(|a| (position[a] - CENTER[a]).abs() / RADIUS);
                let far = far.fold(0.0, f64::max);
                // Within the smaller box values are means; beyond, boxes of 45 nodes are as fine as
                // contracted space only far from each inner face.
                let expected = f64::from(model.sample(position, 0).expect("a point").density);
                if expected == 0.0 || (number > 0 && far < 2.0) || (number == 0 && far > 0.99) {
                    continue;
                }
                let found = scene.activation.density(f64::from(*raw)) * per_unit;
                let is_exact = number == 0;
                compared += 1;
                let off = (found / expected).ln().abs();
                assert!(off < if is_exact { 1e-4 } else { 5.0 }, "{number}: {found} {expected}");
            }
        }
        assert!(compared > 20, "box {number}: {compared}");
    }
}

#[test]
fn boxes_show_what_the_scene_shows() {
    let options = SourceOptions { extent: Some(32.0), ..SourceOptions::default() };
    let source = open("dvgo_unbounded.tar", &options).expect("a scene");
    let rays = Reference::within("worlds", "dvgo_unbounded").rays();
    let model = renderer(&source);
    let own = model.ray_colors(&rays, 0, &Silent).expect("rays");
    let own: Vec<[f64; 3]> = own.iter().map(|ray| ray.color.map(f64::from)).collect();
    let boxes = Boxes::read(&source.field, false);
    let seen = rays.iter().map(|ray| {
        let along = ray.direction.to_array();
        let color = |at| model.point_colors(at, &[along], 0).expect("a point")[0].map(f64::from);
        boxes.follow_colors(ray, color).0
    });
    let [all, most] = psnr(&seen.collect::<Vec<_>>(), &own);
    eprintln!("boxes against the scene's own rules: {all:.1} dB, {most:.1} without the worst");
    assert!(all > 31.0, "{all}");
    let closest = boxes.dense_nodes();
    assert!(closest.iter().all(|count| *count > 0), "{closest:?}");
}

#[test]
fn colours_of_boxes_are_fitted_to_the_network() {
    let options =
        SourceOptions { extent: Some(4.0), resolution: Some(17), ..SourceOptions::default() };
    let source = open("dvgo_unbounded.tar", &options).expect("a scene");
    let rays = Reference::within("worlds", "dvgo_unbounded").rays();
    let model = renderer(&source);
    let boxes = Boxes::read(&source.field, true);
    let (mut fitted, mut exact) = (Vec::new(), Vec::new());
    for ray in &rays {
        let along = ray.direction.to_array();
        let color = |at| model.point_colors(at, &[along], 0).expect("a point")[0].map(f64::from);
        fitted.push(boxes.follow(ray).0);
        exact.push(boxes.follow_colors(ray, color).0);
    }
    let [all, _] = psnr(&fitted, &exact);
    eprintln!("fitted colours against the network's: {all:.1} dB");
    assert!(all > 28.0, "{all}");
}

#[test]
fn what_makes_no_whole_scene_is_refused() {
    let plain = SourceOptions::default();
    let far = |extent| SourceOptions { extent: Some(extent), ..SourceOptions::default() };
    for extent in [0.5, 2e6, f32::NAN] {
        let error = open("dvgo_unbounded.tar", &far(extent)).expect_err("an extent out of range");
        assert!(matches!(error.kind(), ErrorKind::InvalidOption { .. }), "{error}");
    }
    let both = SourceOptions { drop_background: true, ..far(4.0) };
    let error = open("dvgo_unbounded.tar", &both).expect_err("two extents");
    assert!(matches!(error.kind(), ErrorKind::Usage { .. }), "{error}");
    let object = open_with(&fixture("trained/tiny/fine_last.tar"), &far(4.0), &Limits::default());
    assert!(matches!(object.expect_err("an object").kind(), ErrorKind::Usage { .. }));
    let corner = |at: f32| Item::Floats(vec![3], vec![at; 3]);
    for (key, item) in [
        ("model_state_dict/xyz_max", corner(1.5)),
        ("model_state_dict/scene_radius", corner(0.0)),
        ("model_state_dict/scene_radius", corner(f32::NAN)),
        ("model_state_dict/scene_center", corner(f32::INFINITY)),
    ] {
        let mut file = contracted("inf");
        *file.item(key) = item;
        let error = of_bytes(file.to_bytes(), &plain).expect_err(key);
        assert!(is_typed(&error), "{key}: {error}");
    }
    let mut file = contracted("inf");
    file.items.retain(|item| item.0 != "model_state_dict/scene_center");
    let error = of_bytes(file.to_bytes(), &plain).expect_err("no centre");
    assert!(error.to_string().contains("scene_center"), "{error}");
}

#[test]
fn a_whole_merf_scene_follows_its_own_rules() {
    let options = SourceOptions { near: Some(0.2), ..SourceOptions::default() };
    let source = open("merf_whole", &options).expect("a scene");
    nested(&source.field);
    let (near, left) = rays_agree("merf_whole", &source);
    assert!(near >= 0.995 && left < 1e-3, "{near}, {left}");
    let (model, reference) = (renderer(&source), Reference::within("worlds", "merf_whole"));
    let points = reference.points("positions").into_iter().zip(reference.values("density"));
    for (position, expected) in points {
        let found = model.sample(position, 0).expect("a point").density;
        assert!((found - expected).abs() <= 1e-5 * expected, "{found} for {expected}");
    }
    let options = SourceOptions { extent: Some(4.0), ..options };
    let source = open("merf_whole", &options).expect("a scene");
    assert_eq!(source.field.lattices().len(), 2);
    let shell = &source.field.shells[0];
    let ([nx, ny, nz], channels) = (shell.lattice.nodes.0, shell.color[0].channels());
    assert_eq!(channels, 7);
    let mut plane = vec![0.0; ny * nz];
    shell.color[0].read_plane(4, nx / 3, &mut plane, |_| {}).expect("features");
    assert!(plane.iter().all(|value| value.is_finite()));
}

/// A safetensors file of float32 arrays.
fn arrays(tensors: &[(String, Vec<usize>, Vec<f32>)]) -> Vec<u8> {
    let rows: Vec<Row> = tensors
        .iter()
        .map(|(name, shape, _)| Row::new(name.clone(), "F32", shape).expect("a shape"))
        .collect();
    let header = safetensors_header(&BTreeMap::new(), &rows);
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.as_bytes());
    let values = tensors.iter().flat_map(|(_, _, values)| values);
    bytes.extend(values.flat_map(|value| value.to_le_bytes()));
    bytes
}

/// Boxes of 9 nodes along each edge, each `growth` times as large as the one before; a ball of radius
/// 0.8 and a wall at x of 3 and beyond.
fn sampled(levels: i32, growth: f64) -> Vec<(String, Vec<usize>, Vec<f32>)> {
    let mut tensors = Vec::new();
    for level in 0..levels {
        let key = |name: &str| match level {
            0 => name.to_owned(),
            level => format!("level{level}.{name}"),
        };
        let half = growth.powi(level);
        let axis = |at: usize| half * (at as f64 / 4.0 - 1.0);
        let (mut density, mut color) = (Vec::new(), Vec::new());
        for node in 0..729 {
            let [x, y, z] = [node / 81, node / 9 % 9, node % 9].map(axis);
            let is_dense = x * x + y * y + z * z < 0.64 || x >= 3.0;
            density.push(if is_dense { 20.0 } else { -20.0 });
            color.extend(if x >= 3.0 { [1.0, 0.5, 0.0] } else { [0.0, 0.0, 1.0] });
        }
        tensors.push((key("density"), vec![9, 9, 9], density));
        tensors.push((key("color"), vec![9, 9, 9, 3], color));
        let (low, high) = (-half as f32, half as f32);
        tensors.push((key("aabb"), vec![2, 3], vec![low, low, low, high, high, high]));
    }
    tensors
}

#[test]
fn sampled_arrays_may_have_boxes_around_the_first() {
    let plain = SourceOptions::default();
    let source = of_bytes(arrays(&sampled(3, 2.0)), &plain).expect("three boxes");
    nested(&source.field);
    assert_eq!(source.field.lattices().len(), 3);
    assert!(source.model.is_none());
    let model = renderer(&source);
    let ray =
        |direction: [f64; 3]| Ray { origin: [0.0, 0.9, 0.9].into(), direction: direction.into() };
    let light =
        model.ray_colors(&[ray([1.0, 0.0, 0.0]), ray([-1.0, 0.0, 0.0])], 0, &Silent).expect("rays");
    assert!(light[0].transmittance < 1e-3 && light[1].transmittance > 0.99, "{light:?}");
    // The wall, and the colours between it and the node before it.
    assert!(light[0].color[0] > 0.5 && light[0].color[2] < 0.5, "{light:?}");
    let inner = SourceOptions { drop_background: true, ..plain.clone() };
    let source = of_bytes(arrays(&sampled(3, 2.0)), &inner).expect("the first box");
    assert!(source.field.shells.is_empty() && source.model.is_some());
    for growth in [1.0, 0.5, 8.0] {
        let error = of_bytes(arrays(&sampled(2, growth)), &plain).expect_err("no nested boxes");
        assert!(matches!(error.kind(), ErrorKind::Malformed { .. }), "{growth}: {error}");
    }
    let mut lies = sampled(2, 2.0);
    lies[4].1 = vec![9, 9, 27];
    let error = of_bytes(arrays(&lies), &plain).expect_err("another shape");
    assert!(error.to_string().contains("level1.color"), "{error}");
    let mut lies = sampled(2, 2.0);
    lies[5].2[0] = f32::NAN;
    assert!(is_typed(&of_bytes(arrays(&lies), &plain).expect_err("no box")));
    lies.remove(5);
    let error = of_bytes(arrays(&lies), &plain).expect_err("no box");
    assert!(error.to_string().contains("level1.aabb"), "{error}");
}
