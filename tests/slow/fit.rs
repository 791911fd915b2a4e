//! Fitted levels: better than before the fit, and the same for any number of threads.

use crate::common;
use std::sync::OnceLock;

use crate::common::transcoded::changed;
use crate::common::{baked_bytes, open_bytes, trained};
use mipvog::bake::{BakeOptions, Changes, Filter, LevelRule};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::model::baked::LevelOfDetail;
use mipvog::model::camera::turntable;
use mipvog::model::field::RadianceField;
use mipvog::view::compare::{Reference, ScaleErrors, compare};
use mipvog::view::render::Renderer;
use serde_json::{Value, json};

fn options(filter: Filter, steps: usize) -> BakeOptions {
    BakeOptions { filter: filter.into(), fit_steps: steps, ..BakeOptions::default() }
}

/// Errors from cameras that no fit has seen, at the scales that read levels 1 to 3.
fn errors(field: &RadianceField, bytes: &[u8]) -> Vec<ScaleErrors> {
    let limits = Limits::default();
    let reference =
        Reference::Field(Box::new(Renderer::trained(field, None, &limits).expect("a field")));
    let baked = open_bytes(bytes).expect("valid").read().expect("levels");
    let baked = Renderer::baked(&baked, &limits).expect("a field");
    let cameras = turntable(&field.scene.bounds, 3, [96; 2]);
    compare(&reference, &baked, &cameras, &[2, 4, 8], 1, &Silent, |_| Ok(())).expect("errors")
}

/// The trained scene with fitted levels.
fn fitted() -> &'static [u8] {
    static FITTED: OnceLock<Vec<u8>> = OnceLock::new();
    FITTED.get_or_init(|| {
        let field = trained("lego64/fine_last.tar");
        baked_bytes(&field, &options(Filter::Fit, 40)).expect("a bake")
    })
}

#[test]
fn fitted_levels_are_closer_than_filtered_ones() {
    let field = trained("lego64/fine_last.tar");
    let filtered = baked_bytes(&field, &options(Filter::RateTent, 0)).expect("a bake");
    let (filtered, fitted) = (errors(&field, &filtered), errors(&field, fitted()));
    for (filtered, fitted) in filtered.iter().zip(&fitted) {
        // 40 of 150 steps reach more than half of the gain, which is 2 to 5 dB.
        assert!(fitted.psnr > filtered.psnr + 0.5, "{filtered:?} {fitted:?}");
    }
}

#[test]
fn the_fitted_rule_bends_and_says_so() {
    let container = open_bytes(fitted()).expect("valid");
    assert_eq!((container.header().version, container.header().features), ([1, 2], 4 + 8 + 16));
    let rule = container.metadata().level_of_detail;
    assert!(!rule.bends.is_empty() && rule.is_valid(), "{rule:?}");
    // Footprints are half as many voxels where voxels are twice as long.
    let fewer = Changes { without_finest: 1, ..Changes::default() };
    let fewer = changed(&container, &fewer).expect("represented");
    let after = fewer.metadata().level_of_detail;
    assert_eq!(fewer.header().features, 4 + 8 + 16);
    for size in [-1.0f32, 0.3, 1.0, 2.2, 3.7, 5.0] {
        let [old, new] = [rule.level(size), after.level(size - 1.0)];
        assert!((old - 1.0 - new).abs() < 1e-5, "{size}: {old}, {new}");
    }
    // A scale flattens the line and its bends alike; another rule has none.
    let flat = Changes { lod_scale: Some(0.5), ..Changes::default() };
    let flat = changed(&container, &flat).expect("represented").metadata().level_of_detail;
    assert_eq!(flat, rule.scaled(0.5));
    let mipmap = Changes { lod_rule: Some(LevelRule::Mipmap), ..Changes::default() };
    let mipmap = changed(&container, &mipmap).expect("represented");
    assert!(mipmap.metadata().level_of_detail.bends.is_empty());
    assert_eq!((mipmap.header().version, mipmap.header().features), ([1, 2], 8 + 16));
}

#[test]
fn bends_are_few() {
    let rule = |bends: Value| {
        let rule = json!({
            "aside": "same_distance", "bias": 0.1, "factor": 0.5, "most": null, "bends": bends,
        });
        serde_json::from_value::<LevelOfDetail>(rule)
    };
    let bend = |i: usize| json!([i, 0.1]);
    assert!(rule(json!([])).is_err());
    assert!(rule((0..7).map(bend).collect()).is_err());
    let most = rule((0..6).map(bend).collect()).expect("six");
    assert_eq!(most.bends.as_slice().len(), 6);
    assert!((most.level(2.5) - (0.1 + 1.25 + 0.1 * (2.5 + 1.5 + 0.5))).abs() < 1e-6);
}

#[test]
fn thread_count_never_shows_in_a_fit() {
    let field = trained("tiny/fine_last.tar");
    let bake = || baked_bytes(&field, &options(Filter::Fit, 6)).expect("a bake");
    let one = common::with_threads(1, bake);
    for threads in [2, 8] {
        assert!(one == common::with_threads(threads, bake), "{threads} threads");
    }
}
