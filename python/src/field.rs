//! A field that is open: a container, or a trained input that is not baked yet.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use glam::DVec3;
use mipvog::bake::{level_reports, shell_reports};
use mipvog::base::bytes::SourceFile;
use mipvog::base::error::{Error, Result};
use mipvog::base::limits::Limits;
use mipvog::model::camera::{self, Camera, Ray};
use mipvog::picture;
use mipvog::unpacked::read_tensors;
use mipvog::view::overview;
use mipvog::view::render::{FrameOptions, Renderer, render};
use mipvog_bake::cli::OpenField;
use mipvog_inputs::{self, SourceOptions, tensor};
use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde_json::{Value, json};

use crate::arrays::Arrays;
use crate::error::{exception, raised};
use crate::watch::{Watch, watched, watched_on_threads};

/// Flat values of a picture or of rays, whose shape Python gives back.
type Floats<'py> = Bound<'py, PyArray1<f32>>;
/// Name, element type, shape and bytes of a tensor.
type PyTensor<'py> = (String, &'static str, Vec<usize>, Bound<'py, PyArray1<u8>>);

/// An open field.
#[pyclass(frozen, module = "mipvog_bake._native")]
pub struct NativeField {
    open: OpenField,
    /// The values in memory, once something looked at them.
    renderer: OnceLock<Arc<Renderer>>,
}

impl NativeField {
    fn new(open: OpenField) -> Self {
        Self { open, renderer: OnceLock::new() }
    }

    /// Loaded without a lock: loading is parallel.
    fn renderer(&self) -> Result<Arc<Renderer>> {
        if let Some(renderer) = self.renderer.get() {
            return Ok(Arc::clone(renderer));
        }
        let renderer = Arc::new(self.open.renderer()?);
        Ok(Arc::clone(self.renderer.get_or_init(|| renderer)))
    }

    /// Dimensions, box, levels and metadata.
    fn describe(&self) -> Result<Value> {
        if let Some(container) = self.open.container() {
            let metadata = container.metadata();
            let provenance = container.provenance()?;
            let options = provenance.as_ref().map_or(&Value::Null, |of| &of["options"]);
            return Ok(json!({
                "model": "baked",
                "dimensions": metadata.levels.first().map(|level| level.dimensions),
                "bounds": metadata.outer_bounds(),
                "levels": level_reports(metadata, container.entries(), options),
                "shells": shell_reports(metadata, container.entries(), options),
                "metadata": metadata,
                "provenance": provenance,
                "assumptions": [],
            }));
        }
        let source = self.open.source();
        let scene = source.map(|source| &source.field.scene);
        let assumptions = source.into_iter().flat_map(|source| &source.assumptions);
        Ok(json!({
            "model": source.map(|source| source.family),
            "dimensions": scene.map(|scene| scene.nodes.0),
            "bounds": source.map(|source| source.field.outer_bounds()),
            "levels": [{ "level": 0, "dimensions": scene.map(|scene| scene.nodes.0) }],
            "metadata": scene.map(|scene| json!({
                "activation": scene.activation,
                "march": scene.march,
                "background": scene.background,
            })),
            "provenance": null,
            "assumptions": assumptions.map(|found| &found.message).collect::<Vec<_>>(),
        }))
    }
}

/// Matrices of cameras, and the slopes of their pictures' edges.
type Lenses = (Vec<[f64; 16]>, Vec<[f64; 4]>);

/// Matrices from cameras to the world, row by row, and the slopes of the left, right, lower and upper
/// edges of their pictures: of the text of a camera file, or of one at a path.
#[pyfunction]
#[pyo3(signature = (text, path))]
pub fn frusta(py: Python<'_>, text: Option<&str>, path: Option<PathBuf>) -> PyResult<Lenses> {
    let read = || {
        let cameras = match path {
            Some(path) => camera::read(&path, None, &Limits::default())?,
            None => camera::parse(text.unwrap_or_default(), PathBuf::new(), None)?,
        };
        cameras.pick(&[]).map(|picked| picked.cameras)
    };
    let cameras = read().map_err(|error| raised(py, &error))?;
    let matrices = cameras.iter().map(|camera| camera.to_world.transpose().to_cols_array());
    let slopes = cameras.iter().map(|Camera { lens, .. }| {
        let [[fx, fy], [cx, cy]] = [lens.focal, lens.center];
        [-cx / fx, (lens.width as f64 - cx) / fx, (cy - lens.height as f64) / fy, cy / fy]
    });
    Ok((matrices.collect(), slopes.collect()))
}

/// The camera that Python describes: the text of a camera file, or its path; the overview without.
fn camera(
    field: &Renderer,
    text: Option<&str>,
    path: Option<&Path>,
    frame: Option<String>,
    size: [usize; 2],
    watch: &Watch,
) -> Result<Camera> {
    let cameras = match (text, path) {
        (Some(text), _) => camera::parse(text, PathBuf::new(), Some(size))?,
        (None, Some(path)) => camera::read(path, Some(size), &Limits::default())?,
        (None, None) => return overview(field, size, watch),
    };
    let frame = frame.unwrap_or_else(|| "0".to_owned());
    let picked = cameras.pick(&[frame])?.cameras.into_iter().next();
    picked.ok_or_else(|| Error::usage("the camera has no frames"))
}

#[pymethods]
impl NativeField {
    /// Opens what the arguments name: options of a field, then a path.
    #[staticmethod]
    fn open(py: Python<'_>, arguments: Vec<OsString>) -> PyResult<Self> {
        let open = watched(py, None, |_| OpenField::new(arguments))?;
        open.map(Self::new).map_err(|failure| exception(py, &failure))
    }

