//! Colours as harmonics, linear colours and densities that are no logits, through the whole program.

use crate::common;
use crate::common::harmonic_field::{harmonic_field, rules};
use crate::common::transcoded::{baked, changed, changed_bytes, difference, picture};
use crate::common::{baked_bytes, open_bytes, packed, unpack};
use mipvog::bake::{BakeOptions, Changes, Filter, MaxErrors};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::container::Container;
use mipvog::model::baked::{Decode, Group};
use mipvog::model::camera::{Camera, turntable};
use mipvog::model::field::RadianceField;
use mipvog::model::harmonics::{Clamp, Evaluation, Harmonics};
use mipvog::quantize::Bits;
use mipvog::view::compare::{Reference, compare};
use mipvog::view::render::Renderer;

const NODES: [usize; 3] = [48, 44, 40];

fn cameras(field: &RadianceField) -> Vec<Camera> {
    turntable(&field.scene.bounds, 3, [128; 2])
}

/// A container of level 0 alone.
fn finest(field: &RadianceField, bits: Bits) -> Container {
    baked(field, |options| (options.bits, options.levels) = (bits, Some(1)))
}

/// PSNR at these scales of a container against its unbaked field.
fn psnr(field: &RadianceField, container: &Container, scales: &[usize]) -> Vec<f64> {
    let limits = Limits::default();
    let reference = Renderer::trained(field, None, &limits).expect("a field");
    let reference = Reference::Field(Box::new(reference));
    let baked = Renderer::of_container(container).expect("a container");
    let errors = compare(&reference, &baked, &cameras(field), scales, 1, &Silent, |_| Ok(()))
        .expect("errors");
    errors.iter().map(|errors| errors.psnr).collect()
}

#[test]
fn exact_numbers_give_the_same_pictures() {
    for degree in 0..=3 {
        let field = harmonic_field(NODES, rules(degree));
        let container = finest(&field, Bits::F32);
        let renderer = Renderer::of_field(&field).expect("a field");
        for camera in cameras(&field) {
            let unbaked = renderer.picture(&camera).expect("a picture");
            let most = difference(&unbaked, &picture(&container, &camera));
            // Blocks below the threshold of opacity are dropped.
            assert!(most < 1e-3, "degree {degree}: {most}");
        }
    }
}

#[test]
fn eight_bits_keep_fifty_decibels() {
    for degree in 1..=3 {
        let field = harmonic_field(NODES, rules(degree));
        let found = psnr(&field, &finest(&field, Bits::Integer(8)), &[1])[0];
        assert!(found > 50.0, "degree {degree}: {found} dB");
    }
}

#[test]
fn clamps_at_samples_survive() {
    for clamp in [Clamp::Zero, Clamp::None, Clamp::Sigmoid] {
        let harmonics = Harmonics { degree: 2, evaluation: Evaluation::Sample, offset: 0.1, clamp };
        let field = harmonic_field(NODES, harmonics);
        let container = finest(&field, Bits::Integer(8));
        let view = container.metadata().view_dependence(None).expect("harmonics");
        assert_eq!(view.harmonics(), Some(&harmonics));
        let found = psnr(&field, &container, &[1])[0];
        assert!(found > 48.0, "{clamp:?}: {found} dB");
    }
}

#[test]
fn linear_colours_need_no_harmonics() {
    let whole = harmonic_field(NODES, rules(0));
    let colors = common::grid_values(&whole.color[0]);
    let colors = colors.iter().map(|value| 0.5 + 0.282 * value).collect();
    let density = common::grid_values(&whole.density);
    let field = RadianceField::builder(NODES, density, colors)
        .density_function(whole.scene.activation.function)
        .linear_colors()
        .build()
        .expect("a field");
    let container = finest(&field, Bits::Integer(8));
    assert!(container.metadata().view.is_none());
    let diffuse = container.metadata().levels[0].diffuse.as_ref().expect("colours");
    assert_eq!(diffuse.decode, Decode::Linear);
    assert!(psnr(&field, &container, &[1])[0] > 50.0);
}

#[test]
fn coarser_levels_look_right_from_afar() {
    let field = harmonic_field(NODES, rules(2));
    let filters = [(Filter::RateTent, 28.0), (Filter::Coverage, 24.0), (Filter::Paper, 15.0)];
    for (filter, least) in filters {
        let container = baked(&field, |options| options.filter = filter.into());
        let found = psnr(&field, &container, &[4, 8]);
        assert!(found.iter().all(|&psnr| psnr > least), "{filter:?}: {found:?}");
    }
}

