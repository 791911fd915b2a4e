//! Nodes of a field that given cameras cover, and bakes that keep nothing else.

use crate::common;
use crate::common::plain_render::PlainField;
use crate::common::rendered::finest_level;
use crate::common::{Random, baked_bytes, field, open_bytes, packed, plain, random_field, unpack};
use glam::{DMat4, DVec3};
use mipvog::bake::{BakeOptions, Changes};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::model::baked::Group;
use mipvog::model::camera::{Camera, Lens, turntable};
use mipvog::model::field::RadianceField;
use mipvog::model::grid::CellMask;
use mipvog::view::render::{CameraCoverage, FrameOptions, Renderer, camera_coverage, render};

/// Along each axis of the scenes made here.
const NODES: [usize; 3] = [24, 20, 28];

fn coverage(field: &RadianceField, cameras: &[Camera], least: f32) -> CameraCoverage {
    let field = Renderer::trained(field, None, &Limits::default()).expect("a field");
    camera_coverage(&field, cameras, least, &Silent).expect("coverage")
}

/// A wall across the box and the same wall behind it: planes 5 to 8 and 15 to 18 along x.
fn walls() -> RadianceField {
    let count: usize = NODES.iter().product();
    let wall = |x: usize| (5..9).contains(&x) || (15..19).contains(&x);
    let density: Vec<f32> = (0..count)
        .map(|node| if wall(node / (NODES[1] * NODES[2])) { 30.0 } else { -100.0 })
        .collect();
    field(NODES, &density, &vec![1.5; 3 * count])
}

/// A camera that looks along x from `side`, -1 or 1, and sees all of the box.
fn from_side(side: f64) -> Camera {
    let lens = Lens { width: 40, height: 40, focal: [60.0; 2], center: [20.0; 2] };
    let middle = DVec3::new(0.0, 0.125, 1.5);
    Camera::looking_at(middle, DVec3::new(side, 0.0, 0.0), 7.0, "side".to_owned(), lens)
}

/// True if any cell of plane `x` is in the set.
fn any(cells: &CellMask, x: usize) -> bool {
    cells.lowest_nodes().plane(x).iter().any(|&word| word != 0)
}

#[test]
fn only_the_first_wall_is_seen() {
    let front = coverage(&walls(), &[from_side(-1.0)], 1e-3);
    assert!(any(&front.cells, 4) || any(&front.cells, 5), "the cells of the wall's surface");
    assert!((9..NODES[0]).all(|x| !any(&front.cells, x)));
    let plane = NODES[1] * NODES[2];
    let importance = |x: usize| front.importance[x * plane..(x + 1) * plane].iter().sum::<f32>();
    assert!(importance(5) > 0.0);
    assert_eq!(importance(16), 0.0);
    let back = coverage(&walls(), &[from_side(1.0)], 1e-3);
    assert!((17..19).any(|x| any(&back.cells, x)) && (0..15).all(|x| !any(&back.cells, x)));
    let both = coverage(&walls(), &[from_side(-1.0), from_side(1.0)], 1e-3);
    let mut union = front.cells;
    union.unite(&back.cells);
    assert_eq!(both.cells.count(), union.count());
    assert_eq!(both.cells.lowest_nodes().count_common(union.lowest_nodes()), union.count());
}

#[test]
fn importance_is_told_in_units_of_its_mean_and_by_weight() {
    let seen = coverage(&walls(), &[from_side(-1.0)], 1e-3);
    let some: Vec<f32> = seen.importance.iter().copied().filter(|&sum| sum > 0.0).collect();
    let mean = some.iter().map(|&sum| f64::from(sum)).sum::<f64>() / some.len() as f64;
    assert!((mean - 1.0).abs() < 1e-5, "{mean}");
    // Rays meet the surface first, and little of them is left a cell behind it.
    let at = |x: usize| seen.importance[(x * NODES[1] + 10) * NODES[2] + 14];
    assert!(at(5) > 10.0 * at(7), "{} {}", at(5), at(7));
}

