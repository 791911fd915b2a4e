//! Instant-NGP and torch-ngp: small models written from the description of their formats alone, held
//! against float64 rules.

use super::lies::{malformed, unsupported};
use crate::common;
use std::path::Path;
use std::sync::Arc;

use crate::common::grids::{SmallGrid, Values};
use crate::common::models::{renderer, small};
use crate::common::msgpack::{Pack, gzip, zlib};
use crate::common::ngp::{CELLS, FEATURES, SmallNgp, large_torch_ngp, small_ngp};
use crate::common::{Random, folder};
use glam::DVec3;
use mipvog::bake::{BakeOptions, Baker};
use mipvog::base::bytes::SourceFile;
use mipvog::base::error::{Error, ErrorKind};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::container::Container;
use mipvog::model::camera::Ray;
use mipvog::quantize::Bits;
use mipvog::view::render::Renderer;
use mipvog_inputs::{Family, Source, SourceOptions, ViewChoice};
use mipvog_inputs::{inspect_tensors, open_tensors, tensor};

/// The ratio of levels that follows from a base of 4 and a finest level of 2048.
const DERIVED: f64 = 8.0;

pub(super) fn open_with(
    bytes: Vec<u8>,
    options: &SourceOptions,
    limits: &Limits,
) -> Result<Source, Error> {
    let file = Arc::new(SourceFile::decoded(bytes, Path::new("/nowhere/base.ingp")));
    open_tensors(&tensor::open_file(&file, limits)?, options, limits)
}

pub(super) fn open(bytes: Vec<u8>) -> Result<Source, Error> {
    open_with(bytes, &SourceOptions::default(), &Limits::default())
}

/// Positions of the cube, in and around the occupied ball.
fn places(count: usize) -> Vec<[f64; 3]> {
    let mut random = Random::new(3);
    let mut at = |middle: f64| middle + f64::from(random.between(-0.3, 0.3));
    (0..count).map(|_| [at(0.4), at(0.5), at(0.65)]).collect()
}

fn rays(model: &SmallNgp, count: usize) -> Vec<Ray> {
    let mut random = Random::new(4);
    let rays = places(count).into_iter().map(|aim| {
        let mut number = || f64::from(random.between(-1.0, 1.0));
        let out = DVec3::new(number(), number(), number()).normalize();
        let aim = DVec3::from_array(model.to_world(aim));
        let origin = aim + 5.0 * out;
        Ray { origin, direction: (aim - origin).normalize() }
    });
    rays.collect()
}

/// Holds an opened model against the rules.
fn agrees(model: &SmallNgp, source: &Source) {
    let shown = renderer(source);
    let directions = [[0.0, 0.6, -0.8], [1.0, 0.0, 0.0], [-0.48, 0.64, 0.6]];
    let mut full = 0;
    for at in places(200) {
        let world = model.to_world(at);
        let (density, colors) = model.point(world, &directions);
        let found = shown.sample(world, 0).expect("a point").density;
        let off = (f64::from(found) - density).abs();
        assert!(off <= 1e-5 * density, "{found} {density}");
        full += usize::from(density > 0.0);
        let found = shown.point_colors(world, &directions, 0).expect("a point");
        for (found, color) in found.iter().flatten().zip(colors.iter().flatten()) {
            assert!((f64::from(*found) - color).abs() < 1e-5, "{found} {color}");
        }
    }
    assert!((40..180).contains(&full), "{full} of 200 points are occupied");
    let rays = rays(model, 60);
    let light = shown.ray_colors(&rays, 0, &Silent).expect("rays");
    let mut hits = 0;
    for (ray, found) in rays.iter().zip(light) {
        let (color, passes) = model.ray(ray.origin.to_array(), ray.direction.to_array());
        hits += usize::from(passes < 0.5);
        let off = (0..3).map(|c| (f64::from(found.color[c]) - color[c]).abs()).fold(0.0, f64::max);
        let left = (f64::from(found.transmittance) - passes).abs();
        assert!(off < 2e-5 && left < 2e-5, "{off} {left}: {found:?} for {color:?}");
    }
    assert!(hits > 10, "{hits} rays hit");
}

