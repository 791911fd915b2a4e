//! Unpacking and packing again gives the same file; threads never show; every field survives.

use crate::common;
use crate::common::{
    Random, baked_bytes, field, fixture, masked, open_bytes, packed, plain, random_field, trained,
    unpack,
};
use mipvog::bake::{BakeOptions, Changes, Filter, LevelRule};
use mipvog::base::error::ErrorKind;
use mipvog::base::limits::Limits;
use mipvog::container::Container;
use mipvog::model::baked::{Bends, FootprintNeighbour, Group, LevelOfDetail};
use mipvog::model::field::{FreeSpace, Lookup, Nonfinite};
use mipvog::model::grid::Nodes;
use mipvog::quantize::Bits;

/// Unpacks a container and packs it again.
fn repacked(bytes: &[u8], changes: &Changes) -> Vec<u8> {
    let unpacked = unpack(&open_bytes(bytes).expect("valid")).expect("unpacks");
    let input =
        mipvog_inputs::unpacked::open(unpacked.file(), &Limits::default()).expect("an input");
    packed(&input, changes).expect("packs")
}

/// A mask that is inside for x below the middle of the box, of its own size and box.
fn half_mask(trilinear: bool) -> FreeSpace {
    let nodes = Nodes([5, 3, 4]);
    let inside = plain::all_nodes(nodes.0).map(|[x, _, _]| x < 2);
    let lookup = match trilinear {
        true => Lookup::Trilinear { values: inside.map(f32::from).collect(), threshold: 0.5 },
        false => Lookup::Nearest(inside.collect()),
    };
    // The field's box is [-1, -0.5, 0] to [1, 0.75, 3]; the mask's is a little larger.
    FreeSpace { nodes, scale: [1.9, 1.5, 0.95], shift: [2.0, 0.8, 0.05], lookup }
}

#[test]
fn unpacked_containers_pack_to_the_same_bytes() {
    let all_bits = [Bits::F32, Bits::F16].into_iter().chain((4..=16).map(Bits::Integer));
    for (seed, bits) in all_bits.enumerate() {
        let mut random = Random::new(seed as u64);
        let nodes = [0; 3].map(|_: usize| 2 + random.below(21));
        let channels = [3, 5, 7][random.below(3)];
        let mut field = random_field(&mut random, nodes, channels);
        if seed % 3 == 1 {
            field = masked(field, half_mask(seed % 2 == 0));
        }
        let options = BakeOptions {
            bits,
            filter: Filter::all()[seed % Filter::all().len()].into(),
            fit_steps: 1,
            block_size: 1 + random.below(10),
            zstd_level: 1 + (seed as i32 % 5),
            ..BakeOptions::default()
        };
        let bytes = baked_bytes(&field, &options).expect("a bake");
        let again = repacked(&bytes, &Changes::default());
        assert!(again == bytes, "seed {seed}, {bits} bits");
    }
}

#[test]
fn changes_to_an_unpacked_container_change_only_what_they_say() {
    let bytes =
        baked_bytes(&trained("tiny/fine_last.tar"), &BakeOptions::default()).expect("a bake");
    let changes = Changes {
        near: Some(0.25),
        background: Some([0.0, 0.5, 1.0]),
        levels: Some(2),
        ..Changes::default()
    };
    let before = open_bytes(&bytes).expect("valid");
    let after = open_bytes(&repacked(&bytes, &changes)).expect("valid");
    let mut expected = before.metadata().clone();
    expected.march.near = 0.25;
    expected.background = [0.0, 0.5, 1.0];
    expected.levels.truncate(2);
    assert_eq!(after.metadata(), &expected);
    let (before, after) = (before.read().expect("valid"), after.read().expect("valid"));
    assert_eq!(after.levels, before.levels[..2]);
}

#[test]
fn a_published_rule_of_levels_is_written_in_place_of_the_filters() {
    let field = trained("tiny/fine_last.tar");
    let usual_bytes = baked_bytes(&field, &BakeOptions::default()).expect("a bake");
    let usual = open_bytes(&usual_bytes).expect("valid");
    let rules = [
        (LevelRule::Paper, 1.0 / 3.0, None),
        (LevelRule::Code, 0.5, Some(4.0)),
        (LevelRule::Mipmap, 1.0, None),
    ];
    for (rule, factor, bound) in rules {
        let mut options =
            BakeOptions { lod_rule: Some(rule), lod_scale: 2.0, ..BakeOptions::default() };
        let asked = open_bytes(&baked_bytes(&field, &options).expect("a bake")).expect("valid");
        let changes = Changes { lod_rule: Some(rule), lod_scale: Some(2.0), ..Changes::default() };
        let changed = open_bytes(&repacked(&usual_bytes, &changes)).expect("valid");
        let mut expected = usual.metadata().clone();
        expected.level_of_detail = LevelOfDetail {
            factor: 2.0 * factor,
            bias: 0.0,
            bound,
            neighbour: FootprintNeighbour::SameDistance,
            bends: Bends::default(),
        };
        for container in [&asked, &changed] {
            assert_eq!(container.metadata(), &expected);
            let levels = |container: &Container| container.read().expect("valid").levels;
            assert_eq!(levels(container), levels(&usual));
        }
        options.filter = Filter::Fit.into();
        let refused = baked_bytes(&field, &options).expect_err("a fit finds its own");
        assert!(matches!(refused.kind(), ErrorKind::InvalidOption { .. }), "{refused}");
    }
}

