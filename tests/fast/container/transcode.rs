//! Containers to other containers, without the checkpoint: bits, errors, levels, bytes.

use crate::common;
use crate::common::transcoded::{baked, changed, changed_bytes};
use crate::common::{
    Random, baked_bytes, chunks, field, open_bytes, random_field, trained, unpack,
};
use mipvog::bake::{BakeOptions, Changes, Filter, MaxErrors};
use mipvog::base::bytes::Storage;
use mipvog::base::error::ErrorKind;
use mipvog::base::limits::Limits;
use mipvog::model::baked::{FootprintNeighbour, Group, LevelMetadata, Metadata, StepRule};
use mipvog::model::field::RadianceField;
use mipvog::model::grid::Bounds;
use mipvog::quantize::Bits;
use mipvog::unpacked::{LevelValues, Unpacked};

#[test]
fn a_container_packs_as_the_file_it_unpacks_to() {
    let scene = trained("tiny/fine_last.tar");
    let errors = Changes { max_error: Some(0.03.into()), ..Changes::default() };
    let fewer = Changes { levels: Some(2), without_finest: 1, ..Changes::default() };
    let bits = Changes { bits: Some(Bits::Integer(5)), ..Changes::default() };
    let small = Changes { max_bytes: Some(8000), ..Changes::default() };
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
        let file =
            mipvog_inputs::unpacked::open(unpacked.file(), &Limits::default()).expect("an input");
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
            let field = input.field(&Limits::default()).expect("readable").expect("densities");
            baked_bytes(&field, &BakeOptions::default()).expect("a bake")
        });
        assert!(a == b);
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
        let aside = match filter {
            Filter::Paper => FootprintNeighbour::SameIndex,
            _ => FootprintNeighbour::SameDistance,
        };
        assert_eq!(new.neighbour, aside);
        // 64 nodes became 16.
        assert!((new.bias - (old.bias - 2.0 + 2.0 * old.factor)).abs() < 1e-6);
        for (after, before) in after.levels.iter().zip(&before.levels[2..]) {
            let error = |level: &LevelMetadata| level.density.as_ref().expect("density").max_error;
            assert!(error(after) >= times * error(before) && error(after) < 1.0);
        }
        // The file is one like any other: it unpacks, packs and loses levels again.
        let unpacked = unpack(&fewer).expect("unpacks");
        let file =
            mipvog_inputs::unpacked::open(unpacked.file(), &Limits::default()).expect("an input");
        let again = open_bytes(&common::packed(&file, &Changes::default()).expect("packs"));
        let again = again.expect("valid").read().expect("valid").levels;
        assert_eq!(again, fewer.read().expect("valid").levels);
        let once = Changes { without_finest: 1, ..Changes::default() };
        let twice = changed(&changed(&container, &once).expect("one"), &once).expect("two");
        assert_eq!(twice.read().expect("valid").levels, fewer.read().expect("valid").levels);
        // Level 0 holds no logits any more where alpha was averaged.
        let field = Unpacked::of_container(&fewer).expect("decodes").field(&Limits::default());
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

#[test]
fn unknown_ancillary_chunks_stay_with_their_levels() {
    let scene = trained("tiny/fine_last.tar");
    // The parts are put together as a container of version 1.0.
    let options = BakeOptions::default().with_filter(Filter::Isotropic);
    let bytes = baked_bytes(&scene, &options).expect("bakes");
    let mut parts = chunks::chunks(&bytes);
    let note = |level: Option<u32>, text: &str| chunks::Chunk {
        kind: *b"note",
        level,
        bytes: text.as_bytes().to_vec(),
    };
    for (level, text) in [(None, "all"), (Some(0), "fine"), (Some(1), "half"), (Some(3), "last")] {
        parts.push(note(level, text));
    }
    let container = open_bytes(&chunks::container(&parts)).expect("a container");
    let notes = |changes: &Changes| {
        let changed =
            open_bytes(&changed_bytes(&container, changes).expect("packs")).expect("a container");
        let others = changed.other_chunks().expect("sound");
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let mut notes: Vec<_> =
            others.iter().map(|chunk| (chunk.level, text(&chunk.bytes))).collect();
        notes.sort();
        notes
    };
    let all = [(None, "all"), (Some(0), "fine"), (Some(1), "half"), (Some(3), "last")];
    let owned = |notes: &[(Option<u32>, &str)]| -> Vec<_> {
        notes.iter().map(|&(level, text)| (level, text.to_owned())).collect()
    };
    assert_eq!(notes(&Changes::default()), owned(&all));
    let fewer = Changes { without_finest: 1, ..Changes::default() };
    assert_eq!(notes(&fewer), owned(&[(None, "all"), (Some(0), "half"), (Some(2), "last")]));
    let two = Changes { levels: Some(2), ..Changes::default() };
    assert_eq!(notes(&two), owned(&all[..3]));
}

