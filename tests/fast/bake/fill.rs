//! Blocks whose colours are inherited from the next coarser level.

use crate::common;
use crate::common::plain::{all_nodes, sigmoid};
use crate::common::{
    Random, baked_bytes, field, fixture, open_bytes, packed, random_field, unpack,
};
use mipvog::bake::{BakeOptions, Changes, Filter};
use mipvog::base::bytes::Storage;
use mipvog::base::error::ErrorKind;
use mipvog::base::limits::Limits;
use mipvog::container::Container;
use mipvog::model::baked::{Encoding, Group, LevelMetadata};
use mipvog::model::camera::turntable;
use mipvog::model::field::RadianceField;
use mipvog::quantize::Bits;
use mipvog::unpacked::LevelValues;
use mipvog_bake::check::check;

const COLORS: [Group; 2] = [Group::Diffuse, Group::Features];

/// The random field with colours that change slowly, but for noise of `rough` in half of the box.
fn smooth_field(random: &mut Random, nodes: [usize; 3], rough: f32) -> RadianceField {
    let scene = random_field(random, nodes, 5);
    let density = common::grid_values(&scene.density);
    let mut color = Vec::new();
    for channel in 0..5 {
        for [x, y, z] in all_nodes(nodes) {
            let smooth = 0.02 * (x + 2 * y + z + 5 * channel) as f32 - 1.0;
            let noise = random.between(-rough, rough);
            color.push(if x < nodes[0] / 2 { smooth } else { smooth + noise });
        }
    }
    field(nodes, &density, &color)
}

fn options(block_size: usize, fill_error: Option<f32>) -> BakeOptions {
    // Of version 1.0 without inheritance.
    let mut options = BakeOptions::default().with_filter(Filter::Isotropic);
    (options.block_size, options.fill_error) = (block_size, fill_error);
    options
}

/// Inherited blocks, finest level first.
fn inherited(container: &Container) -> Vec<usize> {
    container.metadata().levels.iter().map(|level| level.blocks_filled).collect()
}

/// A node of a level between two of the coarser one's, along one axis.
fn between(node: usize, nodes: usize, coarser: usize) -> (usize, f64) {
    let low = (node * (coarser - 1) / (nodes - 1)).min(coarser - 2);
    let at = node * (coarser - 1) - low * (nodes - 1);
    (low, at as f64 / (nodes - 1) as f64)
}

/// The right value of an inherited node: a sum over eight corners, and the nearest of all codes'
/// values.
fn plain_inherited(
    encoding: &Encoding,
    coarser: &[f32],
    [from, to]: [&LevelMetadata; 2],
    at: [usize; 3],
) -> [f64; 2] {
    let along = [0, 1, 2].map(|axis| between(at[axis], to.dimensions[axis], from.dimensions[axis]));
    let mut value = 0.0;
    for corner in 0..8 {
        let up = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
        let node =
            (0..3).fold(0, |node, axis| node * from.dimensions[axis] + along[axis].0 + up[axis]);
        let share = (0..3).fold(1.0, |share, axis| {
            share * if up[axis] == 1 { along[axis].1 } else { 1.0 - along[axis].1 }
        });
        value += share * f64::from(coarser[node]);
    }
    let distance = |code: &f32| (f64::from(*code) - value).abs();
    let least = encoding.values().map(|code| distance(&code)).fold(f64::INFINITY, f64::min);
    [value, least]
}

/// Holds every node of inherited blocks to the plain sum. Returns how many there were.
fn check_inherited(container: &Container) -> usize {
    let unpacked = unpack(container).expect("unpacks");
    let levels = &container.metadata().levels;
    let mut count = 0;
    for (number, level) in levels.iter().enumerate().filter(|(_, level)| level.blocks_filled > 0) {
        let table = unpacked.get(&format!("level{number}.occupied")).expect("a table");
        let counts = level.grid().counts();
        let is_inherited = |at: [usize; 3]| {
            let [i, j, k] = at.map(|at| at / level.block_size);
            table[(i * counts[1] + j) * counts[2] + k] == 2.0
        };
        for group in COLORS {
            let Some(encoding) = level.encoding(group) else { continue };
            let own = unpacked.level(number, group);
            let coarser = unpacked.level(number + 1, group);
            let nodes: usize = level.dimensions.iter().product();
            let fewer: usize = levels[number + 1].dimensions.iter().product();
            for channel in 0..group.channels(container.metadata().layout()) {
                for (node, at) in all_nodes(level.dimensions).enumerate() {
                    if !is_inherited(at) {
                        continue;
                    }
                    let coarser_values = &coarser[channel * fewer..][..fewer];
                    let metadata = [&levels[number + 1], level];
                    let [value, least] = plain_inherited(encoding, coarser_values, metadata, at);
                    let got = f64::from(own[channel * nodes + node]);
                    // Sums in another order: two codes may be equally near but for rounding.
                    let far = (got - value).abs();
                    assert!(far <= least + 1e-9, "level {number} {at:?}: {got} for {value}");
                    count += 1;
                }
            }
        }
    }
    count
}

