//! Containers that are changed without the checkpoint, and their pictures.

use mipvog::bake::{BakeOptions, Changes, repack};
use mipvog::base::bytes::{ByteSink, WriterSink};
use mipvog::base::error::Result;
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::container::Container;
use mipvog::model::baked::Metadata;
use mipvog::model::camera::Camera;
use mipvog::model::field::RadianceField;
use mipvog::unpacked::Unpacked;
use mipvog::view::render::{Frame, Renderer};

use super::{baked_bytes, open_bytes};

/// A container with these changes.
pub fn changed(container: &Container, changes: &Changes) -> Result<Container> {
    open_bytes(&changed_bytes(container, changes)?)
}

/// Its bytes.
pub fn changed_bytes(container: &Container, changes: &Changes) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut sink = WriterSink::new(&mut bytes);
    let unpacked = Unpacked::of_container(container)?;
    let report = repack(&unpacked, changes, &Limits::default(), &mut sink, &Silent)?;
    assert_eq!(report.output_bytes, sink.length());
    Ok(bytes)
}

/// A baked container, with options that differ from the usual ones.
pub fn baked(field: &RadianceField, change: impl FnOnce(&mut BakeOptions)) -> Container {
    let mut options = BakeOptions::default();
    change(&mut options);
    open_bytes(&baked_bytes(field, &options).expect("a bake")).expect("valid")
}

/// The camera's picture of a container.
pub fn picture(container: &Container, camera: &Camera) -> Frame {
    Renderer::of_container(container).expect("renders").picture(camera).expect("a picture")
}

/// The largest difference of two pictures, in colour or in light.
pub fn difference(a: &Frame, b: &Frame) -> f32 {
    let colors = a.color.iter().flatten().zip(b.color.iter().flatten());
    let light = a.transmittance.iter().zip(&b.transmittance);
    colors.chain(light).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// A camera far from a box, whose pixels have a footprint of `rho` voxels or more.
pub fn from_afar(metadata: &Metadata, rho: f64) -> Camera {
    let (bounds, extent) = (&metadata.bounds, metadata.bounds.extent());
    let middle = [0, 1, 2].map(|axis| f64::from(bounds.min[axis]) + extent[axis] / 2.0);
    let away = 100.0 * extent.into_iter().fold(0.0, f64::max);
    let eye = [middle[0] + 0.6 * away, middle[1] - 0.7 * away, middle[2] + 0.4 * away];
    let mut camera = Camera::look_at(eye, middle, 40.0, [24; 2]).expect("a camera");
    let voxels = [0, 1, 2].map(|axis| extent[axis] / metadata.levels[0].dimensions[axis] as f64);
    camera.lens.focal = [away / (rho * voxels.into_iter().fold(0.0, f64::max)); 2];
    camera
}