#[test]
fn a_field_of_codes_takes_no_more_memory_than_is_allowed() {
    let container = baked(&random_field(&mut Random::new(5), [9, 8, 7], 5), |_| {});
    let unpacked = Unpacked::of_container(&container).expect("decodes");
    // A density and five channels of colour, in float32.
    let bytes = 6 * 9 * 8 * 7 * 4;
    let allowed = |memory| Limits { memory, ..Limits::default() };
    assert!(unpacked.field(&allowed(bytes)).expect("allowed").is_some());
    let error = unpacked.field(&allowed(bytes - 1)).expect_err("one byte short");
    assert!(matches!(error.kind(), ErrorKind::OverLimit { .. }), "{error}");
}

#[test]
fn changes_that_no_container_can_have_are_refused_by_name() {
    let mut field = random_field(&mut Random::new(6), [9, 8, 7], 5);
    (field.scene.march.near, field.scene.march.far) = (2.0, Some(6.0));
    let unpacked = Unpacked::of_container(&baked(&field, |_| {})).expect("decodes");
    let none = Changes::default;
    let cases = [
        (
            Changes { far: Some(1.0), ..none() },
            "option far: found 1, expected a distance beyond near, which is 2",
        ),
        (
            Changes { near: Some(7.0), ..none() },
            "option near: found 7, expected a distance below far, which is 6",
        ),
        (Changes { far: Some(f32::NAN), ..none() }, "option far"),
        (Changes { near: Some(-1.0), ..none() }, "option near"),
        (Changes { bits: Some(Bits::Integer(3)), ..none() }, "option bits"),
        (Changes { zstd_level: Some(23), ..none() }, "option zstd_level"),
        (Changes { lod_scale: Some(0.0), ..none() }, "option lod_scale"),
        (Changes { color_threshold: Some(1.0), ..none() }, "option color_threshold"),
        (Changes { background: Some([2.0; 3]), ..none() }, "option background"),
    ];
    for (changes, expected) in cases {
        let error = common::packed(&unpacked, &changes).expect_err(expected);
        assert!(matches!(error.kind(), ErrorKind::InvalidOption { .. }), "{error}");
        assert!(error.to_string().contains(expected), "{error}");
    }
    let both = Changes { near: Some(0.5), far: Some(1.0), ..none() };
    assert!(common::packed(&unpacked, &both).is_ok());
}

#[test]
fn bits_count_for_nothing_beside_a_size() {
    let container = baked(&random_field(&mut Random::new(7), [19, 18, 17], 5), |_| {});
    let unpacked = Unpacked::of_container(&container).expect("decodes");
    let size = Changes { max_bytes: Some(1 << 30), ..Changes::default() };
    let plain = common::packed(&unpacked, &size).expect("packs");
    for bits in [Bits::F32, Bits::Integer(4)] {
        let both = Changes { bits: Some(bits), ..size.clone() };
        assert!(common::packed(&unpacked, &both).expect("packs") == plain, "{bits}");
        assert_eq!(both.to_json(), size.to_json());
    }
}

#[test]
fn edited_arrays_do_not_pass_for_what_was_unpacked() {
    let container = baked(&trained("tiny/fine_last.tar"), |_| {});
    let unpacked = unpack(&container).expect("unpacks");
    let open =
        || mipvog_inputs::unpacked::open(unpacked.file(), &Limits::default()).expect("an input");
    let provenance = |input: &Unpacked| {
        let bytes = common::packed(input, &Changes::default()).expect("packs");
        let again = open_bytes(&bytes).expect("valid");
        assert_eq!(again.metadata(), container.metadata());
        again.provenance().expect("JSON").expect("some")
    };
    let before = container.provenance().expect("JSON").expect("some");
    assert_eq!(provenance(&open()), before);
    // Red and green change places: every value still has a code.
    let mut swapped = open();
    let LevelValues::Volumes(volumes) = &mut swapped.levels[0].values else {
        panic!("dense arrays");
    };
    let volume = volumes[Group::Diffuse.index()].as_mut().expect("colours");
    let mut bytes = vec![0; volume.bytes() as usize];
    volume.storage.read_into(volume.first, &mut bytes).expect("readable");
    let channel = bytes.len() / 3;
    let (red, others) = bytes.split_at_mut(channel);
    red.swap_with_slice(&mut others[..channel]);
    (volume.storage, volume.first) = (Storage::Memory(bytes.into()), 0);
    let after = provenance(&swapped);
    assert_eq!(after["input"]["kind"], "unpacked container");
    assert_eq!(after["input"]["provenance"], before);
    let mut trained_on = open();
    trained_on.view_mlp.as_mut().expect("a network").layers[0].bias[0] += 1.0;
    assert_eq!(provenance(&trained_on)["input"]["provenance"], before);
}
