//! Bakes of every family, many times by many threads: what waits for itself does so now and then.
//! And an eye that looks nowhere.

use crate::common::families::{self, models, open};
use crate::common::models::renderer;
use crate::common::{baked_bytes, folder, open_bytes};
use mipvog::bake::BakeOptions;
use mipvog::base::progress::Silent;
use mipvog::view::compare::compare_directions;
use mipvog::view::render::Renderer;

#[test]
fn bytes_do_not_depend_on_threads_and_no_bake_waits_for_itself() {
    families::bytes_do_not_depend_on_threads(&[1, 2, 16], 20);
}

#[test]
fn an_eye_in_the_middle_of_the_box_looks_nowhere_and_ends() {
    let here = folder();
    for (family, path) in models(here.path()) {
        let source = open(family, &path);
        let bounds = source.field.scene.bounds;
        let middle =
            [0, 1, 2].map(|axis| 0.5 * (f64::from(bounds.min[axis]) + f64::from(bounds.max[axis])));
        let bytes = baked_bytes(&source.field, &BakeOptions::default()).expect("a bake");
        let baked = open_bytes(&bytes).expect("a container");
        let baked = Renderer::of_container(&baked).expect("a field");
        // The first ray aims at the very middle.
        let errors = compare_directions(&renderer(&source), &baked, &[middle], &Silent);
        let psnr = errors.expect("errors").psnr;
        assert!(psnr.is_none_or(|psnr| !psnr.is_nan()), "{}: {psnr:?}", path.display());
    }
}