#[test]
fn snapshots_show_what_their_networks_say() {
    let model = small_ngp(DERIVED, false, CELLS, 1);
    let bytes = model.snapshot(None, false).bytes();
    for (name, bytes) in [("plain", bytes.clone()), ("zlib", zlib(&bytes)), ("gzip", gzip(&bytes))]
    {
        let source = open(bytes).expect(name);
        assert_eq!(source.family, Family::InstantNgp);
        assert!(source.assumptions.iter().any(|assumption| assumption.key == "experimental"));
        agrees(&model, &source);
    }
    // Dense levels too, and parameters of 16 bits.
    let model = small_ngp(1.4, false, CELLS, 2).halved();
    agrees(&model, &open(model.snapshot(Some(1.4), true).bytes()).expect("half"));
}

/// A checkpoint of torch-ngp as flat arrays.
fn checkpoint(model: &SmallNgp) -> SmallGrid {
    let mut offsets = vec![0];
    for level in &model.levels {
        offsets.push(offsets.last().expect("one") + level.entries() as i32);
    }
    let entries = *offsets.last().expect("one") as usize;
    let cells = [&model.occupied].into_iter().chain(&model.around).flatten();
    let cells: Vec<bool> = cells.copied().collect();
    let bits = cells
        .chunks(8)
        .map(|bits| bits.iter().rev().fold(0, |byte, full| byte << 1 | u8::from(*full)));
    let bits: Vec<u8> = bits.collect();
    let matrix =
        |rows: &Vec<Vec<f32>>| (vec![rows.len(), rows[0].len()], Values::F32(rows.concat()));
    let half = model.bound as f32;
    let mut arrays = vec![
        ("model.encoder.embeddings", vec![entries, FEATURES], Values::F32(model.table.clone())),
        ("model.encoder.offsets", vec![offsets.len()], Values::I32(offsets)),
        ("model.density_bitfield", vec![bits.len()], Values::U8(bits)),
        ("model.aabb_train", vec![6], Values::F32([[-half; 3], [half; 3]].concat())),
    ];
    let names = ["model.sigma_net.0.weight", "model.sigma_net.1.weight"];
    arrays.extend(names.into_iter().zip(&model.density).map(|(name, rows)| {
        let (shape, values) = matrix(rows);
        (name, shape, values)
    }));
    let names =
        ["model.color_net.0.weight", "model.color_net.1.weight", "model.color_net.2.weight"];
    arrays.extend(names.into_iter().zip(&model.color).map(|(name, rows)| {
        let (shape, values) = matrix(rows);
        (name, shape, values)
    }));
    SmallGrid { arrays, settings: Vec::new() }
}

/// The ratio that torch-ngp's levels have in a box from -1 to 1.
fn torch_ratio() -> f64 {
    (2048.0f64 / 16.0).powf(1.0 / 3.0)
}

#[test]
fn checkpoints_of_torch_ngp_show_what_their_networks_say() {
    let model = small_ngp(torch_ratio(), true, 128, 5);
    let source = small(&checkpoint(&model)).expect("a checkpoint");
    assert_eq!((source.family, source.scene_scale), (Family::TorchNgp, 0.33));
    agrees(&model, &source);
    let mut other = checkpoint(&model);
    other.arrays[1].2 = Values::I32(vec![0, 4920, 13112, 21304, 29488]);
    let error = small(&other).expect_err("another table");
    assert!(matches!(error.kind(), ErrorKind::Unsupported { .. }), "{error}");
}