#[test]
fn nothing_depends_on_threads_and_least_weights_nest() {
    let mut random = Random::new(3);
    let field = random_field(&mut random, [17, 2, 23], 4);
    let cameras = turntable(&field.scene.bounds, 5, [50, 30]);
    let runs =
        [1, 4].map(|threads| common::with_threads(threads, || coverage(&field, &cameras, 1e-2)));
    assert_eq!(runs[0].importance, runs[1].importance);
    assert_eq!(
        runs[0].cells.lowest_nodes().count_common(runs[1].cells.lowest_nodes()),
        runs[0].cells.count()
    );
    let more = coverage(&field, &cameras, 1e-4);
    assert_eq!(
        more.cells.lowest_nodes().count_common(runs[0].cells.lowest_nodes()),
        runs[0].cells.count()
    );
    assert!(more.cells.count() >= runs[0].cells.count());
}

#[test]
fn empty_fields_and_no_cameras_see_nothing() {
    let empty = field([4, 5, 6], &[-100.0; 120], &[0.0; 360]);
    let cameras = turntable(&empty.scene.bounds, 2, [20, 20]);
    for seen in [coverage(&empty, &cameras, 1e-6), coverage(&walls(), &[], 1e-6)] {
        assert_eq!(seen.cells.count(), 0);
        assert!(seen.importance.iter().all(|&sum| sum == 0.0));
    }
}

/// The importance of each node as the module says it, in float64: every point of the lattice over
/// the whole picture, every sample, no bound on the number of rays. Boxes lie in front of the
/// cameras.
fn plain_importance(field: &RadianceField, cameras: &[Camera]) -> Vec<f64> {
    let fast = Renderer::trained(field, None, &Limits::default()).expect("a field");
    let view = fast.view();
    let reference = PlainField::new(view, finest_level(field));
    let (nodes, extent) = (view.nodes.0, view.bounds.extent());
    let spacing = (0..3).map(|a| extent[a] / (nodes[a] - 1) as f64).fold(f64::INFINITY, f64::min);
    let step = f64::from(view.march.stepsize) * f64::from(view.march.voxel_size);
    let radius = (spacing.powi(2) - 0.25 * step.powi(2)).max(0.5 * spacing.powi(2)).sqrt();
    let distance = (2f64.sqrt() * radius).min(spacing);
    let mut sums = vec![0.0; nodes.iter().product()];
    for camera in cameras {
        let depth = |i: usize| {
            let [min, max] = [view.bounds.min, view.bounds.max];
            let corner =
                [0, 1, 2].map(|a| f64::from(if i >> a & 1 == 1 { max[a] } else { min[a] }));
            let from_eye = DVec3::from_array(corner) - camera.to_world.w_axis.truncate();
            -from_eye.dot(camera.to_world.z_axis.truncate())
        };
        let farthest = (0..8).map(depth).fold(0.0, f64::max);
        let focal = farthest / distance;
        let Lens { width, height, .. } = camera.lens;
        let [columns, rows] = [(width, 0), (height, 1)]
            .map(|(side, axis)| (side as f64 * focal / camera.lens.focal[axis]).ceil() as usize);
        let lens = camera.lens.resized(columns, rows);
        let camera = Camera { lens, ..camera.clone() };
        for point in 0..columns * rows {
            let at = [(point % columns) as f64 + 0.5, (point / columns) as f64 + 0.5];
            let samples = reference.weights(&camera, at);
            let total: f64 = samples.iter().map(|(_, weight)| weight).sum();
            for (position, weight) in samples {
                for (node, share) in
                    plain::shares(nodes, [0, 1, 2].map(|a| position[a] * (nodes[a] - 1) as f64))
                {
                    sums[node] += share * weight * total / (columns * rows) as f64;
                }
            }
        }
    }
    sums
}

