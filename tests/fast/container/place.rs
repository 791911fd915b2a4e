//! Containers that are rotated, scaled and moved: cameras that move along see the same pictures.

use glam::{DMat4, DVec3};

use crate::common::harmonic_field::{harmonic_field, rules};
use crate::common::transcoded::{baked, changed, changed_bytes, difference, picture};
use crate::common::world::world;
use crate::common::{Random, random_field, trained, unpack};
use mipvog::bake::{Changes, Placement};
use mipvog::base::limits::Limits;
use mipvog::container::Container;
use mipvog::model::baked::Group;
use mipvog::model::camera::{Camera, turntable};
use mipvog::model::field::{FreeSpace, Lookup};
use mipvog::model::grid::Nodes;
use mipvog::quantize::Bits;
use mipvog::unpacked::Unpacked;

fn placed(placement: Placement) -> Changes {
    Changes { placement, ..Changes::default() }
}

/// A camera that is moved as the container is.
fn along(camera: &Camera, placement: &Placement) -> Camera {
    let rotation = placement.rotation();
    let turned =
        |vector: glam::DVec4| DVec3::from_array(rotation.vector(vector.truncate().to_array()));
    let [x, y, z] = [0, 1, 2].map(|axis| turned(camera.to_world.col(axis)).extend(0.0));
    let translate = placement.translate.map(f64::from);
    let eye = f64::from(placement.scale) * turned(camera.to_world.w_axis);
    let eye = (eye + DVec3::from_array(translate)).extend(1.0);
    Camera { to_world: DMat4::from_cols(x, y, z, eye), ..camera.clone() }
}

/// The largest difference of a placed container's pictures, from cameras that moved along.
fn moved_by(container: &Container, placement: Placement, cameras: &[Camera]) -> f32 {
    let moved = changed(container, &placed(placement)).expect("placed");
    let difference = |camera: &Camera| {
        difference(&picture(container, camera), &picture(&moved, &along(camera, &placement)))
    };
    cameras.iter().map(difference).fold(0.0, f32::max)
}

/// Cameras around a container, of which half see coarser levels.
fn around(container: &Container) -> Vec<Camera> {
    let bounds = container.metadata().bounds;
    [turntable(&bounds, 2, [96; 2]), turntable(&bounds, 2, [24; 2])].concat()
}

const TURNS: [[i32; 3]; 5] = [[1, 0, 0], [0, -1, 0], [0, 0, 1], [2, 0, 0], [1, 2, -1]];

#[test]
fn scaled_and_moved_scenes_look_the_same() {
    let scenes = ["tiny/fine_last.tar", "lego64/fine_last.tar"];
    for scene in scenes.map(trained) {
        let container = baked(&scene, |_| {});
        let cameras = around(&container);
        for (scale, translate) in
            [(1.0, [3.0, -0.7, 20.0]), (0.1, [0.0; 3]), (7.3, [-4.0, 0.3, 1.0])]
        {
            let placement = Placement { scale, translate, ..Placement::default() };
            let found = moved_by(&container, placement, &cameras);
            assert!(found < 2e-3, "{scale} {translate:?}: {found}");
        }
    }
}

#[test]
fn values_stay_codes_where_no_direction_is_stored() {
    let container = baked(&trained("tiny/fine_last.tar"), |options| {
        options.filter = mipvog::bake::Filter::Paper.into();
        options.levels = Some(1);
    });
    let before = container.read().expect("valid");
    for turns in TURNS {
        let placement = Placement { quarter_turns: turns, ..Placement::default() };
        let moved = changed(&container, &placed(placement)).expect("placed");
        let (own, old) = (&moved.metadata().levels[0], &before.metadata.levels[0]);
        let encodings = |level: &mipvog::model::baked::LevelMetadata| {
            Group::ALL.map(|group| level.encoding(group).cloned())
        };
        assert_eq!(encodings(own), encodings(old), "{turns:?}");
        // Every node that counted has the value that it had.
        let [was, is] = [&container, &moved].map(|container| unpack(container).expect("arrays"));
        let (was, is) = (was.level(0, Group::Density), is.level(0, Group::Density));
        let counted = &Unpacked::of_container(&container).expect("codes").levels[0];
        let counted = counted.counted_nodes().expect("nodes");
        let sizes = own.dimensions;
        for (at, value) in is.iter().enumerate() {
            let node = [at / (sizes[1] * sizes[2]), at / sizes[2] % sizes[1], at % sizes[2]];
            let [x, y, z] = placement.rotation().source(sizes, node);
            if counted.contains([x, y, z]) {
                let [_, ny, nz] = old.dimensions;
                assert_eq!(*value, was[(x * ny + y) * nz + z], "{turns:?} {node:?}");
            }
        }
    }
}

