//! Containers to other containers, without the checkpoint.

mod common;

use common::{baked_bytes, field, open_bytes, trained, unpack};
use mipvog_bake::unstable::bake::{BakeOptions, Changes, Filter, MaxErrors, repack};
use mipvog_bake::unstable::base::bytes::{ByteSink, WriterSink};
use mipvog_bake::unstable::base::error::{ErrorKind, Result};
use mipvog_bake::unstable::base::limits::Limits;
use mipvog_bake::unstable::base::progress::Silent;
use mipvog_bake::unstable::codec::container::Container;
use mipvog_bake::unstable::codec::quantize::Bits;
use mipvog_bake::unstable::codec::unpack::Unpacked;
use mipvog_bake::unstable::model::baked::{
    FootprintNeighbour, Group, LevelMetadata, Metadata, StepRule,
};
use mipvog_bake::unstable::model::camera::Camera;
use mipvog_bake::unstable::model::field::{FreeSpace, Lookup, RadianceField};
use mipvog_bake::unstable::model::grid::{Bounds, Nodes};
use mipvog_bake::unstable::view::render::{Frame, Renderer};

/// A container with these changes.
fn changed(container: &Container, changes: &Changes) -> Result<Container> {
    open_bytes(&changed_bytes(container, changes)?)
}

fn changed_bytes(container: &Container, changes: &Changes) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut sink = WriterSink::new(&mut bytes);
    let unpacked = Unpacked::of_container(container)?;
    let report = repack(&unpacked, changes, &Limits::default(), &mut sink, &Silent)?;
    assert_eq!(report.output_bytes, sink.length());
    Ok(bytes)
}

fn baked(field: &RadianceField, change: impl FnOnce(&mut BakeOptions)) -> Container {
    let mut options = BakeOptions::default();
    change(&mut options);
    open_bytes(&baked_bytes(field, &options).expect("a bake")).expect("valid")
}

fn picture(container: &Container, camera: &Camera) -> Frame {
    Renderer::of_container(container).expect("renders").picture(camera).expect("a picture")
}