/// Holds importance to its reference: sums of many small numbers of f32 against f64.
fn assert_as_twin(field: &RadianceField, cameras: &[Camera]) {
    let fast = coverage(field, cameras, 1e-3).importance;
    let plain = plain_importance(field, cameras);
    let total: f64 = plain.iter().sum();
    assert!(total > 0.0, "something is seen");
    // The renderer's rays end early, so the units differ: fewer nodes have any.
    let unit = fast.iter().map(|&importance| f64::from(importance)).sum::<f64>() / total;
    for (node, (fast, plain)) in fast.iter().zip(plain).enumerate() {
        let plain = plain * unit;
        let error = (f64::from(*fast) - plain).abs();
        assert!(error <= 1e-3 * plain + 1e-3, "node {node}: {fast} and not {plain}");
    }
}

/// Looks along x at the middle of the walls from `distance`, with `pixels` of focal length.
fn looking(distance: f64, focal: f64, side: usize) -> Camera {
    let center = [0.5 * side as f64; 2];
    let lens = Lens { width: side, height: side, focal: [focal; 2], center };
    let middle = DVec3::new(0.0, 0.125, 1.5);
    Camera::looking_at(middle, DVec3::new(-1.0, 0.0, 0.0), distance, "far".to_owned(), lens)
}

#[test]
fn importance_is_that_of_the_twin() {
    let mut random = Random::new(5);
    let scene = random_field(&mut random, [9, 12, 7], 3);
    assert_as_twin(&scene, &turntable(&scene.scene.bounds, 2, [30, 40]));
    // A near lens, a long one, and one for which the box is a tenth of the picture.
    assert_as_twin(&walls(), &[looking(1.02, 40.0, 40)]);
    assert_as_twin(&walls(), &[looking(60.0, 6000.0, 300)]);
    assert_as_twin(&walls(), &[looking(3.0, 15.0, 200)]);
}

#[test]
fn every_cell_of_a_surface_is_met_however_small_its_picture_is() {
    for camera in [looking(7.0, 60.0, 40), looking(20.0, 100.0, 900), looking(60.0, 6000.0, 300)] {
        let seen = coverage(&walls(), std::slice::from_ref(&camera), 1e-3);
        for y in 0..NODES[1] - 1 {
            for z in 0..NODES[2] - 1 {
                let met = (3..9).any(|x| seen.cells.contains([x, y, z]));
                // A long lens does not see the wall's ends.
                let cut = camera.lens.focal[0] > 1000.0
                    && (!(4..15).contains(&y) || !(6..20).contains(&z));
                assert!(met || cut, "({y}, {z}) from {:?}", camera.lens);
            }
        }
    }
}

#[test]
fn more_cameras_near_a_surface_do_not_make_it_less_important() {
    // A ray for each two thousandth of the picture, all of whose light is a few nodes'.
    let near = looking(1.005, 4000.0, 64);
    let cameras = vec![near; 3];
    let seen = coverage(&walls(), &cameras, 1e-3);
    let at = |y: usize, z: usize| seen.importance[(5 * NODES[1] + y) * NODES[2] + z];
    let brightest = seen.importance.iter().copied().fold(0.0, f32::max);
    let middle = (9..11).flat_map(|y| (13..15).map(move |z| at(y, z))).fold(0.0, f32::max);
    assert!(middle > 0.2 * brightest, "{middle} of {brightest}");
}

/// Fog that nowhere takes more than a few thousandths of the light over an interval.
fn fog() -> RadianceField {
    let mut random = Random::new(21);
    let count = 20 * 20 * 20;
    let density: Vec<f32> = (0..count).map(|_| random.between(-2.0, -1.0)).collect();
    let color: Vec<f32> = (0..3 * count).map(|_| random.between(1.0, 2.0)).collect();
    field([20, 20, 20], &density, &color)
}