#[test]
fn networks_and_directional_levels_turn_with_the_field() {
    // A network, and coarser levels that look different from each side.
    let container = baked(&trained("lego64/fine_last.tar"), |_| {});
    assert!(container.metadata().has_directional() && container.metadata().view.is_some());
    let cameras = around(&container);
    for turns in TURNS {
        let placement = Placement { quarter_turns: turns, ..Placement::default() };
        let found = moved_by(&container, placement, &cameras);
        // Directional values are stored anew with 8 bits.
        assert!(found < 0.03, "{turns:?}: {found}");
        // The stated errors are those of both.
        let moved = changed(&container, &placed(placement)).expect("placed");
        let errors = |container: &Container| {
            let level = &container.metadata().levels[1];
            [Group::Directional, Group::Anisotropy]
                .map(|group| level.encoding(group).expect("directional").max_error)
        };
        let (before, after) = (errors(&container), errors(&moved));
        assert!((0..2).all(|i| before[i] < after[i] && after[i] < 3.0 * before[i]), "{turns:?}");
    }
}

#[test]
fn harmonics_turn_with_the_field() {
    for degree in 1..=3 {
        let field = harmonic_field([20, 24, 17], rules(degree));
        let container = baked(&field, |options| {
            (options.bits, options.levels) = (Bits::F32, Some(1));
        });
        let cameras = around(&container);
        for turns in TURNS {
            let placement = Placement { quarter_turns: turns, ..Placement::default() };
            let found = moved_by(&container, placement, &cameras);
            assert!(found < 1e-3, "{degree} {turns:?}: {found}");
        }
    }
}

#[test]
fn worlds_and_masks_turn_and_move() {
    let container = baked(&world(33, 2), |_| {});
    let inside = [[1.0, 0.2, 0.0], [-0.7, 0.7, 0.2], [0.1, -1.0, -0.2]]
        .map(|to| Camera::look_at([0.1, -0.2, 0.1], to, 60.0, [48; 2]).expect("a camera"));
    let mut random = Random::new(5);
    let nodes = Nodes([5, 3, 4]);
    let inside_mask = (0..nodes.count()).map(|_| random.below(4) > 0).collect();
    let values = (0..nodes.count()).map(|_| random.between(-1.0, 1.0)).collect();
    let lookups = [Lookup::Nearest(inside_mask), Lookup::Trilinear { values, threshold: -0.4 }];
    let masked = lookups.map(|lookup| {
        let field = random_field(&mut random, [9, 12, 10], 3);
        let bounds = field.scene.bounds;
        let scale = [0, 1, 2].map(|a| (nodes.0[a] - 1) as f64 / bounds.extent()[a]);
        let shift = [0, 1, 2].map(|a| -f64::from(bounds.min[a]) * scale[a] + 0.013);
        let mask = FreeSpace { nodes, scale, shift, lookup };
        baked(&crate::common::masked(field, mask), |options| {
            (options.bits, options.levels) = (Bits::F32, Some(1));
        })
    });
    for turns in TURNS {
        let placement =
            Placement { quarter_turns: turns, scale: 1.5, translate: [0.25, -3.0, 0.5] };
        let found = moved_by(&container, placement, &inside);
        assert!(found < 0.05, "world {turns:?}: {found}");
        for container in &masked {
            let found = moved_by(container, placement, &around(container));
            // A sample on a face of the mask may fall to either side.
            assert!(found < 0.05, "{turns:?}: {found}");
        }
    }
}