#[test]
fn larger_scenes_of_torch_ngp_follow_its_rules() {
    for (bound, boxes) in [(2.0, 1), (3.0, 2)] {
        let model = large_torch_ngp(bound, 6);
        let source = small(&checkpoint(&model)).expect("a checkpoint");
        assert!(source.is_unbounded);
        assert_eq!(source.field.shells.len(), boxes);
        let shown = renderer(&source);
        let mut random = Random::new(8);
        let mut vector =
            |size: f32| DVec3::from_array([(); 3].map(|()| f64::from(random.between(-size, size))));
        // From within, and from beyond the scene.
        let rays: Vec<Ray> = (0..80)
            .map(|number| {
                let origin = vector(if number < 60 { 2.5 } else { 20.0 });
                Ray { origin, direction: (vector(2.5) - origin).normalize() }
            })
            .collect();
        let light = shown.ray_colors(&rays, 0, &Silent).expect("rays");
        let (mut seen, mut off_rays) = (0, 0);
        for (ray, found) in rays.iter().zip(light) {
            let (color, passes) = model.long_ray(ray.origin.to_array(), ray.direction.to_array());
            seen += usize::from((0.05..0.95).contains(&passes));
            let off = (0..3).map(|c| (f64::from(found.color[c]) - color[c]).abs());
            let off = off.fold((f64::from(found.transmittance) - passes).abs(), f64::max);
            // A sample on the face of a cell is in either.
            off_rays += usize::from(off > 2e-5);
        }
        assert!(seen > 30 && off_rays <= 1, "{seen} seen, {off_rays} differ");
        let mut short = checkpoint(&model);
        short.arrays[2].1 = vec![128 * 128 * 128 / 8];
        short.arrays[2].2 = Values::U8(vec![0; 128 * 128 * 128 / 8]);
        let error = small(&short).expect_err("cells of the first cube alone");
        assert!(matches!(error.kind(), ErrorKind::Malformed { .. }), "{error}");
    }
}

#[test]
fn nodes_hold_densities_and_fitted_colours() {
    let model = small_ngp(1.4, false, CELLS, 2);
    let options = SourceOptions { resolution: Some(33), ..SourceOptions::default() };
    let bytes = model.snapshot(Some(1.4), false).bytes();
    let source = open_with(bytes, &options, &Limits::default()).expect("a snapshot");
    assert_eq!(source.field.scene.nodes.0, [33; 3]);
    let nodes = Renderer::of_field(&source.field).expect("nodes");
    let directions = [[0.0, 0.6, -0.8], [1.0, 0.0, 0.0], [-0.48, 0.64, 0.6]];
    let (mut seen, mut error) = (0.0, 0.0);
    for node in 0..33usize.pow(3) {
        let at = [node % 33, node / 33 % 33, node / 33 / 33].map(|at| at as f64 / 32.0);
        let world = model.to_world(at.map(|at| at + 1e-7));
        let (density, colors) = model.point(world, &directions);
        if density == 0.0 || at.iter().any(|at| *at < 0.05 || *at > 0.95) {
            continue;
        }
        let found = nodes.sample(world, 0).expect("inside").density;
        let off = (f64::from(found) - density).abs();
        assert!(off <= 2e-3 * density, "{found} {density} at {at:?}");
        let found = nodes.point_colors(world, &directions, 0).expect("inside");
        for (found, color) in found.iter().flatten().zip(colors.iter().flatten()) {
            error += (f64::from(*found) - color).powi(2);
            seen += 1.0;
        }
    }
    let psnr = -10.0 * (error / seen).log10();
    eprintln!("fit of degree 2 at {} nodes: {psnr:.1} dB", seen / 9.0);
    assert!(psnr > 30.0, "{psnr}");
}