#[test]
fn fog_has_importance_and_keeps_its_color() {
    let fog = fog();
    let cameras = turntable(&fog.scene.bounds, 40, [24, 24]);
    let seen = coverage(&fog, &cameras, 1e-3);
    assert!(seen.importance.iter().all(|&importance| importance > 0.0));
    let mut options = BakeOptions { alpha_threshold: 1e-6, ..BakeOptions::default() };
    let exact = baked_bytes(&fog, &options).expect("a bake");
    options.seen_from = cameras.clone();
    options.coarseness = 2.0;
    let coarse = baked_bytes(&fog, &options).expect("a bake");
    let moved = difference(&exact, &coarse, &cameras[0]);
    assert!(moved < 0.01, "a picture moved by {moved}");
}

/// The largest difference of two bakes' pictures from a camera.
fn difference(a: &[u8], b: &[u8], camera: &Camera) -> f32 {
    let frame = |bytes: &[u8]| {
        let baked = open_bytes(bytes).expect("valid").read().expect("levels");
        let field = Renderer::baked(&baked, &Limits::default()).expect("a field");
        render(&field, camera, &FrameOptions::default(), &Silent).expect("a frame")
    };
    let (a, b) = (frame(a), frame(b));
    let pairs = a.color.iter().flatten().zip(b.color.iter().flatten());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn bakes_keep_what_cameras_see() {
    let field = walls();
    let camera = from_side(-1.0);
    let whole = baked_bytes(&field, &BakeOptions::default()).expect("a bake");
    let options = BakeOptions {
        min_weight: Some(1e-3),
        seen_from: vec![camera.clone()],
        ..BakeOptions::default()
    };
    let pruned = baked_bytes(&field, &options).expect("a bake");
    let blocks = |bytes: &[u8]| {
        let container = open_bytes(bytes).expect("valid");
        container.metadata().levels.iter().map(|level| level.blocks_stored).collect::<Vec<_>>()
    };
    assert!(blocks(&pruned)[0] < blocks(&whole)[0]);
    // A ray meets a few samples, each of which may lose a thousandth.
    assert!(difference(&whole, &pruned, &camera) < 0.01);
    assert!(difference(&whole, &pruned, &from_side(1.0)) > 0.1, "the second wall is gone");
}

#[test]
fn cameras_that_see_nothing_are_refused() {
    let field = walls();
    let away = Camera {
        to_world: from_side(-1.0).to_world * DMat4::from_rotation_y(std::f64::consts::PI),
        ..from_side(-1.0)
    };
    let refused = |cameras: &[Camera], change: fn(&mut BakeOptions)| {
        let mut options = BakeOptions { seen_from: cameras.to_vec(), ..BakeOptions::default() };
        change(&mut options);
        baked_bytes(&field, &options).expect_err("nothing is seen").to_string()
    };
    for change in [
        |options: &mut BakeOptions| options.coarseness = 1.0,
        |options: &mut BakeOptions| options.min_weight = Some(0.1),
    ] {
        let error = refused(std::slice::from_ref(&away), change);
        assert!(error.contains("option seen_from: found 1 cameras, none of which sees"), "{error}");
        assert!(refused(&[], change).contains("option seen_from: found no cameras"));
    }
    // No sample of fog has half of a pixel.
    let options = BakeOptions {
        seen_from: turntable(&fog().scene.bounds, 2, [24, 24]),
        min_weight: Some(0.5),
        ..BakeOptions::default()
    };
    let error = baked_bytes(&fog(), &options).expect_err("nothing is left").to_string();
    assert!(error.contains("option min_weight: found 0.5, expected less"), "{error}");
    // There is nothing to lose of an empty field.
    let count = 8 * 8 * 8;
    let empty = common::field([8, 8, 8], &vec![-40.0; count], &vec![0.0; 3 * count]);
    let mut options = BakeOptions::default();
    (options.seen_from, options.coarseness) = (vec![away], 1.0);
    assert!(baked_bytes(&empty, &options).is_ok());
}

#[test]
fn floats_do_not_move() {
    for bits in ["f16", "f32"] {
        for (change, name) in [
            ((|options| options.coarseness = 1.0) as fn(&mut BakeOptions), "coarseness"),
            (|options| options.fill_error = Some(0.1), "fill_error"),
        ] {
            let mut options = BakeOptions::default().with_bits(bits.parse().expect("bits"));
            change(&mut options);
            let error = options.check().expect_err("floats").to_string();
            assert!(
                error.contains(&format!("option {name}: found a number beside {bits} bits")),
                "{error}"
            );
            options.max_bytes = Some(1000);
            assert!(options.check().is_ok());
        }
    }
}

#[test]
fn weights_out_of_range_are_refused() {
    for weight in [0.0, -1.0, 1.5, f32::NAN] {
        let options = BakeOptions { min_weight: Some(weight), ..BakeOptions::default() };
        let error = options.check().expect_err("no weight").to_string();
        assert!(error.contains("option min_weight"), "{error}");
    }
}

/// A field of noise, whose colours cost something.
fn noise() -> RadianceField {
    let mut random = Random::new(11);
    random_field(&mut random, [20, 24, 17], 5)
}

#[test]
fn coarser_colors_take_fewer_bytes_and_keep_their_stated_error() {
    let field = noise();
    let mut options = BakeOptions::default();
    let exact = open_bytes(&baked_bytes(&field, &options).expect("a bake")).expect("valid");
    options.seen_from = turntable(&field.scene.bounds, 3, [60, 60]);
    options.coarseness = 4.0;
    let bytes = baked_bytes(&field, &options).expect("a bake");
    let coarse = open_bytes(&bytes).expect("valid");
    assert!(coarse.header().file_length < exact.header().file_length);
    let [finest, unchanged] = [&coarse, &exact].map(|container| &container.metadata().levels[0]);
    assert_eq!(finest.density, unchanged.density);
    let bound = f64::from(finest.diffuse.as_ref().expect("colours").max_error);
    assert!(bound > f64::from(unchanged.diffuse.as_ref().expect("colours").max_error));
    let [got, want] = [&coarse, &exact].map(|container| {
        let unpacked = unpack(container).expect("unpacks");
        (unpacked.level(0, Group::Density), unpacked.level(0, Group::Diffuse))
    });
    // Visible nodes; the others hold the cheapest values.
    let count = got.0.len();
    let opaque: Vec<usize> = (0..count).filter(|&node| want.0[node] > 0.0).collect();
    assert!(!opaque.is_empty());
    let mut moved = 0;
    for node in opaque.iter().flat_map(|&node| (0..3).map(move |channel| channel * count + node)) {
        let error =
            (plain::sigmoid(got.1[node].into()) - plain::sigmoid(want.1[node].into())).abs();
        assert!(error <= bound, "{error} is more than {bound}");
        moved += usize::from(error > 0.0);
    }
    assert!(moved > opaque.len() / 10, "{moved} of {}", opaque.len());
}

#[test]
fn what_was_coarsened_bakes_again_to_the_same_bytes() {
    let mut options = BakeOptions::default();
    let field = noise();
    options.seen_from = turntable(&field.scene.bounds, 2, [40, 40]);
    (options.coarseness, options.min_weight) = (2.0, Some(1e-3));
    let bytes = [1, 3].map(|threads| {
        common::with_threads(threads, || baked_bytes(&field, &options).expect("a bake"))
    });
    assert_eq!(bytes[0], bytes[1]);
    let unpacked = unpack(&open_bytes(&bytes[0]).expect("valid")).expect("unpacks");
    let unpacked =
        mipvog_inputs::unpacked::open(unpacked.file(), &Limits::default()).expect("unpacked");
    assert_eq!(packed(&unpacked, &Changes::default()).expect("bakes again"), bytes[0]);
}