#[test]
fn inherited_nodes_hold_the_nearest_code_of_what_the_coarser_level_says() {
    let mut random = Random::new(5);
    let mut all = 0;
    for (nodes, edge) in
        [([24, 20, 28], 4), ([17, 2, 23], 3), ([9, 13, 31], 8), ([16, 16, 16], 1), ([33, 5, 2], 5)]
    {
        let field = smooth_field(&mut random, nodes, 3.0);
        for filter in [Filter::RateTent, Filter::Code] {
            let mut options = options(edge, Some(0.05));
            options.filter = filter.into();
            let bytes = baked_bytes(&field, &options).expect("a bake");
            all += check_inherited(&open_bytes(&bytes).expect("valid"));
        }
    }
    assert!(all > 10_000, "{all} values");
}

#[test]
fn inherited_blocks_keep_the_stated_error_and_take_fewer_bytes() {
    let mut random = Random::new(9);
    let field = smooth_field(&mut random, [32, 24, 28], 3.0);
    let exact =
        open_bytes(&baked_bytes(&field, &options(4, None)).expect("a bake")).expect("valid");
    let bytes = baked_bytes(&field, &options(4, Some(0.05))).expect("a bake");
    let container = open_bytes(&bytes).expect("valid");
    assert!(container.header().file_length < exact.header().file_length);
    assert_eq!((container.header().version, container.header().features), ([1, 1], 1));
    assert_eq!((exact.header().version, exact.header().features), ([1, 0], 0));
    let [some, stored] = [inherited(&container)[0], container.metadata().levels[0].blocks_stored];
    assert!(some > 0 && some < stored, "{some} of {stored}");
    // Density alone decides visibility, and is the same.
    let [got, want] = [&container, &exact].map(|container| unpack(container).expect("unpacks"));
    assert_eq!(got.level(0, Group::Density), want.level(0, Group::Density));
    let density = want.level(0, Group::Density);
    let mut largest = 0.0f64;
    for group in COLORS {
        let [got, want] = [&got, &want].map(|unpacked| unpacked.level(0, group));
        for (node, (&got, &want)) in got.iter().zip(&want).enumerate() {
            if density[node % density.len()] > 0.0 {
                largest = largest.max((sigmoid(got.into()) - sigmoid(want.into())).abs());
            }
        }
        let [now, before] = [&container, &exact].map(|container| {
            container.metadata().levels[0].encoding(group).expect("colours").max_error
        });
        assert!(now > before && now <= before + 0.0501, "{now} after {before}");
    }
    assert!(largest > 0.01 && largest <= 0.05, "{largest}");
}

#[test]
fn inheriting_containers_bake_again_to_the_same_bytes_for_any_number_of_threads() {
    let field = smooth_field(&mut Random::new(4), [24, 20, 28], 2.0);
    for (edge, bits) in [(4, Bits::Integer(8)), (8, Bits::Integer(11))] {
        let mut options = options(edge, Some(0.08));
        options.bits = bits;
        let bytes = [1, 3].map(|threads| {
            common::with_threads(threads, || baked_bytes(&field, &options).expect("a bake"))
        });
        assert_eq!(bytes[0], bytes[1]);
        let container = open_bytes(&bytes[0]).expect("valid");
        assert!(inherited(&container).iter().sum::<usize>() > 0);
        let unpacked = unpack(&container).expect("unpacks");
        let unpacked =
            mipvog_inputs::unpacked::open(unpacked.file(), &Limits::default()).expect("unpacked");
        let again = packed(&unpacked, &Changes::default()).expect("bakes again");
        assert_eq!(again, bytes[0]);
        let folder = common::folder();
        let path = folder.path().join("again.mipvog");
        std::fs::write(&path, again).expect("writable");
        assert!(check(&path, &Limits::default()).expect("a report").valid);
        // One level alone is the same as among all.
        let whole = container.read().expect("levels");
        for (number, level) in whole.levels.iter().enumerate() {
            assert_eq!(container.read_level(number).expect("a level"), *level);
        }
    }
}