#[test]
fn a_bake_is_near_its_snapshot() {
    let model = small_ngp(1.4, false, CELLS, 2);
    let options = SourceOptions { resolution: Some(65), ..SourceOptions::default() };
    let bytes = model.snapshot(Some(1.4), false).bytes();
    let source = open_with(bytes, &options, &Limits::default()).expect("a snapshot");
    let here = folder();
    let path = here.path().join("scene.mipvog");
    let mut options = BakeOptions::default();
    (options.bits, options.levels) = (Bits::F32, Some(1));
    Baker::new(options).to_file(&source, &path, false).expect("a bake");
    let container = Container::open_path(&path, &Limits::default()).expect("a container");
    let baked = Renderer::of_container(&container).expect("a field");
    let rays = rays(&model, 500);
    let [own, seen] = [&renderer(&source), &baked]
        .map(|field| field.ray_colors(&rays, 0, &Silent).expect("rays"));
    let off = own.iter().zip(&seen).flat_map(|(own, seen)| {
        (0..3).map(|c| f64::from(own.color[c] - seen.color[c]).powi(2)).collect::<Vec<_>>()
    });
    let psnr = -10.0 * (off.sum::<f64>() / (3 * rays.len()) as f64).log10();
    eprintln!("baked at 65 nodes against unbaked: {psnr:.2} dB");
    assert!(psnr > 30.0, "{psnr}");
}

#[test]
fn a_larger_scene_is_cropped_to_the_unit_cube() {
    let model = small_ngp(1.4, false, CELLS, 2);
    let mut pack = model.snapshot(Some(1.4), false);
    pack.set(&["snapshot", "nerf", "aabb_scale"], Pack::Int(2));
    // Cells of the second cube follow, which nothing reads.
    let second = vec![0; 2 * model.occupied.len()];
    pack.append(&["snapshot", "density_grid_binary"], &second);
    let options = SourceOptions { drop_background: true, ..SourceOptions::default() };
    let source = open_with(pack.bytes(), &options, &Limits::default()).expect("its middle");
    let shown = renderer(&source);
    let own = renderer(&open(model.snapshot(Some(1.4), false).bytes()).expect("a snapshot"));
    // The table spans two cubes along an edge, around the same middle.
    for at in places(50) {
        let inner = at.map(|at| (at - 0.5) / 2.0 + 0.5);
        let [a, b] = [(&shown, at), (&own, inner)].map(|(model_of, at)| {
            model_of.point_colors(model.to_world(at), &[[0.0, 0.6, -0.8]], 0).expect("a point")
        });
        let pairs = a.iter().flatten().zip(b.iter().flatten());
        pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-4, "{a} {b}"));
    }
}

#[test]
fn the_part_that_a_snapshot_shows_is_kept() {
    let model = small_ngp(1.4, false, CELLS, 2);
    let whole = open(model.snapshot(Some(1.4), false).bytes()).expect("a snapshot");
    let cropped = |min: [f64; 3], max: [f64; 3], turn: Option<[f64; 9]>| {
        let list = |numbers: &[f64]| Pack::List(numbers.iter().map(|n| Pack::Float(*n)).collect());
        let mut pack = model.snapshot(Some(1.4), false);
        pack.set(
            &["snapshot", "render_aabb"],
            Pack::Map(vec![("min", list(&min)), ("max", list(&max))]),
        );
        if let Some(turn) = turn {
            let rows = turn.chunks(3).map(list).collect();
            pack.set(&["snapshot", "render_aabb_to_local"], Pack::List(rows));
        }
        open(pack.bytes())
    };
    let unit = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    // Along the cube's axes, which are the world's y, z and x.
    let (min, max) = ([0.45, 0.3, 0.35], [0.6, 0.7, 0.5]);
    let source = cropped(min, max, Some(unit)).expect("a part");
    assert!(source.assumptions.iter().any(|told| told.message.contains("render_aabb")));
    let sampled = source.field.scene.march.sampled.expect("a part of the box");
    let [low, high] = [min, max].map(|at| model.to_world(at));
    for axis in 0..3 {
        assert!((f64::from(sampled.min[axis]) - low[axis]).abs() < 1e-6, "{sampled:?}");
        assert!((f64::from(sampled.max[axis]) - high[axis]).abs() < 1e-6, "{sampled:?}");
    }
    let (own, all) = (renderer(&source), renderer(&whole));
    let (mut inside, mut outside) = (0, 0);
    for at in places(3000) {
        let shows = (0..3).all(|axis| (min[axis]..=max[axis]).contains(&at[axis]));
        let [own, all] = [&own, &all]
            .map(|model_of| model_of.sample(model.to_world(at), 0).expect("a point").density);
        assert_eq!(own, if shows { all } else { 0.0 }, "{at:?}");
        inside += usize::from(shows && all > 0.0);
        outside += usize::from(!shows && all > 0.0);
    }
    assert!(inside > 20 && outside > 500, "{inside} {outside}");
    // All of the cube is no part, and a turned part is told.
    let all = cropped([-1.0; 3], [2.0; 3], None).expect("all");
    assert_eq!(all.field.scene.march.sampled, None);
    let turned = [0.8, 0.6, 0.0, -0.6, 0.8, 0.0, 0.0, 0.0, 1.0];
    let turned = cropped(min, max, Some(turned)).expect("left out");
    assert_eq!(turned.field.scene.march.sampled, None);
    assert!(turned.assumptions.iter().any(|told| told.message.contains("is ignored")));
    malformed(cropped([0.6; 3], [0.4; 3], None).expect_err("nothing"), "render_aabb");
}

