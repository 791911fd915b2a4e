//! `max_error`: every retained node of every level is within it, by a second bake that keeps all
//! bits.

use crate::ONE_IN;
use crate::common;
use crate::common::{
    Random, baked_bytes, field, grid_values, open_bytes, packed, plain, random_field, unpack,
};
use mipvog::bake::{BakeOptions, Changes, Filter, MaxErrors};
use mipvog::base::bytes::Storage;
use mipvog::base::error::{ErrorKind, Place};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::levels::visible::masked_planes;
use mipvog::levels::{Light, Visible};
use mipvog::model::baked::{Decode, DensityDomain, Encoding, Group};
use mipvog::model::field::{Activation, Nonfinite, RadianceField};
use mipvog::model::grid::NodeMask;
use mipvog::model::harmonics::BAND_GAIN;
use mipvog::quantize::Bits;
use mipvog::unpacked::{LevelValues, Unpacked};

const ERRORS: [f32; 7] = [0.25, 0.07, 0.02, 0.005, 7e-4, 3e-5, 1e-6];

/// The same for all groups, or one for each.
fn errors(seed: usize) -> MaxErrors {
    let [one, two, three] = [0, 3, 5].map(|other| ERRORS[(seed + other) % ERRORS.len()]);
    if seed.is_multiple_of(3) { one.into() } else { MaxErrors::new(one, two, three) }
}

/// The activation of a stored value.
fn activated(decode: Decode, activation: &Activation, value: f32) -> f64 {
    let value = f64::from(value);
    match decode {
        Decode::Density(DensityDomain::Raw) => {
            plain::opacity(value, activation.shift.into(), activation.interval.into())
        }
        Decode::Density(DensityDomain::SqrtOpticalDepth) => -(-value * value).exp_m1(),
        Decode::Density(DensityDomain::Opacity) => value,
        Decode::Logit => plain::sigmoid(value),
        Decode::Linear => value,
        Decode::Coefficient(band) => value * BAND_GAIN[usize::from(band)],
        // Three parts of a dot product with a unit vector, times the sigmoid's slope.
        Decode::Directional => value * 3f64.sqrt() / 4.0,
        // Five coefficients of functions with a sum of squares of 5 / (4 pi), times the steepest
        // slope of opacity over the square root of optical depth.
        Decode::Anisotropy => {
            let norm = (5.0 / (4.0 * std::f64::consts::PI)).sqrt();
            value * 5f64.sqrt() * norm * (2.0 / std::f64::consts::E).sqrt()
        }
    }
}

/// The nodes that must be right, at every level.
fn retained(field: &RadianceField, options: &BakeOptions) -> Vec<NodeMask> {
    let planes = masked_planes(field, Nonfinite::Refuse, &Silent).expect("planes");
    let sizes = options.filter.level_sizes(field.scene.nodes, options.levels);
    let threshold = options.alpha_threshold;
    let visible =
        Visible::find(&planes, &sizes, &*options.filter, threshold, Light::default(), &Silent);
    visible.expect("visible").levels.into_iter().map(|level| level.retained).collect()
}

/// Bakes with `max_error` and with all bits, holds one to the other at every retained node, and
/// returns the encodings of all levels.
fn assert_within(field: &RadianceField, options: &BakeOptions, case: &str) -> Vec<Encoding> {
    let limits = options.max_error.expect("errors");
    let bytes = baked_bytes(field, options).expect("a bake");
    let mut exact = options.clone();
    (exact.max_error, exact.bits) = (None, Bits::F32);
    let container = open_bytes(&bytes).expect("valid");
    let got = unpack(&container).expect("unpacks");
    let want = open_bytes(&baked_bytes(field, &exact).expect("a bake")).expect("valid");
    let want = unpack(&want).expect("unpacks");
    let mut encodings = Vec::new();
    for (level, retained) in retained(field, options).iter().enumerate() {
        for group in Group::ALL {
            let Some(encoding) = container.metadata().levels[level].encoding(group) else {
                continue;
            };
            // Far levels are held to less.
            let asked = limits.of_level(level).of(group);
            assert!(encoding.max_error <= asked, "{case}: {encoding:?}");
            let activated = |value| activated(encoding.decode, &field.scene.activation, value);
            let nodes = retained.nodes();
            let (got, want) = (got.level(level, group), want.level(level, group));
            for (i, (&got, &want)) in got.iter().zip(&want).enumerate() {
                let [_, ny, nz] = nodes.0;
                let node = i % nodes.count();
                if retained.contains([node / nz / ny, node / nz % ny, node % nz]) {
                    let error = (activated(got) - activated(want)).abs();
                    // The reference's own functions differ in their last bits.
                    let bound = f64::from(encoding.max_error) + 1e-14;
                    assert!(
                        error <= bound,
                        "{case}: level {level} {group:?} {i}: {got} for {want}"
                    );
                }
            }
            encodings.push(encoding.clone());
        }
    }
    encodings
}

