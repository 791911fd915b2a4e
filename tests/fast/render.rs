//! The reference renderer against an independent float64 renderer (`fixtures/golden`).

use crate::common::{baked_bytes, fixture, open_bytes, tensor_values, trained};
use glam::{DMat4, DVec4};
use mipvog::bake::{BakeOptions, Filter};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::model::camera::{self, Camera, Lens};
use mipvog::quantize::Bits;
use mipvog::view::render::{Frame, FrameOptions, Renderer, TrainedLevels, render};
use mipvog_inputs::tensor::{self, TensorFile};

/// The bound on colour, transmittance and features.
const BOUND: f32 = 2e-4;

fn vectors(file: &str) -> TensorFile {
    tensor::open(&fixture(file), &Limits::default()).expect("vectors")
}

fn camera(rows: &[f32], size: usize, focal: f64) -> Camera {
    let row = |i: usize| DVec4::from_array(std::array::from_fn(|j| rows[4 * i + j].into()));
    Camera {
        name: String::new(),
        to_world: DMat4::from_cols(row(0), row(1), row(2), row(3)).transpose(),
        lens: Lens { width: size, height: size, focal: [focal; 2], center: [size as f64 / 2.0; 2] },
        picture: None,
    }
}

/// Values of each list that differ by more than `bound`, and the largest difference.
fn beyond(got: impl IntoIterator<Item = f32>, want: &[f32], bound: f32) -> (usize, f32) {
    let mut count = 0;
    let (mut over, mut largest) = (0, 0.0f32);
    for (got, want) in got.into_iter().zip(want) {
        let error = (got - want).abs();
        over += usize::from(error > bound || error.is_nan());
        largest = largest.max(error);
        count += 1;
    }
    assert_eq!(count, want.len());
    (over, largest)
}

fn colors(frame: &Frame) -> impl Iterator<Item = f32> {
    frame.color.as_flattened().iter().copied()
}

#[test]
fn trained_fields_with_and_without_levels_equal_the_oracle() {
    let vectors = vectors("golden/render.safetensors");
    let mut field = trained("tiny/fine_last.tar");
    field.scene.march.near = 0.5;
    field.scene.march.far = Some(8.0);
    let limits = Limits::default();
    let plain = Renderer::trained(&field, None, &limits).expect("a field");
    let levels = TrainedLevels::of_training(&Filter::Code, &field.scene);
    let mips = Renderer::trained(&field, Some(levels), &limits).expect("a field");
    let mut options = BakeOptions::default();
    (options.filter, options.bits, options.alpha_threshold) =
        (Filter::Code.into(), Bits::F32, 1e-9);
    let baked = baked_bytes(&field, &options).expect("a bake");
    let baked = open_bytes(&baked).expect("a container").read().expect("levels");
    let baked = Renderer::baked(&baked, &limits).expect("a field");
    let matrices = tensor_values(&vectors, "cameras.c2w").expect("cameras");
    for (view, matrix) in matrices.chunks(16).enumerate() {
        for (name, size, focal) in [("full", 48, 66.0), ("half", 24, 33.0), ("quarter", 12, 16.5)] {
            let camera = camera(matrix, size, focal);
            let want = |part: &str| {
                tensor_values(&vectors, &format!("view{view}.{name}.{part}")).expect("a vector")
            };
            let frame =
                render(&plain, &camera, &FrameOptions::default(), &Silent).expect("a frame");
            let (over, most) = beyond(colors(&frame), &want("rgb"), BOUND);
            // The weight threshold is a step: a sample on it falls to either side.
            assert!(over * 1000 <= 3 * size * size, "view {view} {name} rgb: {over}, {most}");
            let (over, most) = beyond(frame.transmittance.clone(), &want("transmittance"), BOUND);
            assert_eq!(over, 0, "view {view} {name} transmittance: {most}");
            let (over, most) = beyond(frame.accumulated.clone(), &want("accumulated"), BOUND);
            assert!(
                over * 1000 <= 7 * size * size,
                "view {view} {name} accumulated: {over}, {most}"
            );
            let (over, most) = beyond(frame.distance.clone(), &want("depth"), 1e-3);
            assert_eq!(over, 0, "view {view} {name} depth: {most}");
            for mips in [&mips, &baked] {
                let options = FrameOptions::default();
                let frame = render(mips, &camera, &options, &Silent).expect("a frame");
                let place = format!("view {view} {name} mip");
                let (over, most) = beyond(colors(&frame), &want("mip.rgb"), BOUND);
                assert!(over * 1000 <= 3 * size * size, "{place} rgb: {over}, {most}");
                let (over, most) = beyond(frame.level.clone(), &want("mip.lod"), 1e-3);
                assert_eq!(over, 0, "{place} lod: {most}");
            }
        }
    }
}

/// A really trained scene, and a float64 renderer's pictures of it without the threshold on colour,
/// which is a step.
#[test]
fn every_pixel_of_a_trained_scene_equals_the_oracle() {
    let mut field = trained("lego64/fine_last.tar");
    field.scene.march.near = 2.0;
    field.scene.march.far = Some(6.0);
    field.scene.march.color_threshold = 0.0;
    let limits = Limits::default();
    let cameras = fixture("trained/lego64/transforms_test.json");
    let cameras = camera::read(&cameras, Some([200; 2]), &limits).expect("cameras");
    let cameras = cameras.pick(&[]).expect("frames").cameras;
    assert_eq!(cameras[0].name, "r_0");
    let field = Renderer::trained(&field, None, &limits).expect("a field");
    let frame = render(&field, &cameras[0], &FrameOptions::default(), &Silent).expect("a frame");
    let vectors = vectors("golden/lego64.safetensors");
    let want =
        |part: &str| tensor_values(&vectors, &format!("nothreshold.{part}")).expect("a vector");
    assert_eq!(beyond(colors(&frame), &want("rgb"), BOUND).0, 0);
    let transmittance = frame.transmittance.iter().copied();
    assert_eq!(beyond(transmittance, &want("transmittance"), BOUND).0, 0);
    let accumulated = frame.accumulated.iter().copied();
    assert_eq!(beyond(accumulated, &want("accumulated"), BOUND).0, 0);
}
