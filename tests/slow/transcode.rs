//! `transcode` on a trained scene: levels that are left out, and sizes that are searched for.

use crate::common;
use crate::common::transcoded::{baked, changed, changed_bytes, difference, from_afar, picture};
use crate::common::{baked_bytes, open_bytes, trained};
use mipvog::bake::{BakeOptions, Changes, Filter};
use mipvog::quantize::Bits;

#[test]
fn pictures_from_afar_stay_without_the_finest_levels() {
    let scene = trained("lego64/fine_last.tar");
    // Footprints that read no level finer than the first one that stays.
    let few = &[Bits::Integer(8)][..];
    let cases = [
        (Filter::RateTent, 1, 6.0, &[Bits::Integer(8), Bits::F16, Bits::F32][..]),
        (Filter::RateTent, 2, 20.0, &[Bits::Integer(12)]),
        (Filter::Fit, 1, 8.0, few),
        (Filter::Paper, 1, 9.0, few),
    ];
    for (filter, count, rho, numbers) in cases {
        for &bits in numbers {
            let container = baked(&scene, |options| {
                (options.filter, options.bits, options.fit_steps) = (filter.into(), bits, 0);
            });
            let changes = Changes { without_finest: count, ..Changes::default() };
            let fewer = changed(&container, &changes).expect("represented");
            let (before, after) = (container.metadata(), fewer.metadata());
            assert_eq!(after.levels.len(), before.levels.len() - count);
            for (after, before) in after.levels.iter().zip(&before.levels[count..]) {
                assert_eq!(after.dimensions, before.dimensions);
                assert_eq!(after.blocks_stored, before.blocks_stored);
            }
            let camera = from_afar(before, rho);
            let (old, new) = (picture(&container, &camera), picture(&fewer, &camera));
            let seen: Vec<usize> = (0..24 * 24).filter(|&i| old.transmittance[i] < 0.9).collect();
            assert!(!seen.is_empty());
            let margin = count as f32 + 0.05;
            let level = |i: usize| old.level[i] / (1.0 - old.transmittance[i]);
            assert!(seen.iter().all(|&i| level(i) > margin), "{filter:?} {count}");
            // Half floats of scaled values are others.
            let most = if bits == Bits::F16 { 1e-3 } else { 2e-5 };
            let moved = difference(&old, &new);
            assert!(moved <= most, "{filter:?} {bits} {count}: {moved}");
        }
    }
}

#[test]
fn the_best_that_fits_is_found_and_always_the_same() {
    let scene = trained("lego64/fine_last.tar");
    let container = baked(&scene, |_| {});
    let whole = container.file().length();
    let with = |max_bytes| Changes { max_bytes: Some(max_bytes), ..Changes::default() };
    // It fits as it is.
    let same = changed(&container, &with(whole)).expect("fits");
    assert_eq!(same.read().expect("valid").levels, container.read().expect("valid").levels);
    for (share, levels) in [(0.6, 5), (0.1, 4)] {
        let most = (whole as f64 * share) as u64;
        let bytes = changed_bytes(&container, &with(most)).expect("fits");
        assert!(bytes.len() as u64 <= most && bytes.len() as f64 > 0.85 * most as f64, "{share}");
        let again = common::with_threads(3, || changed_bytes(&container, &with(most)));
        assert!(bytes == again.expect("fits"));
        assert_eq!(open_bytes(&bytes).expect("valid").metadata().levels.len(), levels);
        // A bake finds its own, from the trained values.
        let own = baked(&scene, |options| options.max_bytes = Some(most));
        assert!(own.file().length() <= most && own.metadata().levels.len() == levels);
    }
    let error = changed(&container, &with(500)).expect_err("too little");
    assert!(error.to_string().contains("option max_bytes: found 500"), "{error}");
    let options = BakeOptions { max_bytes: Some(500), ..BakeOptions::default() };
    let error = baked_bytes(&scene, &options).expect_err("too little");
    assert!(error.to_string().contains("the smallest container"), "{error}");
}