#[test]
fn a_fit_improves_harmonics() {
    let field = harmonic_field([32; 3], rules(2));
    let bake = |filter: Filter| {
        let container = baked(&field, |options| {
            options.filter = filter.into();
            options.fit_steps = 60;
        });
        psnr(&field, &container, &[2, 4])
    };
    let (filtered, fitted) = (bake(Filter::RateTent), bake(Filter::Fit));
    for (filtered, fitted) in filtered.iter().zip(&fitted) {
        assert!(fitted > filtered, "{filtered} {fitted}");
    }
}

#[test]
fn every_band_keeps_its_own_error() {
    let field = harmonic_field(NODES, rules(3));
    let errors = MaxErrors::new(0.02, 0.004, 0.01).with_bands(0.02, 0.04);
    let container = baked(&field, |options| {
        (options.max_error, options.levels) = (Some(errors), Some(1));
    });
    let level = &container.metadata().levels[0];
    let mut steps = Vec::new();
    for (group, most) in [
        (Group::Diffuse, 0.004),
        (Group::Band(1), 0.01),
        (Group::Band(2), 0.02),
        (Group::Band(3), 0.04),
    ] {
        let encoding = level.encoding(group).expect("a band");
        assert!(encoding.max_error <= most && encoding.max_error > 0.3 * most, "{encoding:?}");
        steps.push(encoding.step);
    }
    assert!(steps.windows(2).skip(1).all(|pair| pair[0] < pair[1]), "{steps:?}");
    let found = psnr(&field, &container, &[1])[0];
    assert!(found > 40.0, "{found} dB");
}

#[test]
fn unpacked_harmonics_pack_to_the_same_bytes() {
    for (degree, bits) in
        [(1, Bits::Integer(8)), (2, Bits::Integer(10)), (3, Bits::F16), (2, Bits::F32)]
    {
        let field = harmonic_field([19, 22, 9], rules(degree));
        let options = BakeOptions {
            bits,
            fill_error: Some(0.02).filter(|_| bits == Bits::Integer(8)),
            ..BakeOptions::default()
        };
        let bytes = baked_bytes(&field, &options).expect("a bake");
        let unpacked = unpack(&open_bytes(&bytes).expect("valid")).expect("unpacks");
        let features = unpacked.get("level0.features").expect("the higher bands");
        assert_eq!(features.len(), rules(degree).features() * 19 * 22 * 9);
        let input =
            mipvog_inputs::unpacked::open(unpacked.file(), &Limits::default()).expect("an input");
        let again = packed(&input, &Changes::default()).expect("packs");
        assert!(again == bytes, "degree {degree}, {bits} bits");
    }
}

#[test]
fn containers_with_harmonics_change_as_others_do() {
    let field = harmonic_field(NODES, rules(2));
    let container = baked(&field, |_| ());
    let same = Changes { bits: Some(Bits::Integer(8)), ..Changes::default() };
    let same = changed(&container, &same).expect("the same bits");
    assert_eq!(same.metadata().levels, container.metadata().levels);
    let fewer = Changes { bits: Some(Bits::Integer(6)), ..Changes::default() };
    let smaller = changed(&container, &fewer).expect("fewer bits");
    assert!(smaller.header().file_length < container.header().file_length);
    assert!(psnr(&field, &smaller, &[1])[0] > 35.0);
    let bytes = changed_bytes(&container, &Changes { levels: Some(2), ..Changes::default() });
    assert!(open_bytes(&bytes.expect("two levels")).is_ok());
    let errors = Changes { max_error: Some(MaxErrors::from(0.03)), ..Changes::default() };
    assert!(changed(&container, &errors).is_ok());
}

#[test]
fn the_header_says_just_what_the_values_need() {
    let tiny = common::trained("tiny/fine_last.tar");
    let isotropic = |options: &mut BakeOptions| options.filter = Filter::Isotropic.into();
    let logits = baked(&tiny, isotropic);
    assert_eq!((logits.header().version, logits.header().features), ([1, 0], 0));
    // Bends, directional brightness and anisotropy.
    let directional = baked(&tiny, |_| ());
    assert_eq!((directional.header().version, directional.header().features), ([1, 2], 28));
    let harmonics = baked(&harmonic_field([9; 3], rules(1)), isotropic);
    assert_eq!((harmonics.header().version, harmonics.header().features), ([1, 2], 2));
}

#[test]
fn thread_count_never_shows() {
    let field = harmonic_field([24, 17, 20], rules(2));
    let bake = || baked_bytes(&field, &BakeOptions::default()).expect("a bake");
    let one = common::with_threads(1, bake);
    assert!([2, 5].into_iter().all(|threads| one == common::with_threads(threads, bake)));
}
