//! What rays see of a model, of its plain rules in float64, and of a bake of it.

use crate::common::folder;
use mipvog::bake::{BakeOptions, Baker};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::container::Container;
use mipvog::model::camera::Ray;
use mipvog::quantize::Bits;
use mipvog::view::render::Renderer;
use mipvog_inputs::Source;

/// Rays see what `plain` computes from an origin and a direction: a colour, and the light that is
/// left. A quarter of the rays is stopped, lest they miss the scene.
pub fn rays_see(
    model: &Renderer,
    rays: &[Ray],
    plain: impl Fn([f64; 3], [f64; 3]) -> ([f64; 3], f64),
) {
    let light = model.ray_colors(rays, 0, &Silent).expect("rays");
    let mut hits = 0;
    for (ray, found) in rays.iter().zip(light) {
        let (color, visible) = plain(ray.origin.to_array(), ray.direction.to_array());
        hits += usize::from(visible < 0.5);
        let left = (f64::from(found.transmittance) - visible).abs();
        let off = (0..3).map(|c| (f64::from(found.color[c]) - color[c]).abs());
        let off = off.fold(0.0, f64::max);
        assert!(left < 1e-5 && off < 1e-5, "{left} {off} {found:?} for {color:?} {visible}");
    }
    assert!(hits > rays.len() / 4, "{hits} rays hit the scene");
}

/// Level 0 of the source, baked with values in float32.
pub fn baked(source: &Source) -> Renderer {
    let mut options = BakeOptions::default();
    (options.bits, options.levels) = (Bits::F32, Some(1));
    let here = folder();
    let path = here.path().join("scene.mipvog");
    Baker::new(options).to_file(source, &path, false).expect("a bake");
    let container = Container::open_path(&path, &Limits::default()).expect("a container");
    Renderer::of_container(&container).expect("a field")
}