#[test]
fn every_retained_node_is_within_the_error() {
    let filters = Filter::all();
    for seed in (0..42).step_by(ONE_IN) {
        let mut random = Random::new(500 + seed);
        let mut nodes = [0; 3].map(|_: usize| 2 + random.below(17));
        if seed % 4 == 0 {
            nodes[random.below(3)] = 2;
        }
        let channels = [3, 4, 7][random.below(3)];
        let mut field = random_field(&mut random, nodes, channels);
        field.scene.activation.interval = [0.5, 0.5, 0.05, 3.0, 1e-4][random.below(5)];
        let options = BakeOptions {
            filter: filters[seed as usize % filters.len()].into(),
            max_error: Some(errors(seed as usize)),
            alpha_threshold: [1e-3, 1e-6][random.below(2)],
            levels: Some(64),
            fit_steps: 1,
            block_size: 1 + random.below(9),
            ..BakeOptions::default()
        };
        let case = format!("seed {seed}, {:?}, {:?}", options.filter, options.max_error);
        assert_within(&field, &options, &case);
    }
}

#[test]
fn constant_and_extreme_scenes_keep_the_error() {
    for nodes in [[2, 2, 2], [2, 9, 5]] {
        let count: usize = nodes.iter().product();
        for raw in [-100.0, -3.0, 0.3, 30.0, 1e30] {
            for color in [0.0, -0.25, 40.0, -1e30] {
                let field = field(nodes, &vec![raw; count], &vec![color; 3 * count]);
                for filter in [Filter::Code, Filter::Paper, Filter::RateTent, Filter::Coverage] {
                    let mut options = BakeOptions::default();
                    (options.filter, options.max_error) = (filter.into(), Some(1e-6.into()));
                    let encodings = assert_within(
                        &field,
                        &options,
                        &format!("{nodes:?} {raw} {color} {filter:?}"),
                    );
                    // A single value needs nothing; neither does emptiness.
                    let level0 = &encodings[..2];
                    assert!(level0.iter().all(|encoding| encoding.bits == 4), "{raw}: {level0:?}");
                }
            }
        }
    }
    // Far ends in one scene: values beyond all reach must not cost precision of the near ones.
    let density: Vec<f32> = (0..125).map(|i| [-1e30, 1e30, -20.0, 4.0, 6.5][i % 5]).collect();
    let color: Vec<f32> = (0..375).map(|i| [-1e30, 1e30, 0.1, -2.0][i % 4]).collect();
    let field = field([5; 3], &density, &color);
    for max_error in [0.1, 0.01, 1e-3] {
        let mut options = BakeOptions::default();
        (options.filter, options.max_error) = (Filter::Code.into(), Some(max_error.into()));
        let encodings = assert_within(&field, &options, "far ends");
        assert!(encodings.iter().all(|encoding| encoding.bits <= 12), "{encodings:?}");
    }
}

#[test]
fn larger_errors_take_no_more_bits_and_threads_never_show() {
    let field = random_field(&mut Random::new(77), [17, 9, 14], 5);
    for filter in [Filter::RateTent, Filter::Code] {
        let mut options = BakeOptions { filter: filter.into(), ..BakeOptions::default() };
        let mut bits: Option<Vec<u32>> = None;
        for max_error in ERRORS {
            options.max_error = Some(max_error.into());
            let bake = || baked_bytes(&field, &options).expect("a bake");
            let [one, three] = [1, 3].map(|threads| common::with_threads(threads, bake));
            assert!(one == three, "{max_error}");
            let container = open_bytes(&one).expect("valid");
            let levels = container.metadata().levels.iter();
            let now: Vec<u32> = levels
                .flat_map(|level| Group::ALL.map(|group| level.encoding(group).map(|e| e.bits)))
                .flatten()
                .collect();
            if let Some(before) = bits.replace(now.clone()) {
                assert!(before.iter().zip(&now).all(|(before, now)| before <= now), "{max_error}");
            }
            let stated = container.provenance().expect("valid").expect("provenance");
            let told = BakeOptions::of_container(container.metadata(), &stated);
            assert_eq!(told.max_error, Some(max_error.into()));
        }
        let bits = bits.expect("encodings");
        assert!(bits.contains(&32), "16 bits cannot hold 1e-6 of steep values: {bits:?}");
    }
}

