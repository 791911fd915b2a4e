//! Values of the metadata at the ends of their ranges (`formats/mipvog.md`, section 4): those
//! within are taken, those beyond are refused under their key.

use crate::common::asset;
use mipvog::base::error::Place;
use mipvog::base::limits::Limits;
use mipvog::container::check_metadata;
use mipvog::model::baked::{
    Bends, Blend, Decode, DensityDomain, Encoding, Metadata, NetworkMetadata, NumberType,
    ViewMetadata,
};

const NAN: f32 = f32::NAN;
const INFINITE: f32 = f32::INFINITY;
/// The number next to 1 from above.
const ABOVE_ONE: f32 = 1.0 + f32::EPSILON;
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// A key, the function that sets its value, valid values, and invalid values.
type Case<T> = (&'static str, fn(&mut Metadata, T), &'static [T], &'static [T]);

/// Metadata of a container with a network, features and several levels, each with density.
fn sound() -> Metadata {
    asset::container("tiny.isotropic.mipvog").metadata().clone()
}

/// The key of the first thing that is wrong.
fn refused(metadata: &Metadata) -> Option<String> {
    let error = check_metadata(metadata, &Limits::default(), &Place::File).err()?;
    let Place::Key(key) = error.place() else { panic!("{error}") };
    Some(key.clone())
}

fn hold<T: Copy + std::fmt::Debug>(cases: &[Case<T>]) {
    for (key, set, good, bad) in cases {
        for (&value, expected) in
            good.iter().map(|v| (v, None)).chain(bad.iter().map(|v| (v, Some(*key))))
        {
            let mut metadata = sound();
            set(&mut metadata, value);
            assert_eq!(refused(&metadata).as_deref(), expected, "{key}: {value:?}");
        }
    }
}

/// The network's facts, to be changed.
fn network(metadata: &mut Metadata) -> &mut NetworkMetadata {
    match &mut metadata.view {
        Some(ViewMetadata::Network(network)) => network,
        _ => panic!("a network"),
    }
}

#[test]
fn numbers_are_held_to_their_ranges() {
    let cases: [Case<f32>; 17] = [
        ("bounds", |m, v| m.bounds.max[1] = v, &[9.0], &[-9.0, NAN, INFINITE]),
        ("activation.shift", |m, v| m.activation.shift = v, &[-1e30, 1e30], &[NAN, INFINITE]),
        (
            "activation.interval",
            |m, v| m.activation.interval = v,
            &[f32::MIN_POSITIVE, 1e30],
            &[0.0, -1.0, NAN, INFINITE],
        ),
        (
            "march.stepsize",
            |m, v| m.march.stepsize = v,
            &[0.001],
            &[0.0, -1.0, NAN, INFINITE, 1e-7, 1e-30, f32::MIN_POSITIVE],
        ),
        (
            "march.voxel_size",
            |m, v| m.march.voxel_size = v,
            &[f32::MIN_POSITIVE],
            &[0.0, -1.0, NAN, INFINITE],
        ),
        (
            "march.near",
            |m, v| (m.march.near, m.march.far) = (v, None),
            &[0.0, 1e30],
            &[-1e-30, NAN, INFINITE],
        ),
        (
            "march.far",
            |m, v| (m.march.near, m.march.far) = (1.0, Some(v)),
            &[ABOVE_ONE],
            &[1.0, -1.0, NAN, INFINITE],
        ),
        (
            "march.color_threshold",
            |m, v| m.march.color_threshold = v,
            &[0.0, BELOW_ONE],
            &[1.0, -1e-30, NAN],
        ),
        (
            "march.alpha_threshold",
            |m, v| m.march.alpha_threshold = v,
            &[0.0, BELOW_ONE],
            &[1.0, -1e-30, NAN],
        ),
        ("alpha_threshold", |m, v| m.alpha_threshold = v, &[0.0, BELOW_ONE], &[1.0, -1e-30, NAN]),
        ("background", |m, v| m.background[2] = v, &[-5.0, 1e30], &[NAN, INFINITE]),
        (
            "level_of_detail",
            |m, v| m.level_of_detail.factor = v,
            &[f32::MIN_POSITIVE],
            &[0.0, -1.0, NAN, INFINITE],
        ),
        ("level_of_detail", |m, v| m.level_of_detail.bias = v, &[-5.0], &[NAN, INFINITE]),
        (
            "level_of_detail",
            |m, v| m.level_of_detail.bound = Some(v),
            &[0.0, 9.0],
            &[-1e-30, NAN, INFINITE],
        ),
        (
            "level_of_detail",
            |m, v| m.level_of_detail.bends = Bends::new(&[[0.5, v]]).expect("one"),
            &[-0.1, 3.0],
            &[-5.0, NAN, INFINITE],
        ),
        (
            "level_of_detail",
            |m, v| m.level_of_detail.bends = Bends::new(&[[0.5, 0.1], [v, 0.1]]).expect("two"),
            &[0.6],
            &[0.5, 0.4, NAN, INFINITE],
        ),
        (
            "levels[1].diffuse",
            |m, v| diffuse(m).max_error = v,
            &[0.0, 1e30],
            &[-1e-30, NAN, INFINITE],
        ),
    ];
    hold(&cases);
}

fn diffuse(metadata: &mut Metadata) -> &mut Encoding {
    metadata.levels[1].diffuse.as_mut().expect("colour")
}

#[test]
fn counts_are_held_to_their_ranges() {
    let cases: [Case<usize>; 12] = [
        ("features", |m, v| m.features = v, &[1, 61], &[62, usize::MAX]),
        ("view.widths", |m, v| network(m).widths[1] = v, &[4096], &[4097]),
        ("view.widths", |m, v| network(m).widths = vec![3; v], &[2, 32], &[0, 1, 33]),
        ("view.frequencies", |m, v| network(m).frequencies = v, &[0, 32], &[33]),
        ("levels", |m, v| m.levels = vec![m.levels[0].clone(); v], &[1, 32], &[0, 33]),
        (
            "levels[1].dimensions",
            |m, v| m.levels[1].dimensions[2] = m.levels[0].dimensions[2] + v,
            &[0],
            &[1],
        ),
        (
            "levels[0].dimensions",
            |m, v| {
                m.levels.truncate(1);
                (m.levels[0].dimensions[0], m.levels[0].blocks_stored) = (v, 0);
            },
            &[2, 65_536],
            &[0, 1, 65_537],
        ),
        (
            "levels[0].block_size",
            |m, v| (m.levels[0].block_size, m.levels[0].blocks_stored) = (v, 0),
            &[1, 64],
            &[0, 65],
        ),
        (
            "levels[0].blocks_stored",
            |m, v| m.levels[0].blocks_stored = m.levels[0].grid().total() + v,
            &[0],
            &[1],
        ),
        ("levels[1].diffuse", |m, v| diffuse(m).bits = v as u32, &[1, 8], &[0, 9]),
        (
            "levels[1].diffuse",
            |m, v| (diffuse(m).number, diffuse(m).bits) = (NumberType::U16, v as u32),
            &[9, 16],
            &[8, 17],
        ),
        (
            "levels[1].diffuse",
            |m, v| {
                let encoding = diffuse(m);
                (encoding.center, encoding.step, encoding.curve) = (0.0, 0.0, 0.0);
                (encoding.number, encoding.bits) = (NumberType::F32, v as u32);
                encoding.empty_code = false;
            },
            &[32],
            &[16, 31, 33],
        ),
    ];
    hold(&cases);
}

#[test]
fn parts_agree_with_each_other() {
    let cases: [Case<()>; 11] = [
        ("levels[1].diffuse", |m, ()| m.levels[1].diffuse = None, &[], &[()]),
        ("levels[1].features", |m, ()| m.levels[1].features = None, &[], &[()]),
        ("levels[0].features", |m, ()| m.features = 0, &[], &[()]),
        // Floats have no curve, no step, no centre and no code of their own for emptiness.
        ("levels[1].diffuse", |m, ()| float(m).center = 1.0, &[], &[()]),
        ("levels[1].diffuse", |m, ()| float(m).step = 1.0, &[], &[()]),
        ("levels[1].diffuse", |m, ()| float(m).curve = 1.0, &[], &[()]),
        ("levels[1].diffuse", |m, ()| float(m).empty_code = true, &[], &[()]),
        ("levels[1].diffuse", |m, ()| float(m).empty = NAN, &[], &[()]),
        // Codes ascend to finite values.
        ("levels[1].diffuse", |m, ()| (diffuse(m).step, diffuse(m).curve) = (0.0, 0.0), &[], &[()]),
        ("levels[1].diffuse", |m, ()| diffuse(m).step = 1e38, &[], &[()]),
        (
            "levels[1].diffuse",
            |m, ()| {
                float(m);
            },
            &[()],
            &[],
        ),
    ];
    hold(&cases);
    // Without density of its own a level cannot be mixed after activation, or not at all.
    let mut metadata = asset::container("tiny.code.mipvog").metadata().clone();
    assert_eq!(refused(&metadata), None);
    metadata.blend = Blend::AfterActivation;
    assert_eq!(refused(&metadata).as_deref(), Some("blend"));
    metadata.levels[0].density = None;
    metadata.blend = Blend::BeforeActivation;
    assert_eq!(refused(&metadata).as_deref(), Some("levels[0].density"));
}

/// The encoding as that of floats.
fn float(metadata: &mut Metadata) -> &mut Encoding {
    let encoding = diffuse(metadata);
    (encoding.center, encoding.step, encoding.curve) = (0.0, 0.0, 0.0);
    (encoding.number, encoding.bits, encoding.empty_code) = (NumberType::F16, 16, false);
    encoding
}

#[test]
fn values_mean_what_their_group_and_the_blend_allow() {
    for blend in [Blend::BeforeActivation, Blend::AfterActivation] {
        for decode in Decode::ALL {
            let mut metadata = sound();
            metadata.blend = blend;
            for level in &mut metadata.levels {
                level.density.as_mut().expect("density").decode = decode;
            }
            let fits = match blend {
                Blend::BeforeActivation => decode == Decode::Density(DensityDomain::Raw),
                Blend::AfterActivation => decode.density().is_some(),
            };
            let wrong = (!fits).then_some("levels[0].density");
            assert_eq!(refused(&metadata).as_deref(), wrong, "{blend:?} {decode:?}");
            let mut metadata = sound();
            let features = metadata.levels[2].features.as_mut().expect("features");
            features.decode = decode;
            let wrong = (decode != Decode::Logit).then_some("levels[2].features");
            assert_eq!(refused(&metadata).as_deref(), wrong, "{decode:?}");
        }
    }
}

#[test]
fn what_depends_on_the_direction_stands_only_where_it_can() {
    let shaped = |change: &dyn Fn(&mut Metadata)| {
        let mut metadata = asset::container("tiny.fit.filled.mipvog").metadata().clone();
        change(&mut metadata);
        refused(&metadata)
    };
    let key = |level: usize, name: &str| Some(format!("levels[{level}].{name}"));
    assert_eq!(shaped(&|_| {}), None);
    // A level without any, finer or coarser ones with it.
    assert_eq!(shaped(&|m| m.levels[2].anisotropy = None), None);
    assert_eq!(shaped(&|m| m.levels[1].directional = None), None);
    assert_eq!(shaped(&|m| m.levels[2].directional = None), key(1, "directional"));
    // Raw densities, another meaning, and a value for blocks that are not stored.
    let moved = |m: &mut Metadata| m.levels[0].anisotropy = m.levels[1].anisotropy.clone();
    assert_eq!(shaped(&moved), key(0, "anisotropy"));
    let set = |set: fn(&mut Encoding)| shaped(&|m| m.levels[1].anisotropy.iter_mut().for_each(set));
    assert_eq!(set(|encoding| encoding.decode = Decode::Directional), key(1, "anisotropy"));
    assert_eq!(set(|encoding| encoding.empty = 0.25), key(1, "anisotropy"));
}