#[test]
fn thread_count_never_shows() {
    for filter in [Filter::Code, Filter::Paper] {
        let options = BakeOptions { filter: filter.into(), ..BakeOptions::default() };
        let bytes = |threads| {
            common::with_threads(threads, || {
                baked_bytes(&trained("lego64/fine_last.tar"), &options).expect("a bake")
            })
        };
        let one = bytes(1);
        for threads in [2, 3, 5, 8] {
            assert!(one == bytes(threads), "{threads} threads gave other bytes");
        }
    }
}

#[test]
fn empty_and_full_scenes_bake() {
    for nodes in [[2, 2, 2], [2, 9, 17], [16, 16, 16]] {
        let count: usize = nodes.iter().product();
        for (raw, stored) in [(-100.0, false), (-1e30, false), (1e30, true), (30.0, true)] {
            let field = field(nodes, &vec![raw; count], &vec![0.25; 3 * count]);
            for filter in [Filter::Code, Filter::Paper] {
                let options = BakeOptions { filter: filter.into(), ..BakeOptions::default() };
                let container = open_bytes(&baked_bytes(&field, &options).expect("a bake"));
                let container = container.expect("valid");
                for level in &container.metadata().levels {
                    let expected = if stored { level.grid().total() } else { 0 };
                    assert_eq!(level.blocks_stored, expected, "{nodes:?} {raw}");
                }
                let unpacked = unpack(&container).expect("unpacks");
                let last = container.metadata().levels.len() - 1;
                let color = unpacked.level(last, Group::Diffuse);
                let close = if stored { 0.25 } else { 0.0 };
                assert!(color.iter().all(|value: &f32| (value - close).abs() < 0.032));
            }
        }
    }
}

#[test]
fn the_mask_empties_what_it_cannot_reach_and_is_kept_where_it_shows() {
    let nodes = [17, 9, 9];
    let count: usize = nodes.iter().product();
    let density = vec![10.0; count];
    for trilinear in [false, true] {
        let field = masked(field(nodes, &density, &vec![0.5; 3 * count]), half_mask(trilinear));
        let options = BakeOptions { block_size: 1, bits: Bits::F32, ..BakeOptions::default() };
        let container = open_bytes(&baked_bytes(&field, &options).expect("a bake")).expect("valid");
        assert!(container.metadata().free_space, "half of the scene is cut off at an opaque place");
        let read = container.read().expect("valid");
        assert_eq!(read.free_space, field.free_space);
        let occupied = unpack(&container).expect("unpacks").occupied(0, nodes, 1);
        // Node i lies at 0.1 + 0.2375 i among the mask's nodes. Nearest: inside ends at 1.5, in the
        // cell from node 5 to 6. Trilinear: values may reach the threshold up to mask node 2, which
        // is node 8, where the next cell begins.
        for (at, stored) in plain::all_nodes(nodes).zip(occupied) {
            assert_eq!(stored, at[0] <= if trilinear { 9 } else { 6 }, "{at:?}");
        }
    }
    let everywhere = FreeSpace { lookup: Lookup::Nearest(vec![true; 60]), ..half_mask(false) };
    let field = masked(field(nodes, &density, &vec![0.5; 3 * count]), everywhere);
    let container = open_bytes(&baked_bytes(&field, &BakeOptions::default()).expect("a bake"));
    assert!(
        !container.expect("valid").metadata().free_space,
        "a mask that drops nothing is left out"
    );
}

#[test]
fn values_that_are_not_finite_are_refused_or_emptied() {
    let nodes = [9, 9, 9];
    let count: usize = nodes.iter().product();
    for (channel, at) in [(0, [3, 4, 5]), (2, [0, 8, 8])] {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut values = [vec![10.0; count], vec![0.5; 3 * count]];
            let place = plain::index(nodes, at);
            match channel {
                0 => values[0][place] = bad,
                _ => values[1][(channel - 1) * count + place] = bad,
            }
            let field = field(nodes, &values[0], &values[1]);
            let mut options =
                BakeOptions { filter: Filter::Paper.into(), ..BakeOptions::default() };
            let error = baked_bytes(&field, &options).expect_err("not finite");
            let reported = if channel == 0 { 0 } else { channel - 1 };
            let first = [reported, at[0], at[1], at[2]];
            assert!(
                matches!(error.kind(), ErrorKind::NonFinite { count: 1, first: f } if *f == first),
                "{error}"
            );
            options.nonfinite = Nonfinite::Empty;
            open_bytes(&baked_bytes(&field, &options).expect("a bake")).expect("valid");
        }
    }
}

#[test]
fn fixtures_of_this_version_read_for_ever() {
    let folder = std::fs::read_dir(fixture("baked")).expect("golden containers");
    let mut count = 0;
    for entry in folder {
        let bytes = std::fs::read(entry.expect("a file").path()).expect("readable");
        let container = open_bytes(&bytes).expect("valid");
        container.read().expect("decodes");
        assert!(repacked(&bytes, &Changes::default()) == bytes);
        count += 1;
    }
    assert!(count >= 6, "{count} golden containers");
}