/// The error of a snapshot with a value changed, when all of it is read.
pub(super) fn with(path: &[&'static str], value: Pack) -> Error {
    let mut pack = small_ngp(1.4, false, CELLS, 2).snapshot(Some(1.4), false);
    pack.set(path, value);
    open(pack.bytes())
        .and_then(|source| source.renderer(None, &Limits::default()).map(drop))
        .expect_err("a lie")
}

#[test]
fn snapshots_before_versions_are_refused() {
    let mut pack = small_ngp(1.4, false, CELLS, 2).snapshot(Some(1.4), false);
    pack.remove(&["snapshot", "version"]);
    let error = open(pack.bytes()).expect_err("older");
    assert!(error.remedy().contains("Instant-NGP"), "{}", error.remedy());
    unsupported(error, "no version");
    unsupported(with(&["snapshot", "version"], Pack::Int(0)), "version 0");
    // Cells of float32, as they were before.
    let cells = CELLS.pow(3) * 4;
    malformed(
        with(&["snapshot", "density_grid_binary"], Pack::Bytes(vec![0; cells])),
        "two for each",
    );
}

#[test]
fn view_choices_are_followed() {
    let bytes = small_ngp(1.4, false, CELLS, 2).snapshot(Some(1.4), false).bytes();
    let channels = |view: ViewChoice| {
        let options = SourceOptions { view, resolution: Some(16), ..SourceOptions::default() };
        let source = open_with(bytes.clone(), &options, &Limits::default()).expect("a snapshot");
        (source.field.color_channels(), source.field.view.is_some())
    };
    assert_eq!(channels(ViewChoice::Keep), (27, true));
    assert_eq!(channels(ViewChoice::Harmonics(0)), (3, true));
    assert_eq!(channels(ViewChoice::None), (3, false));
    let options = SourceOptions { resolution: Some(16), ..SourceOptions::default() };
    let path = common::fixture("grids/plenoxels_cubic.npz");
    let error = mipvog_inputs::open_with(&path, &options, &Limits::default());
    let error = error.expect_err("it has nodes");
    assert!(error.to_string().contains("--resolution"), "{error}");
}

#[test]
fn inspection_lists_a_snapshot() {
    let bytes = zlib(&small_ngp(1.4, false, CELLS, 2).snapshot(Some(1.4), false).bytes());
    let file = Arc::new(SourceFile::decoded(bytes, Path::new("/nowhere/base.ingp")));
    let limits = Limits::default();
    let file = tensor::open_file(&file, &limits).expect("a document");
    let found = inspect_tensors(&file, &SourceOptions::default(), &limits).expect("listed");
    assert_eq!(found.model, Some(Family::InstantNgp), "{:?}", found.problem);
    assert_eq!(found.scene.expect("a scene").dimensions, [256; 3]);
    let listed = |key: &str| found.values.iter().find(|value| value.key == key);
    assert_eq!(listed("snapshot.params_binary").and_then(|v| v.dtype), Some("uint8"));
    assert!(listed("encoding.otype").is_some());
}