/// A container with inherited blocks, and its unpacked values.
fn inheriting_scene() -> (Container, common::Unpacked) {
    let field = smooth_field(&mut Random::new(4), [24, 20, 28], 2.0);
    let bytes = baked_bytes(&field, &options(4, Some(0.08))).expect("a bake");
    let container = open_bytes(&bytes).expect("valid");
    assert!(inherited(&container)[0] > 0);
    let unpacked = unpack(&container).expect("unpacks");
    (container, unpacked)
}

#[test]
fn other_encodings_keep_their_error_in_inherited_blocks_too() {
    let (container, before) = inheriting_scene();
    let input = mipvog_inputs::unpacked::open(before.file(), &Limits::default()).expect("unpacked");
    let bits = Changes { bits: Some(Bits::Integer(6)), ..Changes::default() };
    let errors = Changes { max_error: Some(0.03.into()), ..Changes::default() };
    for changes in [bits, errors] {
        let again = packed(&input, &changes).expect("bakes again");
        let again = open_bytes(&again).expect("valid");
        let after = unpack(&again).expect("unpacks");
        for (number, level) in again.metadata().levels.iter().enumerate() {
            let occupied = after.occupied(number, level.dimensions, level.block_size);
            for group in COLORS {
                let stated = f64::from(level.encoding(group).expect("colours").max_error);
                let old = &container.metadata().levels[number];
                let asked = changes.max_error.map_or(stated, |errors| errors.of(group).into());
                let kept = level.encoding(group) == old.encoding(group);
                let bound = if kept { 0.0 } else { stated.min(asked) };
                let [got, want] = [&after, &before].map(|all| all.level(number, group));
                for (node, (&got, &want)) in got.iter().zip(&want).enumerate() {
                    let moved = (sigmoid(got.into()) - sigmoid(want.into())).abs();
                    let counts = occupied[node % occupied.len()];
                    assert!(!counts || moved <= bound + 1e-7, "level {number}: {moved}, {bound}");
                }
            }
        }
    }
}

#[test]
fn levels_are_cut_below_inherited_ones() {
    let (container, before) = inheriting_scene();
    let input = mipvog_inputs::unpacked::open(before.file(), &Limits::default()).expect("unpacked");
    for levels in 1..container.metadata().levels.len() {
        let changes = Changes { levels: Some(levels), ..Changes::default() };
        let again = open_bytes(&packed(&input, &changes).expect("bakes again")).expect("valid");
        assert_eq!(inherited(&again)[levels - 1], 0, "the coarsest level has no coarser one");
        let after = unpack(&again).expect("unpacks");
        for (level, group) in (0..levels).flat_map(|level| COLORS.map(|group| (level, group))) {
            assert_eq!(after.level(level, group), before.level(level, group));
        }
    }
}

#[test]
fn edits_in_inherited_blocks_are_kept() {
    let (container, before) = inheriting_scene();
    let mut input =
        mipvog_inputs::unpacked::open(before.file(), &Limits::default()).expect("unpacked");
    let level = &container.metadata().levels[0];
    let table = before.get("level0.occupied").expect("a table");
    let block = table.iter().position(|&state| state == 2.0).expect("an inherited block");
    let [_, by, bz] = level.grid().counts();
    let at = [block / (by * bz), block / bz % by, block % bz].map(|place| place * level.block_size);
    let node = common::plain::index(level.dimensions, at);
    let mut values = before.level(0, Group::Diffuse);
    let encoding = level.encoding(Group::Diffuse).expect("colours");
    let far = encoding.values().find(|value| (value - values[node]).abs() > 0.5);
    values[node] = far.expect("another code");
    let LevelValues::Volumes(volumes) = &mut input.levels[0].values else {
        panic!("a file holds arrays")
    };
    let volume = volumes[1].as_mut().expect("colours");
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    (volume.storage, volume.first) = (Storage::Memory(bytes.into()), 0);
    let again = packed(&input, &Changes::default()).expect("bakes again");
    let again = open_bytes(&again).expect("valid");
    assert_eq!(inherited(&again)[0], inherited(&container)[0] - 1);
    let after = unpack(&again).expect("unpacks");
    assert_eq!(after.level(0, Group::Diffuse), values);
}

