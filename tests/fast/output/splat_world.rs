//! Splats of nested boxes.

use std::path::PathBuf;

use mipvog::bake::BakeOptions;
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::container::Container;
use mipvog::model::camera::{Camera, Lens, direction};
use mipvog::view::render::Renderer;
use mipvog_outputs::export_files::ExportFiles;
use mipvog_outputs::format::{ExportFormat as _, ExportOptions, ExportSource};
use mipvog_outputs::measure::export_errors;
use mipvog_outputs::splat::Splat;
use mipvog_testing::world::world;
use serde_json::Value;

use crate::bake::nested::baked;
use crate::common::folder;

/// Cameras inside that look all around, each from one of two places.
fn cameras(count: usize, from: usize) -> Vec<Camera> {
    let lens = Lens::centered([40; 2], 0.6);
    let camera = |number: usize| {
        let up = 1.0 - (2 * number + 1) as f64 / count as f64;
        let back = direction(2.4 * number as f64, up.asin());
        let eye = glam::DVec3::from([[-0.6, -0.4, 0.2], [0.5, -0.5, 0.0]][(number + from) % 2]);
        Camera::looking_at(eye - back, back, 1.0, number.to_string(), lens)
    };
    (0..count).map(camera).collect()
}

/// The splats of a field of a container: their details, and their distance from pictures of all of
/// the container, in dB.
fn exported(container: &Container, whole: bool) -> (Value, f64) {
    let read = container.read().expect("levels");
    let field = match whole {
        true => Renderer::of_container(container),
        false => Renderer::baked(&read.one_box(0), &Limits::default()),
    };
    let source = ExportSource {
        field: field.expect("a renderer"),
        name: "world".to_owned(),
        sha256: String::new(),
        path: PathBuf::new(),
        world: whole.then(|| container.metadata().clone()),
        container: None,
    };
    let options =
        ExportOptions { cameras: cameras(24, 0), splats: Some(6000), ..ExportOptions::default() };
    let folder = folder();
    let output = folder.path().join("a.spz");
    Splat.check(&source, &options, &output).expect("sound options");
    let mut files = ExportFiles::new(&output, false);
    let written = Splat.write(&source, &options, &mut files, &Silent).expect("written");
    let shown = Splat.read_back(&source, &files.written(), &Limits::default()).expect("read");
    let all = Renderer::of_container(container).expect("a renderer");
    let errors = export_errors(&all, &*shown, &cameras(9, 1), 0, &Silent).expect("pictures");
    (written.details.into(), errors.pooled_psnr)
}

#[test]
fn splats_of_a_world_show_all_of_its_boxes() {
    let container = baked(&world(25, 3), &BakeOptions::default());
    let (details, decibels) = exported(&container, true);
    assert_eq!(details["boxes"], 4);
    let count = details["splats"].as_u64().expect("a number");
    assert!((3000..=6000).contains(&count), "{details}");
    let (inner, inner_decibels) = exported(&container, false);
    assert_eq!(inner["boxes"], 1);
    assert!(decibels > 29.0, "{decibels} dB");
    assert!(decibels > inner_decibels + 6.0, "{decibels} dB, the inner box alone {inner_decibels}");
}