#[test]
fn turns_can_be_taken_back() {
    let container = baked(&trained("lego64/fine_last.tar"), |options| {
        (options.fill_error, options.block_size) = (Some(0.05), 4);
    });
    let turn = |container: &Container, turns| {
        let placement = Placement { quarter_turns: turns, ..Placement::default() };
        changed(container, &placed(placement)).expect("placed")
    };
    let back = turn(&turn(&container, [1, 0, 0]), [-1, 0, 0]);
    let (a, b) = (container.metadata(), back.metadata());
    assert_eq!((a.bounds, a.march), (b.bounds, b.march));
    for camera in around(&container) {
        let found = difference(&picture(&container, &camera), &picture(&back, &camera));
        assert!(found < 0.03, "{found}");
    }
    // Four quarters are none: the same file.
    let whole = Placement { quarter_turns: [4, 0, -4], ..Placement::default() };
    let [a, b] = [Changes::default(), placed(whole)]
        .map(|changes| changed_bytes(&container, &changes).expect("packed"));
    assert!(a == b);
}

#[test]
fn edits_come_before_the_move() {
    let container = baked(&trained("lego64/fine_last.tar"), |_| {});
    let edits = Changes {
        crop: Some(mipvog::model::grid::Bounds { min: [-9.0, -9.0, -9.0], max: [9.0, 9.0, 0.3] }),
        drop_islands: Some(30),
        without_finest: 1,
        ..Changes::default()
    };
    let placement = Placement { quarter_turns: [1, 0, 2], scale: 2.0, translate: [1.0, 0.0, 0.0] };
    let at_once = changed(&container, &Changes { placement, ..edits.clone() }).expect("packed");
    let edited = changed(&container, &edits).expect("packed");
    let then = changed(&edited, &placed(placement)).expect("packed");
    for camera in around(&edited) {
        let camera = along(&camera, &placement);
        let found = difference(&picture(&at_once, &camera), &picture(&then, &camera));
        assert!(found < 0.01, "{found}");
    }
    // A size is kept too.
    let small = Changes { max_bytes: Some(60_000), placement, ..Changes::default() };
    let small = changed_bytes(&container, &small).expect("packed");
    assert!(small.len() <= 60_000, "{}", small.len());
}

#[test]
fn places_that_f32_cannot_state_are_refused_by_name() {
    let container = baked(&trained("tiny/fine_last.tar"), |_| {});
    let place = |scale: f32, translate: [f32; 3]| {
        let placement = Placement { scale, translate, ..Placement::default() };
        changed_bytes(&container, &placed(placement)).expect_err("refused").to_string()
    };
    for (scale, translate, part) in [
        (0.0, [0.0; 3], "scale"),
        (-1.0, [0.0; 3], "scale"),
        (f32::NAN, [0.0; 3], "scale"),
        (f32::INFINITY, [0.0; 3], "scale"),
        (1e20, [0.0; 3], "scale"),
        (1e-41, [0.0; 3], "scale"),
        (1.0, [0.0, f32::NAN, 0.0], "translate"),
        (1.0, [0.0, 1e8, 0.0], "along axis y"),
        (1.0, [0.0, 0.0, 3e38], "translate"),
    ] {
        let found = place(scale, translate);
        assert!(found.contains(part), "{scale} {translate:?}: {found}");
    }
    // Limits hold for dense values of a rotated container too.
    let turned = Placement { quarter_turns: [1, 0, 0], ..Placement::default() };
    let turned = changed(&container, &placed(turned)).expect("placed");
    let unpacked = Unpacked::of_container(&turned).expect("codes");
    assert!(unpacked.field(&Limits::default()).expect("a field").is_some());
}