    /// Opens a file's bytes, with options of a field.
    #[staticmethod]
    fn of_bytes(py: Python<'_>, options: Vec<OsString>, bytes: Vec<u8>) -> PyResult<Self> {
        let file = Arc::new(SourceFile::decoded(bytes, Path::new("bytes")));
        let open = watched(py, None, |_| OpenField::held(options, &file))?;
        open.map(Self::new).map_err(|failure| exception(py, &failure))
    }

    /// A field of arrays.
    #[staticmethod]
    fn of_arrays(py: Python<'_>, arrays: &Bound<'_, Arrays>) -> PyResult<Self> {
        let file = arrays.get().file();
        let source = watched(py, None, |_| {
            let limits = Limits::default();
            let tensors = tensor::open_file(&file, &limits)?;
            let source = mipvog_inputs::open_tensors(&tensors, &SourceOptions::default(), &limits)?;
            source.field.check().map_err(|error| error.in_file(file.path()))?;
            Ok(source)
        })?;
        let source = source.map_err(|error| raised(py, &error))?;
        Ok(Self::new(OpenField::of_source(source)))
    }

    /// Dimensions, box, levels and metadata as JSON.
    fn description(&self, py: Python<'_>) -> PyResult<String> {
        self.describe().map(|found| found.to_string()).map_err(|error| raised(py, &error))
    }

    /// The tensors of some levels, all if none is given.
    fn unpack<'py>(&self, py: Python<'py>, levels: Vec<usize>) -> PyResult<Vec<PyTensor<'py>>> {
        let found = watched_on_threads(py, None, |watch| match self.open.container() {
            Some(container) => read_tensors(container, &levels, &**watch),
            None => Err(Error::usage(
                "unpack() takes a container apart, and this field is not baked: bake it first",
            )),
        })?;
        let tensors = found.map_err(|error| raised(py, &error))?;
        let tensors = tensors
            .into_iter()
            .map(|(row, bytes)| (row.name, row.dtype, row.shape, PyArray1::from_vec(py, bytes)));
        Ok(tensors.collect())
    }

    /// Colours, transmittances and depths of rays, `n` each; directions have unit length.
    fn probe<'py>(
        &self,
        py: Python<'py>,
        origins: PyReadonlyArray2<'py, f64>,
        directions: PyReadonlyArray2<'py, f64>,
        level: usize,
    ) -> PyResult<[Floats<'py>; 3]> {
        let (origins, directions) = (points(&origins)?, points(&directions)?);
        let found = watched_on_threads(py, None, |watch| {
            let vector = DVec3::from_array;
            let rays = origins.iter().zip(&directions);
            let rays: Vec<Ray> = rays
                .map(|(&from, &along)| Ray { origin: vector(from), direction: vector(along) })
                .collect();
            self.renderer()?.ray_colors(&rays, level, &**watch)
        })?;
        let rays = found.map_err(|error| raised(py, &error))?;
        Ok([
            PyArray1::from_iter(py, rays.iter().flat_map(|ray| ray.color)),
            PyArray1::from_iter(py, rays.iter().map(|ray| ray.transmittance)),
            PyArray1::from_iter(py, rays.iter().map(|ray| ray.distance)),
        ])
    }

    /// Density, opacity, colour, features and coefficients at points, each flat.
    fn sample<'py>(
        &self,
        py: Python<'py>,
        positions: PyReadonlyArray2<'py, f64>,
        level: usize,
    ) -> PyResult<[Floats<'py>; 5]> {
        let positions = points(&positions)?;
        let found = watched_on_threads(py, None, |watch| {
            let field = self.renderer()?;
            let samples = positions.iter().enumerate().map(|(number, position)| {
                if number % 4096 == 0 && mipvog::Progress::cancelled(&**watch) {
                    return Err(Error::cancelled());
                }
                field.sample(*position, level)
            });
            samples.collect::<Result<Vec<_>>>()
        })?;
        let samples = found.map_err(|error| raised(py, &error))?;
        Ok([
            PyArray1::from_iter(py, samples.iter().map(|sample| sample.density)),
            PyArray1::from_iter(py, samples.iter().map(|sample| sample.opacity)),
            PyArray1::from_iter(py, samples.iter().flat_map(|sample| sample.color)),
            PyArray1::from_iter(py, samples.iter().flat_map(|sample| sample.features.clone())),
            PyArray1::from_iter(py, samples.iter().flat_map(|sample| sample.coefficients.clone())),
        ])
    }

    /// A picture, `height * width * 3` values over the background, not clamped.
    #[pyo3(signature = (text, path, frame, size, progress=None))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        text: Option<String>,
        path: Option<PathBuf>,
        frame: Option<String>,
        size: [usize; 2],
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Floats<'py>> {
        let found = watched_on_threads(py, progress, |watch| {
            let field = self.renderer()?;
            let camera = camera(&field, text.as_deref(), path.as_deref(), frame, size, watch)?;
            render(&field, &camera, &FrameOptions::default(), &**watch)
        })?;
        let frame = found.map_err(|error| raised(py, &error))?;
        Ok(PyArray1::from_vec(py, frame.color.into_flattened()))
    }
}

/// Rows of three numbers.
fn points(rows: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; 3]>> {
    Ok(rows.as_slice()?.as_chunks::<3>().0.to_vec())
}

/// A PNG of 8-bit values, 3 or 4 a pixel.
#[pyfunction]
pub fn png<'py>(
    py: Python<'py>,
    width: usize,
    height: usize,
    values: &[u8],
) -> PyResult<Bound<'py, PyBytes>> {
    let bytes = picture::png(width, height, values).map_err(|error| raised(py, &error))?;
    Ok(PyBytes::new(py, &bytes))
}
