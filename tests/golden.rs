//! Golden containers: the bytes of this version. `BLESS=1 cargo test --test golden` rewrites them.

mod common;

use common::{assert_golden, baked_bytes, fixture, trained};
use mipvog_bake::unstable::bake::{BakeOptions, Filter};
use mipvog_bake::unstable::codec::quantize::Bits;

#[test]
fn containers_keep_their_bytes() {
    let cases: [(&str, &str, Filter, Bits); 9] = [
        ("tiny.code.mipvog", "tiny/fine_last.tar", Filter::Code, Bits::Integer(8)),
        ("tiny.paper.mipvog", "tiny/fine_last.tar", Filter::Paper, Bits::Integer(8)),
        ("tiny.12bit.mipvog", "tiny/fine_last.tar", Filter::Paper, Bits::Integer(12)),
        ("tiny.rate.mipvog", "tiny/fine_last.tar", Filter::RateTent, Bits::Integer(8)),
        ("tiny.rate.f16.mipvog", "tiny/fine_last.tar", Filter::RateTent, Bits::F16),
        ("dvgo.coverage.mipvog", "dvgo/protocol2.tar", Filter::Coverage, Bits::Integer(12)),
        ("dvgo.mask.mipvog", "dvgo/protocol2.tar", Filter::Paper, Bits::Integer(8)),
        ("dvgo.f16.mipvog", "dvgo/protocol2.tar", Filter::Code, Bits::F16),
        ("dvgo.f32.mipvog", "dvgo/protocol2.tar", Filter::Paper, Bits::F32),
    ];
    for (name, scene, filter, bits) in cases {
        let mut options = BakeOptions::default();
        options.filter = filter.into();
        options.bits = bits;
        let bytes = baked_bytes(&trained(scene), &options).expect("a bake");
        assert_golden(&fixture("baked").join(name), &bytes);
    }
    let mut options = BakeOptions::default();
    options.max_error = Some(0.01.into());
    let bytes = baked_bytes(&trained("tiny/fine_last.tar"), &options).expect("a bake");
    assert_golden(&fixture("baked/tiny.rate.error.mipvog"), &bytes);
    options.fill_error = Some(0.2);
    let bytes = baked_bytes(&trained("tiny/fine_last.tar"), &options).expect("a bake");
    assert_golden(&fixture("baked/tiny.rate.filled.mipvog"), &bytes);
}
