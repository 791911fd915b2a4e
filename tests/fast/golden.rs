//! Golden containers: the bytes of this version. `BLESS=1 cargo test --test golden` rewrites them.

use crate::common::harmonic_field::{harmonic_field, rules};
use crate::common::world::world;
use crate::common::{assert_golden, baked_bytes, fixture, grid_values, open_bytes, trained};
use mipvog::bake::{BakeOptions, Filter};
use mipvog::model::field::{DensityFunction, RadianceField};
use mipvog::model::harmonics::{Clamp, Evaluation, Harmonics};
use mipvog::quantize::Bits;

#[test]
fn containers_keep_their_bytes() {
    let cases: [(&str, &str, Filter, Bits); 10] = [
        ("tiny.code.mipvog", "tiny/fine_last.tar", Filter::Code, Bits::Integer(8)),
        ("tiny.paper.mipvog", "tiny/fine_last.tar", Filter::Paper, Bits::Integer(8)),
        ("tiny.12bit.mipvog", "tiny/fine_last.tar", Filter::Paper, Bits::Integer(12)),
        ("tiny.rate.mipvog", "tiny/fine_last.tar", Filter::RateTent, Bits::Integer(8)),
        ("tiny.rate.f16.mipvog", "tiny/fine_last.tar", Filter::RateTent, Bits::F16),
        ("tiny.isotropic.mipvog", "tiny/fine_last.tar", Filter::Isotropic, Bits::Integer(8)),
        ("dvgo.coverage.mipvog", "dvgo/protocol2.tar", Filter::Coverage, Bits::Integer(12)),
        ("dvgo.mask.mipvog", "dvgo/protocol2.tar", Filter::Paper, Bits::Integer(8)),
        ("dvgo.f16.mipvog", "dvgo/protocol2.tar", Filter::Code, Bits::F16),
        ("dvgo.f32.mipvog", "dvgo/protocol2.tar", Filter::Paper, Bits::F32),
    ];
    for (name, scene, filter, bits) in cases {
        let options = BakeOptions { filter: filter.into(), bits, ..BakeOptions::default() };
        let bytes = baked_bytes(&trained(scene), &options).expect("a bake");
        assert_golden(&fixture("baked").join(name), &bytes);
    }
    let mut options = BakeOptions { max_error: Some(0.01.into()), ..BakeOptions::default() };
    let bytes = baked_bytes(&trained("tiny/fine_last.tar"), &options).expect("a bake");
    assert_golden(&fixture("baked/tiny.rate.error.mipvog"), &bytes);
    options.fill_error = Some(0.2);
    let bytes = baked_bytes(&trained("tiny/fine_last.tar"), &options).expect("a bake");
    assert_golden(&fixture("baked/tiny.rate.filled.mipvog"), &bytes);
    // With a rule that bends, directional brightness, which blocks inherit, and anisotropy.
    options.filter = Filter::Fit.into();
    (options.fit_steps, options.fill_error, options.max_error) = (60, Some(0.35), None);
    let bytes = baked_bytes(&trained("tiny/fine_last.tar"), &options).expect("a bake");
    let container = open_bytes(&bytes).expect("valid");
    assert_eq!(container.header().features, 1 + 4 + 8 + 16);
    assert_golden(&fixture("baked/tiny.fit.filled.mipvog"), &bytes);
}

#[test]
fn containers_with_linear_values_keep_their_bytes() {
    let nodes = [21, 18, 16];
    let plain = harmonic_field(nodes, rules(2));
    let bytes = baked_bytes(&plain, &BakeOptions::default()).expect("a bake");
    assert_golden(&fixture("baked/harmonics.mipvog"), &bytes);
    let (evaluation, clamp) = (Evaluation::Sample, Clamp::Sigmoid);
    let logits = harmonic_field(nodes, Harmonics { evaluation, clamp, ..rules(1) });
    let mut options = BakeOptions::default();
    (options.bits, options.fill_error) = (Bits::Integer(10), Some(0.1));
    let bytes = baked_bytes(&logits, &options).expect("a bake");
    assert_golden(&fixture("baked/harmonics.filled.mipvog"), &bytes);
    let degree_3 = harmonic_field([12, 9, 11], rules(3));
    (options.bits, options.fill_error) = (Bits::F16, None);
    let bytes = baked_bytes(&degree_3, &options).expect("a bake");
    assert_golden(&fixture("baked/harmonics.f16.mipvog"), &bytes);
    let colors = grid_values(&plain.color[0]).iter().map(|value| 0.5 + 0.28 * value).collect();
    let field = RadianceField::builder(nodes, grid_values(&plain.density), colors)
        .density_function(DensityFunction::Relu)
        .linear_colors();
    let field = field.build().expect("a field");
    let bytes = baked_bytes(&field, &BakeOptions::default()).expect("a bake");
    assert_golden(&fixture("baked/linear.mipvog"), &bytes);
}

#[test]
fn containers_of_nested_boxes_keep_their_bytes() {
    let bytes = baked_bytes(&world(33, 3), &BakeOptions::default()).expect("a bake");
    assert_golden(&fixture("baked/boxes.mipvog"), &bytes);
    // With blocks that inherit, also in shells.
    let options = BakeOptions { fill_error: Some(0.2), ..BakeOptions::default() };
    let bytes = baked_bytes(&world(17, 2), &options).expect("a bake");
    assert_golden(&fixture("baked/boxes.filled.mipvog"), &bytes);
    // Of boxes up to 512 times as large.
    let bytes = baked_bytes(&world(13, 9), &BakeOptions::default()).expect("a bake");
    assert_golden(&fixture("baked/boxes.deep.mipvog"), &bytes);
}
