//! Worlds: boxes around a field's own.

use mipvog::bake::{BakeOptions, bake};
use mipvog::base::bytes::WriterSink;
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::container::Container;
use mipvog::model::camera::Camera;
use mipvog::model::field::RadianceField;
use mipvog::view::render::Renderer;
use mipvog_testing::world::world;
use mipvog_testing::{open_bytes, origin};

fn baked(field: &RadianceField, options: &BakeOptions) -> Container {
    let mut bytes = Vec::new();
    bake(field, options, &origin(), &mut WriterSink::new(&mut bytes), &Silent).expect("a bake");
    open_bytes(&bytes).expect("a container")
}

/// Cameras inside, looking around.
fn cameras(pixels: usize) -> Vec<Camera> {
    let looks = [[1.0, 0.2, 0.0], [-0.7, 0.7, 0.2], [0.1, -1.0, -0.2], [0.5, 0.5, 0.8]];
    let places = [[-0.6, -0.4, 0.2], [0.5, -0.5, 0.0], [0.0, 0.8, 0.3], [0.6, 0.6, -0.2]];
    let camera = |(from, to)| Camera::look_at(from, to, 60.0, [pixels; 2]).expect("a camera");
    places.into_iter().zip(looks).map(camera).collect()
}

#[test]
fn a_world_looks_as_it_did() {
    let field = world(65, 3);
    let unbaked = Renderer::trained(&field, None, &Limits::default()).expect("a renderer");
    let container = baked(&field, &BakeOptions::default());
    let renderer = Renderer::of_container(&container).expect("levels");
    println!(
        "{:?}",
        container
            .metadata()
            .parts()
            .map(|level| (level.dimensions, level.blocks_stored))
            .collect::<Vec<_>>()
    );
    for camera in cameras(256) {
        let [a, b] = [&unbaked, &renderer].map(|of| of.picture(&camera).expect("a picture"));
        let mut sum = 0.0;
        for (a, b) in a.color.iter().flatten().zip(b.color.iter().flatten()) {
            sum += f64::from((a - b) * (a - b));
        }
        println!(
            "{:.2} dB {:?} {:?}",
            -10.0 * (sum / (3.0 * a.color.len() as f64)).log10(),
            a.statistics,
            b.statistics
        );
    }
}