/// An unpacked container, and its file's contents.
fn unpacked(bytes: &[u8]) -> (Unpacked, common::Unpacked) {
    let file = unpack(&open_bytes(bytes).expect("valid")).expect("unpacks");
    (mipvog_inputs::unpacked::open(file.file(), &Limits::default()).expect("an input"), file)
}

#[test]
fn unpacked_values_are_kept_within_the_error() {
    for (seed, filter) in Filter::all().into_iter().enumerate() {
        let mut random = Random::new(900 + seed as u64);
        let nodes = [0; 3].map(|_: usize| 2 + random.below(15));
        let field = random_field(&mut random, nodes, 5);
        let mut options = BakeOptions::default();
        (options.filter, options.fit_steps) = (filter.into(), 1);
        options.bits = [Bits::F32, Bits::F16, Bits::Integer(12), Bits::Integer(5)][seed % 4];
        options.block_size = 1 + random.below(9);
        let (input, before) = unpacked(&baked_bytes(&field, &options).expect("a bake"));
        let max_errors = errors(seed);
        let changes = Changes { max_error: Some(max_errors), ..Changes::default() };
        let container = open_bytes(&packed(&input, &changes).expect("packs")).expect("valid");
        let after = unpack(&container).expect("unpacks");
        for (level, metadata) in container.metadata().levels.iter().enumerate() {
            let stored = before.occupied(level, metadata.dimensions, metadata.block_size);
            for group in Group::ALL {
                let Some(encoding) = metadata.encoding(group) else { continue };
                let old = input.metadata.levels[level].encoding(group).expect("the same groups");
                assert!(encoding.bits <= old.bits && encoding.decode == old.decode);
                let (before, after) = (before.level(level, group), after.level(level, group));
                for (i, (&before, &after)) in before.iter().zip(&after).enumerate() {
                    let [got, want] = [after, before]
                        .map(|value| activated(encoding.decode, &field.scene.activation, value));
                    let error = (got - want).abs();
                    let limit = if stored[i % stored.len()] {
                        f64::from(max_errors.of(group))
                    } else {
                        0.0
                    };
                    assert!(error <= limit + 1e-14, "seed {seed} {level} {group:?} {i}: {error}");
                }
            }
        }
        // The result is a container like any other.
        let again =
            packed(&unpacked(&packed(&input, &changes).expect("packs")).0, &Changes::default());
        assert!(again.expect("packs") == packed(&input, &changes).expect("packs"), "seed {seed}");
    }
}

#[test]
fn edited_values_that_the_codes_cannot_hold_are_refused() {
    let field = random_field(&mut Random::new(5), [9, 6, 7], 3);
    let mut options = BakeOptions::default();
    (options.max_error, options.alpha_threshold) = (Some(0.01.into()), 1e-9);
    let (mut input, _) = unpacked(&baked_bytes(&field, &options).expect("a bake"));
    let LevelValues::Volumes(volumes) = &mut input.levels[1].values else {
        panic!("a file holds arrays")
    };
    let volume = volumes[Group::Density.index()].as_mut().expect("a level's density");
    let mut values = grid_values(&volume.clone().into());
    let most = values.iter().copied().fold(0.0, f32::max);
    assert!(most > 0.0 && most < 2.5, "{most}");
    // The level's optical depth, doubled: beyond the codes, which end at the old values.
    values.iter_mut().for_each(|value| *value *= std::f32::consts::SQRT_2);
    volume.storage = Storage::Memory(values.iter().flat_map(|value| value.to_le_bytes()).collect());
    volume.first = 0;
    let error = packed(&input, &Changes::default()).expect_err("moved too far");
    assert!(matches!(error.kind(), ErrorKind::Malformed { .. }), "{error}");
    assert_eq!(error.place(), &Place::Tensor("level1.density".to_owned()));
    let wider = Changes { bits: Some(Bits::Integer(12)), ..Changes::default() };
    packed(&input, &wider).expect("packs");
}

#[test]
fn only_errors_that_mean_something_can_be_asked_for() {
    let field = field([2; 3], &[10.0; 8], &[0.0; 24]);
    let (input, _) = unpacked(&baked_bytes(&field, &BakeOptions::default()).expect("a bake"));
    for max_error in [0.0, -0.01, 9e-7, 0.26, f32::INFINITY, f32::NAN] {
        let options = BakeOptions { max_error: Some(max_error.into()), ..BakeOptions::default() };
        let changes = Changes { max_error: Some(max_error.into()), ..Changes::default() };
        for error in [baked_bytes(&field, &options), packed(&input, &changes)] {
            let error = error.expect_err("refused");
            assert!(matches!(error.kind(), ErrorKind::InvalidOption { .. }), "{error}");
            assert!(error.to_string().contains("1e-6 to 0.25"), "{error}");
        }
    }
}
