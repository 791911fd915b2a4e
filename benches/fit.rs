//! Measures fits of levels: time against the renderer's, and errors against the default levels'.
//!
//! ```text
//! cargo bench --bench fit -- [SCENE] [--sides 128,256] [--stepsize S] [--near T] [--far T]
//!                            [--made-up foliage,wires,fog,full,empty,stick,slab]
//! ```
//!
//! Takes the scene, upsampled to each of the sides if any are given, or made-up scenes. Prints the
//! seconds of a bake with a fit, and of the default bake; how many pictures of level 0, of three
//! pixels for each node along the longest axis, the renderer makes in the time that a fit takes
//! longer; and PSNR at 1/1 to 1/16 of both, from ten cameras around the box that no fit has
//! seen, against the unbaked scene. Without arguments the scene is `fixtures/trained/lego64`.

mod arguments;
use mipvog_testing as common;
mod made_up;
#[allow(dead_code, reason = "scenes of this benchmark are of f32 alone")]
mod scaled;

use std::path::Path;
use std::time::Instant;

use arguments::{Arguments, number};
use common::{baked_bytes, open_bytes};
use mipvog::bake::{BakeOptions, Filter};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::model::camera::{Camera, turntable};
use mipvog::model::field::RadianceField;
use mipvog::view::compare::{Reference, compare};
use mipvog::view::render::{FrameOptions, LevelChoice, Renderer, render};
use mipvog_inputs::SourceOptions;
use scaled::Element;

/// Cameras of the errors and of the renderer's time.
const CAMERAS: usize = 10;
/// Pixels of their pictures for each node along the longest axis, so that full size is level 0's.
const PIXELS_A_NODE: usize = 3;
const SCALES: [usize; 5] = [1, 2, 4, 8, 16];

fn main() {
    let arguments = Arguments::read(&["--sides", "--made-up"]);
    println!("| scene | seconds | pictures | filter | 1/1 | 1/2 | 1/4 | 1/8 | 1/16 |");
    println!("|---|---|---|---|---|---|---|---|---|");
    if let Some(names) = arguments.own("--made-up") {
        names.split(',').for_each(|name| measure(name, &made_up::scene(name)));
        return;
    }
    let field = arguments.field();
    let Some(sides) = arguments.own("--sides") else { return measure("scene", &field) };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/scenes");
    std::fs::create_dir_all(&folder).expect("a folder that can be written");
    for side in sides.split(',').map(number) {
        let path = folder.join(format!("fit{side}.f32.safetensors"));
        scaled::write(&field, side, Element::F32, &path);
        let march = &field.scene.march;
        let (near, far) = (Some(march.near), march.far);
        let options = SourceOptions { stepsize: Some(0.5), near, far, ..SourceOptions::default() };
        let upsampled =
            mipvog_inputs::open_with(&path, &options, &Limits::default()).expect("a scene");
        measure(&format!("{side} nodes a side"), &upsampled.field);
    }
}

/// Bakes one scene with and without a fit, and prints both rows.
fn measure(name: &str, field: &RadianceField) {
    let longest = field.scene.nodes.0.into_iter().max().unwrap_or(2);
    let cameras = turntable(&field.scene.bounds, CAMERAS, [PIXELS_A_NODE * longest; 2]);
    let unbaked = Renderer::trained(field, None, &Limits::default()).expect("a field");
    let start = Instant::now();
    for camera in &cameras {
        let options = FrameOptions { levels: LevelChoice::Fixed(0), ..FrameOptions::default() };
        render(&unbaked, camera, &options, &Silent).expect("a frame");
    }
    let picture = start.elapsed().as_secs_f64() / CAMERAS as f64;
    let reference = Reference::Field(Box::new(unbaked));
    let plain = row(field, Filter::RateTent, &reference, &cameras);
    let fit = row(field, Filter::Fit, &reference, &cameras);
    println!("| {name} | {:.1} | | default | {} |", plain.0, plain.1);
    println!("| {name} | {:.1} | {:.0} | fit | {} |", fit.0, (fit.0 - plain.0) / picture, fit.1);
}

/// Seconds of a bake, and its errors.
fn row(
    field: &RadianceField,
    filter: Filter,
    reference: &Reference,
    cameras: &[Camera],
) -> (f64, String) {
    let options = BakeOptions { filter: filter.into(), ..BakeOptions::default() };
    let start = Instant::now();
    let bytes = baked_bytes(field, &options).expect("a bake");
    let seconds = start.elapsed().as_secs_f64();
    let baked = open_bytes(&bytes).expect("valid").read().expect("levels");
    let baked = Renderer::baked(&baked, &Limits::default()).expect("a field");
    let errors = compare(reference, &baked, cameras, &SCALES, 1, &Silent, |_| Ok(()));
    let errors = errors.expect("errors");
    let cells: Vec<String> = errors.iter().map(|scale| format!("{:.2}", scale.psnr)).collect();
    (seconds, cells.join(" | "))
}
