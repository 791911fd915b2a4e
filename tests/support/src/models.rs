//! Models of other systems: how tests open them, and the references that other programs rendered.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use mipvog::base::bytes::SourceFile;
use mipvog::base::error::{Error, ErrorKind};
use mipvog::base::limits::{Budget, Limits};
use mipvog::base::progress::Silent;
use mipvog::model::camera::Ray;
use mipvog::view::render::Renderer;
use mipvog_inputs::tensor::{self, Value};
use mipvog_inputs::{Source, SourceOptions};
use mipvog_inputs::{open_tensors, open_with};

use super::fixture;
use super::grids::SmallGrid;

pub fn open(name: &str, options: &SourceOptions) -> Result<Source, Error> {
    open_with(&fixture("grids").join(name), options, &Limits::default())
}

pub fn renderer(source: &Source) -> Renderer {
    source.renderer(None, &Limits::default()).expect("a model")
}

/// The tensors of a reference.
pub struct Reference(tensor::TensorFile);

impl Reference {
    pub fn of(name: &str) -> Self {
        Self::within("grids", name)
    }

    /// Of a model in another folder.
    pub fn within(folder: &str, name: &str) -> Self {
        let path = fixture(folder).join(format!("{name}.rays.safetensors"));
        Self(tensor::open(&path, &Limits::default()).expect("a reference"))
    }

    pub fn values(&self, name: &str) -> Vec<f32> {
        let found = self.0.root.get(name).and_then(Value::tensor).expect("a tensor");
        found.read_f32(&mut Budget::new(&Limits::default())).expect("values")
    }

    pub fn points(&self, name: &str) -> Vec<[f64; 3]> {
        self.values(name).as_chunks::<3>().0.iter().map(|point| point.map(f64::from)).collect()
    }

    pub fn rays(&self) -> Vec<Ray> {
        let rays = self.points("origins").into_iter().zip(self.points("directions"));
        rays.map(|(origin, direction)| Ray {
            origin: DVec3::from_array(origin),
            direction: DVec3::from_array(direction).normalize(),
        })
        .collect()
    }
}

/// Largest difference of two lists of the same length.
pub fn farthest(found: impl IntoIterator<Item = f32>, expected: &[f32]) -> f32 {
    let found: Vec<f32> = found.into_iter().collect();
    assert_eq!(found.len(), expected.len());
    found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Rays within 2e-5 of the reference, densities within 1e-5 of theirs, colours within 1e-5.
pub fn agrees(name: &str, reference: &str, options: &SourceOptions) {
    let (model, reference) =
        (renderer(&open(name, options).expect(name)), Reference::of(reference));
    let light = model.ray_colors(&reference.rays(), 0, &Silent).expect("rays");
    let rgb = farthest(light.iter().flat_map(|ray| ray.color), &reference.values("rgb"));
    let left = farthest(light.iter().map(|r| r.transmittance), &reference.values("transmittance"));
    assert!(rgb < 2e-5 && left < 2e-5, "{name}: colours {rgb}, transmittance {left}");
    points_agree(name, &model, &reference);
}

/// Densities within 1e-5 of the reference's, colours within 1e-5.
pub fn points_agree(name: &str, model: &Renderer, reference: &Reference) {
    let (positions, densities) = (reference.points("positions"), reference.values("density"));
    for (position, expected) in positions.iter().zip(densities) {
        let found = model.sample(*position, 0).expect("a point").density;
        let off = (found - expected).abs();
        assert!(off <= 1e-5 * expected.abs() + 1e-6, "{name}: {found} for {expected}");
    }
    let directions = reference.points("color_directions");
    let colors = reference.values("color");
    for (position, expected) in positions.iter().zip(colors.chunks_exact(3 * directions.len())) {
        let found = model.point_colors(*position, &directions, 0).expect("a point");
        let off = farthest(found.into_iter().flatten(), expected);
        assert!(off < 1e-5, "{name}: colours {off} off at {position:?}");
    }
}

/// Opens a small grid.
pub fn small(grid: &SmallGrid) -> Result<Source, Error> {
    of_bytes(grid.to_bytes(), &SourceOptions::default())
}

/// Opens a model out of memory.
pub fn of_bytes(bytes: Vec<u8>, options: &SourceOptions) -> Result<Source, Error> {
    let file = Arc::new(SourceFile::decoded(bytes, Path::new("/nowhere/model")));
    let limits = Limits::default();
    open_tensors(&tensor::open_file(&file, &limits)?, options, &limits)
}

/// True for errors about what is in a file.
pub fn is_typed(error: &Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::Malformed { .. }
            | ErrorKind::Unsupported { .. }
            | ErrorKind::OverLimit { .. }
            | ErrorKind::Overflow { .. }
            | ErrorKind::NonFinite { .. }
            | ErrorKind::Checksum { .. }
            | ErrorKind::Truncated { .. }
            | ErrorKind::WrongKind { .. }
    )
}

/// Opens a small grid, loads it, and reads its field.
pub fn used(grid: &SmallGrid) -> Result<(), Error> {
    read(&small(grid)?)
}

/// Loads a model, and reads all nodes of its field.
pub fn read(source: &Source) -> Result<(), Error> {
    source.renderer(None, &Limits::default())?;
    let [nx, ny, nz] = source.field.scene.nodes.0;
    for grid in source.field.grids() {
        let mut plane = vec![0.0; ny * nz];
        for x in 0..nx {
            (0..grid.channels())
                .try_for_each(|channel| grid.read_plane(channel, x, &mut plane, |_| {}))?;
        }
    }
    Ok(())
}