/// The largest difference of two pictures, in colour or in light.
fn difference(a: &Frame, b: &Frame) -> f32 {
    let colors = a.color.iter().flatten().zip(b.color.iter().flatten());
    let light = a.transmittance.iter().zip(&b.transmittance);
    colors.chain(light).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// A camera far from a box, whose pixels have a footprint of `rho` voxels or more.
fn from_afar(metadata: &Metadata, rho: f64) -> Camera {
    let (bounds, extent) = (&metadata.bounds, metadata.bounds.extent());
    let middle = [0, 1, 2].map(|axis| f64::from(bounds.min[axis]) + extent[axis] / 2.0);
    let away = 100.0 * extent.into_iter().fold(0.0, f64::max);
    let eye = [middle[0] + 0.6 * away, middle[1] - 0.7 * away, middle[2] + 0.4 * away];
    let mut camera = Camera::look_at(eye, middle, 40.0, [24; 2]).expect("a camera");
    let voxels = [0, 1, 2].map(|axis| extent[axis] / metadata.levels[0].dimensions[axis] as f64);
    camera.lens.focal = [away / (rho * voxels.into_iter().fold(0.0, f64::max)); 2];
    camera
}

#[test]
fn a_container_packs_as_the_file_it_unpacks_to() {
    let scene = trained("tiny/fine_last.tar");
    let errors = Changes { max_error: Some(0.03.into()), ..Changes::default() };
    let fewer = Changes { levels: Some(2), without_finest: 1, ..Changes::default() };
    let bits = Changes { bits: Some(Bits::Integer(5)), ..Changes::default() };
    let small = Changes { max_bytes: Some(7000), ..Changes::default() };
    let part = Changes {
        crop: Some(Bounds { min: [-9.0, -9.0, -9.0], max: [9.0, 9.0, 0.1] }),
        drop_islands: Some(20),
        ..Changes::default()
    };
    for filled in [None, Some(0.08)] {
        let container = baked(&scene, |options| {
            (options.fill_error, options.block_size) = (filled, 4);
        });
        let unpacked = unpack(&container).expect("unpacks");
        let file = Unpacked::open(unpacked.file(), &Limits::default()).expect("an input");
        let direct = Unpacked::of_container(&container).expect("decodes");
        assert_eq!(direct.digest, file.digest);
        for changes in [&Changes::default(), &errors, &fewer, &bits, &small, &part] {
            let again = common::packed(&file, changes).expect("packs");
            assert!(again == common::packed(&direct, changes).expect("packs"), "{changes:?}");
        }
        // Without changes it is the same container, and level 0 is the same field.
        let again = changed(&container, &Changes::default()).expect("packs");
        assert_eq!(again.read().expect("valid").levels, container.read().expect("valid").levels);
        let [a, b] = [&file, &direct].map(|input| {
            let field = input.field().expect("readable").expect("densities");
            baked_bytes(&field, &BakeOptions::default()).expect("a bake")
        });
        assert!(a == b);
    }
}

#[test]
fn pictures_from_afar_stay_without_the_finest_levels() {
    let scene = trained("lego64/fine_last.tar");
    // Footprints that read no level finer than the first one that stays.
    let cases = [
        (Filter::RateTent, 1, 6.0),
        (Filter::RateTent, 2, 20.0),
        (Filter::Fit, 1, 8.0),
        (Filter::Paper, 1, 9.0),
    ];
    for (filter, count, rho) in cases {
        for bits in [Bits::Integer(8), Bits::Integer(12), Bits::F16, Bits::F32] {
            let container = baked(&scene, |options| {
                (options.filter, options.bits, options.fit_steps) = (filter.into(), bits, 0);
            });
            let changes = Changes { without_finest: count, ..Changes::default() };
            let fewer = changed(&container, &changes).expect("represented");
            let (before, after) = (container.metadata(), fewer.metadata());
            assert_eq!(after.levels.len(), before.levels.len() - count);
            for (after, before) in after.levels.iter().zip(&before.levels[count..]) {
                assert_eq!(after.dimensions, before.dimensions);
                assert_eq!(after.blocks_stored, before.blocks_stored);
            }
            let camera = from_afar(before, rho);
            let (old, new) = (picture(&container, &camera), picture(&fewer, &camera));
            let seen: Vec<usize> = (0..24 * 24).filter(|&i| old.transmittance[i] < 0.9).collect();
            assert!(!seen.is_empty());
            let margin = count as f32 + 0.05;
            let level = |i: usize| old.level[i] / (1.0 - old.transmittance[i]);
            assert!(seen.iter().all(|&i| level(i) > margin), "{filter:?} {count}");
            // Half floats of scaled values are others.
            let most = if bits == Bits::F16 { 1e-3 } else { 2e-5 };
            let moved = difference(&old, &new);
            assert!(moved <= most, "{filter:?} {bits} {count}: {moved}");
        }
    }
}

#[test]
fn rules_follow_the_levels_that_are_dropped() {
    let scene = trained("lego64/fine_last.tar");
    for filter in [Filter::RateTent, Filter::Paper] {
        let container = baked(&scene, |options| options.filter = filter.into());
        let changes = Changes { without_finest: 2, ..Changes::default() };
        let fewer = changed(&container, &changes).expect("represented");
        let (before, after) = (container.metadata(), fewer.metadata());
        assert_eq!(after.march.voxel_size, 4.0 * before.march.voxel_size);
        let step = |metadata: &Metadata| metadata.march.stepsize * metadata.march.voxel_size;
        let times = if before.step_rule == StepRule::LevelOfDetail { 4.0 } else { 1.0 };
        assert_eq!(step(after), times * step(before));
        assert_eq!(after.activation.interval, times * before.activation.interval);
        assert_eq!(after.alpha_threshold, before.alpha_threshold);
        let (old, new) = (before.level_of_detail, after.level_of_detail);
        assert_eq!((old.factor, old.neighbour), (new.factor, new.neighbour));
        assert_eq!(new.neighbour, FootprintNeighbour::SameDistance);
        // 64 nodes became 16.
        assert!((new.bias - (old.bias - 2.0 + 2.0 * old.factor)).abs() < 1e-6);
        for (after, before) in after.levels.iter().zip(&before.levels[2..]) {
            let error = |level: &LevelMetadata| level.density.as_ref().expect("density").max_error;
            assert!(error(after) >= times * error(before) && error(after) < 1.0);
        }
        // The file is one like any other: it unpacks, packs and loses levels again.
        let unpacked = unpack(&fewer).expect("unpacks");
        let file = Unpacked::open(unpacked.file(), &Limits::default()).expect("an input");
        let again = open_bytes(&common::packed(&file, &Changes::default()).expect("packs"));
        let again = again.expect("valid").read().expect("valid").levels;
        assert_eq!(again, fewer.read().expect("valid").levels);
        let once = Changes { without_finest: 1, ..Changes::default() };
        let twice = changed(&changed(&container, &once).expect("one"), &once).expect("two");
        assert_eq!(twice.read().expect("valid").levels, fewer.read().expect("valid").levels);
        // Level 0 holds no logits any more where alpha was averaged.
        let field = Unpacked::of_container(&fewer).expect("decodes").field();
        assert_eq!(field.is_err(), filter == Filter::RateTent);
    }
}

#[test]
fn levels_that_cannot_go_are_refused() {
    let scene = trained("lego64/fine_last.tar");
    let flat = field([32, 32, 2], &[10.0; 2048], &[0.0; 3 * 2048]);
    let refused = |scene: &RadianceField, filter: Filter, count: usize, words: &str| {
        let container = baked(scene, |options| options.filter = filter.into());
        let changes = Changes { without_finest: count, ..Changes::default() };
        let error = changed(&container, &changes).expect_err("refused");
        assert!(matches!(error.kind(), ErrorKind::InvalidOption { .. }), "{error}");
        assert!(error.to_string().contains(words), "{error}");
    };
    refused(&scene, Filter::RateTent, 5, "at most 4");
    refused(&scene, Filter::Code, 1, "density from level 0");
    refused(&scene, Filter::Coverage, 1, "opacity over one interval");
    refused(&flat, Filter::Paper, 1, "axes shrink by different shares");
}

#[test]
fn the_best_that_fits_is_found_and_always_the_same() {
    let scene = trained("lego64/fine_last.tar");
    let container = baked(&scene, |_| {});
    let whole = container.file().length();
    let with = |max_bytes| Changes { max_bytes: Some(max_bytes), ..Changes::default() };
    // It fits as it is.
    let same = changed(&container, &with(whole)).expect("fits");
    assert_eq!(same.read().expect("valid").levels, container.read().expect("valid").levels);
    for (share, levels) in [(0.9, 5), (0.6, 5), (0.1, 4)] {
        let most = (whole as f64 * share) as u64;
        let bytes = changed_bytes(&container, &with(most)).expect("fits");
        assert!(bytes.len() as u64 <= most && bytes.len() as f64 > 0.85 * most as f64, "{share}");
        let again = common::with_threads(3, || changed_bytes(&container, &with(most)));
        assert!(bytes == again.expect("fits"));
        assert_eq!(open_bytes(&bytes).expect("valid").metadata().levels.len(), levels);
        // A bake finds its own, from the trained values.
        let own = baked(&scene, |options| options.max_bytes = Some(most));
        assert!(own.file().length() <= most && own.metadata().levels.len() == levels);
    }
    let error = changed(&container, &with(500)).expect_err("too little");
    assert!(error.to_string().contains("option max_bytes: found 500"), "{error}");
    let mut options = BakeOptions::default();
    options.max_bytes = Some(500);
    let error = baked_bytes(&scene, &options).expect_err("too little");
    assert!(error.to_string().contains("the smallest container"), "{error}");
}

#[test]
fn errors_add_up() {
    let scene = trained("tiny/fine_last.tar");
    let exact = baked(&scene, |options| options.bits = Bits::F32);
    let coarse = baked(&scene, |options| options.bits = Bits::Integer(6));
    let errors = MaxErrors::from(0.1);
    let asked = [
        Changes { bits: Some(Bits::F32), ..Changes::default() },
        Changes { bits: Some(Bits::Integer(4)), ..Changes::default() },
        Changes { max_error: Some(errors), ..Changes::default() },
    ];
    for changes in asked {
        let twice = changed(&coarse, &changes).expect("packs");
        let [got, want] = [&twice, &exact].map(|container| unpack(container).expect("unpacks"));
        let activation = scene.scene.activation;
        for (number, level) in twice.metadata().levels.iter().enumerate() {
            let old = &coarse.metadata().levels[number];
            let stored = want.occupied(number, level.dimensions, level.block_size);
            for group in Group::ALL {
                let Some(encoding) = level.encoding(group) else { continue };
                let before = old.encoding(group).expect("the same groups");
                assert!(encoding.max_error >= before.max_error, "{group:?}");
                let [got, want] = [&got, &want].map(|all| all.level(number, group));
                for (node, (got, want)) in got.into_iter().zip(want).enumerate() {
                    let [got, want] = [got, want]
                        .map(|value| encoding.decode.activated(value.into(), &activation));
                    // Nodes that are kept exactly but not needed hold anything in the coarse one.
                    let counts = stored[node % stored.len()] && group == Group::Density;
                    let visible = got.max(want) > 1e-3;
                    let bound = f64::from(encoding.max_error);
                    assert!(!(counts && visible) || (got - want).abs() <= bound, "{group:?}");
                }
            }
        }
    }
}

/// Two bodies in a box of [-1, 1] x [-0.5, 0.75] x [0, 3], apart along z, and a speck between.
fn two_bodies() -> RadianceField {
    let nodes = [24, 20, 48];
    let (mut density, mut color) = (Vec::new(), Vec::new());
    for [x, y, z] in common::plain::all_nodes(nodes) {
        let is_body = (8..16).contains(&x) && (6..14).contains(&y);
        let bodies = is_body && ((4..14).contains(&z) || (34..44).contains(&z));
        let speck = [x, y] == [4, 4] && (23..25).contains(&z);
        density.push(if bodies || speck { 12.0 } else { -80.0 });
        color.push(z as f32 / 12.0 - 2.0);
    }
    field(nodes, &density, &[color.clone(), color.clone(), color].concat())
}

/// A mask that is inside just where `z` is below `top`, of another shape than a crop's.
fn below(top: f64) -> FreeSpace {
    let nodes = Nodes([11, 11, 4]);
    let inside = common::plain::all_nodes(nodes.0).map(|[.., z]| z < 2).collect();
    let (scale, shift) = ([1.0, 1.0, 0.5], [5.0, 5.0, 1.5 - top / 2.0]);
    FreeSpace { nodes, scale, shift, lookup: Lookup::Nearest(inside) }
}

#[test]
fn a_crop_keeps_what_is_inside_and_nothing_else() {
    for filter in [Filter::RateTent, Filter::Code, Filter::Paper] {
        let container = baked(&two_bodies(), |options| {
            (options.filter, options.block_size) = (filter.into(), 4);
        });
        let metadata = container.metadata();
        // Node 16 of level 0 along z, and a little below it.
        let top = 3.0 * 16.0 / 47.0;
        let crop = Bounds { min: [-9.0, -9.0, -9.0], max: [9.0, 9.0, top - 0.01] };
        let part = changed(&container, &Changes { crop: Some(crop), ..Changes::default() });
        let part = part.expect("cropped");
        assert!(part.file().length() < container.file().length());
        assert_eq!(part.metadata().bounds, metadata.bounds);
        for (after, before) in part.metadata().levels.iter().zip(&metadata.levels) {
            assert_eq!(after.dimensions, before.dimensions);
            assert!(after.blocks_stored <= before.blocks_stored);
        }
        // The same as a cut of all samples, near and far.
        let mut masked = container.read().expect("valid");
        (masked.metadata.free_space, masked.free_space) = (true, Some(below(top.into())));
        let masked = Renderer::baked(&masked, &Limits::default()).expect("renders");
        for rho in [0.7, 2.0, 6.0] {
            let camera = from_afar(metadata, rho);
            let (got, want) = (picture(&part, &camera), masked.picture(&camera).expect("renders"));
            // Averaged logits are empty from afar.
            let shows = want.transmittance.iter().any(|&light| light < 0.9);
            assert!(shows || (filter, rho) == (Filter::Paper, 6.0), "{filter:?} {rho}");
            assert_eq!(difference(&got, &want), 0.0, "{filter:?} {rho}");
        }
        // A view of the body inside alone is what it was; one of the other shows background.
        let look = |z: f64| Camera::look_at([-9.0, 0.1, z], [0.0, 0.1, z], 3.0, [16; 2]);
        let inside = look(0.57).expect("a camera");
        let (old, new) = (picture(&container, &inside), picture(&part, &inside));
        assert!(old.transmittance.iter().any(|&light| light < 0.1));
        assert_eq!(difference(&old, &new), 0.0);
        let outside = picture(&part, &look(2.45).expect("a camera"));
        assert!(outside.transmittance.iter().all(|&light| light == 1.0));
    }
}

#[test]
fn a_crop_of_a_masked_scene_keeps_both() {
    let container = baked(&two_bodies(), |options| options.block_size = 4);
    for nearest in [true, false] {
        let nodes = Nodes([9, 9, 25]);
        let inside = common::plain::all_nodes(nodes.0).map(|[x, ..]| x < 6);
        let lookup = match nearest {
            true => Lookup::Nearest(inside.collect()),
            false => Lookup::Trilinear { values: inside.map(f32::from).collect(), threshold: 0.5 },
        };
        let mask = FreeSpace { nodes, scale: [4.0, 6.4, 8.0], shift: [4.0, 3.2, 0.0], lookup };
        let mut unpacked = Unpacked::of_container(&container).expect("decodes");
        (unpacked.metadata.free_space, unpacked.free_space) = (true, Some(mask.clone()));
        let whole = common::packed(&unpacked, &Changes::default()).expect("packs");
        let whole = open_bytes(&whole).expect("valid");
        let crop = Bounds { min: [-9.0, -9.0, -9.0], max: [9.0, 9.0, 1.0] };
        let part = changed(&whole, &Changes { crop: Some(crop), ..Changes::default() });
        let cut = part.expect("cropped").read().expect("valid").free_space.expect("a mask");
        for step in 0..4000 {
            let at = [step % 7, step / 7 % 13, step / 91].map(|i| f64::from(i) / 13.37);
            let world = [at[0] * 3.6 - 1.0, at[1] * 1.2 - 0.5, at[2]];
            match world[2] {
                ..1.0 => assert_eq!(cut.contains(world), mask.contains(world), "{world:?}"),
                // Widened to a node of level 0, and then to one of the mask.
                1.26.. => assert!(!cut.contains(world), "{world:?}"),
                _ => {}
            }
        }
    }
}

#[test]
fn boxes_that_are_none_are_refused() {
    let container = baked(&two_bodies(), |_| {});
    let boxes = [
        ([0.0, 0.0, 1.0], [0.5, 0.5, 1.0]),
        ([0.5, 0.0, 0.0], [-0.5, 0.5, 1.0]),
        ([2.0, 0.0, 0.0], [3.0, 0.5, 1.0]),
        ([0.0, 0.0, f32::NAN], [0.5, 0.5, 1.0]),
    ];
    for (min, max) in boxes {
        let crop = Some(Bounds { min, max });
        let error = changed(&container, &Changes { crop, ..Changes::default() });
        let error = error.expect_err("refused").to_string();
        assert!(error.contains("option crop") && error.contains("that meets"), "{error}");
    }
    // All of the box is no change.
    let Bounds { min, max } = container.metadata().bounds;
    let all = Changes { crop: Some(Bounds { min, max }), ..Changes::default() };
    let same = changed(&container, &all).expect("packs");
    assert_eq!(same.read().expect("valid"), container.read().expect("valid"));
}

#[test]
fn islands_go_at_every_level() {
    let scene = two_bodies();
    for filter in [Filter::RateTent, Filter::Paper] {
        let with = |scene: &RadianceField| {
            baked(scene, |options| {
                (options.filter, options.block_size, options.levels) = (filter.into(), 4, Some(3));
            })
        };
        let container = with(&scene);
        let mut cleared = two_bodies();
        let [nodes, count] = [[24usize, 20, 48], [4 * 20 * 48 + 4 * 48 + 23, 2, 0]];
        let mut values = common::volume_values(&cleared.density);
        values[count[0]..count[0] + count[1]].fill(-80.0);
        cleared = field(nodes, &values, &common::volume_values(&scene.color[0]));
        let without = with(&cleared);
        let drop = |fewest| {
            let changes = Changes { drop_islands: Some(fewest), ..Changes::default() };
            changed(&container, &changes).expect("packs")
        };
        let kept = drop(2).read().expect("valid").levels;
        assert_eq!(kept, container.read().expect("valid").levels, "two nodes are not fewer than 2");
        let gone = drop(3);
        // The blocks that a bake without the speck would store.
        for (after, want) in gone.metadata().levels.iter().zip(&without.metadata().levels) {
            assert_eq!(after.blocks_stored, want.blocks_stored, "{filter:?}");
        }
        let look = |z: f64| Camera::look_at([-9.0, 0.1, z], [0.0, 0.1, z], 3.0, [16; 2]);
        let body = look(0.57).expect("a camera");
        assert_eq!(difference(&picture(&gone, &body), &picture(&container, &body)), 0.0);
        for rho in [0.7, 2.5, 6.0] {
            let camera = from_afar(container.metadata(), rho);
            let moved = difference(&picture(&gone, &camera), &picture(&without, &camera));
            assert!(moved < 0.02, "{filter:?} {rho}: {moved}");
        }
        let all = drop(u64::MAX);
        assert!(all.metadata().levels.iter().all(|level| level.blocks_stored == 0));
    }
}

#[cfg(feature = "cli")]
mod cli {
    use std::path::Path;

    use common::{assert_schema, fixture, folder, program};
    use serde_json::Value;

    use super::*;

    fn run(here: &Path, arguments: &[&str]) -> std::process::Output {
        program().current_dir(here).args(arguments).output().expect("starts")
    }

    fn report(here: &Path, arguments: &[&str]) -> Value {
        let output = run(here, &[arguments, &["--format", "json"]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let report: Value = serde_json::from_slice(&output.stdout).expect("a report");
        assert_schema(arguments[0], &report);
        report
    }

    #[test]
    fn the_program_bakes_its_own_files() {
        let folder = folder();
        let here = folder.path();
        let scene = fixture("trained/tiny/fine_last.tar").display().to_string();
        report(here, &["bake", &scene, "-o", "a.mipvog", "--gltf", "a.glb"]);
        report(here, &["unpack", "a.mipvog", "-o", "a.safetensors"]);
        let read = |name: &str| std::fs::read(here.join(name)).expect("a container");
        let options: [&[&str]; 6] = [
            &[],
            &["--bits", "6"],
            &["--preset", "web"],
            &["--filter", "paper", "--near", "0.25"],
            &["--block-size", "4", "--max-error", "0.05"],
            &["--levels", "2", "--background", "0", "--lod-scale", "2"],
        ];
        for options in options {
            for (input, output) in [("a.safetensors", "b"), ("a.mipvog", "c"), ("a.glb", "d")] {
                let bake = ["bake", input, "-o", output, "--force"];
                report(here, &[&bake[..], options].concat());
            }
            assert!(read("b") == read("c") && read("b") == read("d"), "{options:?}");
        }
        for ignored in [["--stepsize", "0.5"], ["--memory", "1G"], ["--turntable", "2"]] {
            let refused = run(here, &[&["bake", "a.mipvog", "-o", "x"][..], &ignored].concat());
            assert_eq!(refused.status.code(), Some(2), "{ignored:?}");
        }
        assert!(!here.join("x").exists());
    }

    #[test]
    fn transcoding_reports_as_a_bake_does() {
        let folder = folder();
        let here = folder.path();
        let scene = fixture("trained/lego64/fine_last.tar").display().to_string();
        let bake = ["bake", &scene, "--stepsize", "0.5", "-o", "a.mipvog"];
        let whole = report(here, &bake)["output_bytes"].as_u64().expect("bytes");
        let transcode = |more: &[&str]| {
            let verb = ["transcode", "a.mipvog", "-o", "b.mipvog", "--force"];
            report(here, &[&verb[..], more].concat())
        };
        let small = transcode(&["--max-bytes", "0.1MB"]);
        assert!(small["output_bytes"].as_u64() <= Some(100_000));
        assert_eq!(small["chosen"]["without_finest"], 1);
        assert_eq!(small["chosen"]["bytes"], small["output_bytes"]);
        assert_eq!(small["options"]["max_bytes"], 100_000);
        let part = transcode(&["--crop=-1,-1,-1,1,1,0.2", "--drop-islands", "50"]);
        assert!(part["output_bytes"].as_u64() < Some(whole));
        assert!(part["islands"]["dropped"].as_u64() > Some(0));
        let fewer = transcode(&["--without-finest", "1", "--levels", "2", "--bits", "6"]);
        assert_eq!(fewer["levels"].as_array().expect("levels").len(), 2);
        assert_eq!(fewer["levels"][0]["dimensions"], serde_json::json!([32, 32, 32]));
        assert_eq!(report(here, &["validate", "b.mipvog"])["valid"], true);
        // An output that is there stays; a checkpoint is no container.
        let taken = run(here, &["transcode", "a.mipvog", "-o", "b.mipvog"]);
        assert!(!taken.status.success());
        let other = run(here, &["transcode", &scene, "-o", "c.mipvog"]);
        assert_eq!(other.status.code(), Some(3));
        for wrong in [&["--crop", "1,2,3"][..], &["--levels", "0"], &["--max-bytes", "many"]] {
            let verb = ["transcode", "a.mipvog", "-o", "c.mipvog"];
            let refused = run(here, &[&verb[..], wrong].concat());
            assert_eq!(refused.status.code(), Some(2), "{wrong:?}");
        }
        assert!(!here.join("c.mipvog").exists());
    }
}