#[test]
fn what_cameras_see_little_of_inherits_sooner() {
    let field = smooth_field(&mut Random::new(8), [24, 20, 28], 2.0);
    let mut options = options(4, Some(0.05));
    let plain = open_bytes(&baked_bytes(&field, &options).expect("a bake")).expect("valid");
    options.min_weight = Some(1e-6);
    options.seen_from = turntable(&field.scene.bounds, 3, [40, 40]);
    let seen = open_bytes(&baked_bytes(&field, &options).expect("a bake")).expect("valid");
    let share = |container: &Container| {
        let level = &container.metadata().levels[0];
        level.blocks_filled as f64 / level.blocks_stored as f64
    };
    assert!(share(&seen) > share(&plain), "{} {}", share(&seen), share(&plain));
}

#[test]
fn levels_of_floats_stand_in_the_way_of_no_finer_one() {
    let field = smooth_field(&mut Random::new(2), [40, 36, 38], 0.0);
    let mut options = options(4, Some(0.05));
    options.max_error = Some(1.2e-5.into());
    let container = open_bytes(&baked_bytes(&field, &options).expect("a bake")).expect("valid");
    let levels = &container.metadata().levels;
    let is_float = |level: &LevelMetadata| !level.has_integer_colors();
    assert!(levels.last().is_some_and(is_float), "half of the error for each level");
    assert!(!is_float(&levels[0]) && inherited(&container)[0] > 0);
    assert!(container.read().is_ok());
}

#[test]
fn empty_fields_and_single_levels_have_no_inherited_blocks() {
    let field = smooth_field(&mut Random::new(2), [12, 9, 10], 0.0);
    let none = |field: &RadianceField, change: &dyn Fn(&mut BakeOptions)| {
        let mut options = options(4, Some(1.0));
        change(&mut options);
        let bytes = baked_bytes(field, &options).expect("a bake");
        let container = open_bytes(&bytes).expect("valid");
        assert_eq!(inherited(&container).iter().sum::<usize>(), 0);
        assert_eq!(container.header().features, 0);
    };
    none(&field, &|options| options.levels = Some(1));
    none(&common::field([4, 5, 6], &[-100.0; 120], &[0.0; 360]), &|_| {});
}

#[test]
fn errors_out_of_range_are_refused() {
    for error in [0.0, -0.1, 1.1, f32::NAN] {
        let refused = options(8, Some(error)).check().expect_err("no error").to_string();
        assert!(refused.contains("option fill_error"), "{refused}");
    }
}

/// An inheriting container's bytes with other metadata, table and header.
#[test]
fn inheritance_that_cannot_be_are_refused() {
    let bytes = std::fs::read(fixture("baked/tiny.rate.filled.mipvog")).expect("a golden file");
    let refused = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = bytes.clone();
        change(&mut bytes);
        common::mend_checksums(&mut bytes);
        open_bytes(&bytes).and_then(|container| container.read()).expect_err("a broken container")
    };
    // Without the feature, with one more, and with another count of inherited blocks.
    assert!(matches!(refused(&|bytes| bytes[16] = 0).kind(), ErrorKind::Malformed { .. }));
    assert!(matches!(refused(&|bytes| bytes[16] = 65).kind(), ErrorKind::Unsupported { .. }));
    let count = b"\"blocks_filled\":";
    let error = refused(&|bytes| {
        let at = bytes.windows(count.len()).position(|text| text == count).expect("a count");
        let digit = &mut bytes[at + count.len()];
        *digit = if *digit == b'1' { b'2' } else { b'1' };
    });
    assert!(matches!(error.kind(), ErrorKind::Malformed { .. }), "{error}");
}
