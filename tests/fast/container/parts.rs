//! Parts of containers: a box, and everything but floaters.

use crate::common;
use crate::common::transcoded::{baked, changed, difference, from_afar, picture};
use crate::common::{field, open_bytes};
use mipvog::bake::{Changes, Filter};
use mipvog::base::limits::Limits;
use mipvog::model::camera::Camera;
use mipvog::model::field::{FreeSpace, Lookup, RadianceField};
use mipvog::model::grid::{Bounds, Nodes};
use mipvog::unpacked::Unpacked;
use mipvog::view::render::Renderer;

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
        let mut values = common::grid_values(&cleared.density);
        values[count[0]..count[0] + count[1]].fill(-80.0);
        cleared = field(nodes, &values, &common::grid_values(&scene.color[0]));
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
