//! Measures the speed and the errors of the renderer.
//!
//! ```text
//! cargo bench --bench render -- [SCENE] [--cameras FILE] [--size WxH] [--frames NAME,...]
//!                               [--stepsize S] [--near T] [--far T] [--references DIR]
//! ```
//!
//! Renders a trained scene, and a container baked from it, and prints rays a second, samples a ray,
//! the share of samples that were skipped, how many times faster that is than the reference
//! implementation of the tests on some of the same pixels (the floor), and the largest differences
//! from it. `--references` names a folder of float64 renders, a file for each frame, to compare
//! with instead. Without arguments the scene is `fixtures/trained/lego64`.

mod arguments;
use mipvog_testing as common;

use std::path::{Path, PathBuf};
use std::time::Instant;

use arguments::{Arguments, number};
use common::plain_render::{PlainField, PlainLevel};
use common::rendered::{Differences, baked_levels, finest_level};
use common::{baked_bytes, open_bytes, tensor_values};
use mipvog::bake::BakeOptions;
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::model::camera::{self, Camera};
use mipvog::model::field::RadianceField;
use mipvog::view::render::{Frame, FrameOptions, LevelChoice, Renderer, Statistics, render};
use mipvog_inputs::tensor;

/// Each frame is rendered this often; the fastest counts.
const ROUNDS: usize = 5;
/// One pixel in so many is rendered by the reference implementation; a prime, so that they are
/// spread over rows.
const SUBSET: usize = 97;
/// Largest difference from the reference renders.
const BOUND: f32 = 2e-4;

fn main() {
    let arguments = Arguments::read(&["--cameras", "--size", "--frames", "--references"]);
    let field = arguments.field();
    let beside = arguments.scene.with_file_name("transforms_test.json");
    let cameras = arguments.own("--cameras").map_or(beside, PathBuf::from);
    let size = arguments.own("--size").map_or([400; 2], |size| {
        let (width, height) = size.split_once('x').expect("--size WxH");
        [number(width), number(height)]
    });
    let cameras = camera::read(&cameras, Some(size), &Limits::default());
    let frames: Vec<String> =
        arguments.own("--frames").unwrap_or("0").split(',').map(str::to_owned).collect();
    let cameras = cameras.expect("cameras").pick(&frames);
    let cameras = cameras.expect("frames of the camera file").cameras;
    match arguments.own("--references") {
        Some(folder) => compare_references(&field, &cameras, Path::new(folder)),
        None => measure(&field, &cameras),
    }
}

/// Speed and distance from the reference, of the scene and of a container baked from it.
fn measure(field: &RadianceField, cameras: &[Camera]) {
    let limits = Limits::default();
    let dense = Renderer::trained(field, None, &limits).expect("a field");
    report("dense", &dense, finest_level(field), cameras);
    let bytes = baked_bytes(field, &BakeOptions::default()).expect("a bake");
    let container = open_bytes(&bytes).expect("a container");
    let baked = container.read().expect("levels");
    let sparse = Renderer::baked(&baked, &limits).expect("a field");
    report("baked", &sparse, baked_levels(&baked), cameras);
}

fn report(name: &str, field: &Renderer, levels: Vec<PlainLevel>, cameras: &[Camera]) {
    let plain = PlainField::new(field.view(), levels);
    let mut statistics = Statistics::default();
    let (mut seconds, mut plain_seconds, mut plain_rays) = (0.0, 0.0, 0);
    let mut differences = Differences::default();
    for camera in cameras {
        let mut best = f64::INFINITY;
        let frame = (0..ROUNDS).map(|_| {
            let start = Instant::now();
            let frame = render(field, camera, &FrameOptions::default(), &Silent);
            best = best.min(start.elapsed().as_secs_f64());
            frame.expect("a frame")
        });
        let frame = frame.last().expect("a round");
        seconds += best;
        statistics += frame.statistics;
        let pixels: Vec<usize> = (0..frame.transmittance.len()).step_by(SUBSET).collect();
        let start = Instant::now();
        let here = Differences::of(&plain, camera, LevelChoice::Auto, &frame, &pixels);
        plain_seconds += start.elapsed().as_secs_f64();
        plain_rays += pixels.len();
        differences = differences.larger(here);
    }
    let Statistics { rays, samples, steps } = statistics;
    let rays_per_second = rays as f64 / seconds;
    let floor = plain_rays as f64 / plain_seconds;
    let per_ray = samples as f64 / rays as f64;
    let skipped = 100.0 * (1.0 - samples as f64 / steps.max(1) as f64);
    println!(
        "{name}: {:.2} Mrays/s, {per_ray:.1} samples a ray, {skipped:.1} % of samples skipped, {:.0} x \
         the floor of {floor:.0} rays/s ({plain_rays} rays)",
        rays_per_second / 1e6,
        rays_per_second / floor,
    );
    let Differences { color, transmittance, accumulated, .. } = differences;
    println!(
        "{name}: at most {color:.1e} from the reference in colour, {transmittance:.1e} in transmittance, \
         {accumulated:.1e} in accumulated values"
    );
}

/// Distance from reference renders, with the threshold on colour and without.
fn compare_references(field: &RadianceField, cameras: &[Camera], folder: &Path) {
    let limits = Limits::default();
    let mut field = Renderer::trained(field, None, &limits).expect("a field");
    let threshold = field.view().march.color_threshold;
    for camera in cameras {
        let file = folder.join(format!("{}.safetensors", camera.name));
        let file = tensor::open(&file, &limits).expect("a reference render");
        for (prefix, color_threshold) in [("", threshold), ("nothreshold.", 0.0)] {
            field.view_mut().march.color_threshold = color_threshold;
            let frame = render(&field, camera, &FrameOptions::default(), &Silent);
            let frame = frame.expect("a frame");
            let Frame { color, transmittance, accumulated, channels, .. } = &frame;
            let parts = [
                ("rgb", color.as_flattened(), 3),
                ("transmittance", transmittance, 1),
                ("accumulated", accumulated, *channels),
            ];
            for (part, got, channels) in parts {
                let name = format!("{prefix}{part}");
                let want = tensor_values(&file, &name).expect("the picture's tensor");
                assert_eq!(got.len(), want.len(), "--size must be that of the references");
                let error = |(got, want): (&f32, &f32)| (got - want).abs();
                let errors: Vec<f32> = got.iter().zip(&want).map(error).collect();
                let largest = errors.iter().copied().fold(0.0, f32::max);
                let pixels = errors.chunks_exact(channels);
                let count = pixels.len() as f64;
                let within = pixels.filter(|pixel| pixel.iter().all(|&error| error <= BOUND));
                let share = 100.0 * within.count() as f64 / count;
                println!(
                    "{}: {name:26} at most {largest:.1e}, {share:.3} % of pixels within {BOUND:.0e}",
                    camera.name
                );
            }
        }
    }
}
