//! Harmonics for colours of somebody's own code: the directions to ask for, and the fit.

use std::collections::HashMap;

use mipvog::base::error::Result;
use mipvog::base::limits::Limits;
use mipvog::model::field::Lattice;
use mipvog::model::grid::{Bounds, Nodes};
use mipvog::model::harmonics::basis_f64;
use mipvog_inputs::network::{CellViews, Fit};
use mipvog_inputs::{self, Source, SourceOptions, tensor};
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::arrays::Arrays;
use crate::error::raised;
use crate::watch::watched_on_threads;

/// Directions of nodes, flat, and their number at each node.
type Directions<'py> = (Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<i64>>);

/// The fit of harmonics to the colours of a field whose density is known.
#[pyclass(frozen, module = "mipvog_bake._native")]
pub struct NativeFit {
    fitted: CellViews,
    judged: CellViews,
    functions: usize,
    offset: f64,
}

#[pymethods]
impl NativeFit {
    /// Of sampled arrays, whose density counts alone, and of places of cameras. What surrounds
    /// another box, `inner`, is seen from there.
    #[new]
    #[pyo3(signature = (arrays, degree, cameras, inner=None))]
    fn new(
        py: Python<'_>,
        arrays: &Bound<'_, Arrays>,
        degree: usize,
        cameras: Vec<[f64; 3]>,
        inner: Option<[[f32; 3]; 2]>,
    ) -> PyResult<Self> {
        let inner = inner.map(|[min, max]| Bounds { min, max });
        let file = arrays.get().file();
        let made = watched_on_threads(py, None, |watch| {
            let limits = Limits::default();
            let tensors = tensor::open_file(&file, &limits)?;
            let Source { field, .. } =
                mipvog_inputs::open_tensors(&tensors, &SourceOptions::default(), &limits)?;
            let offset = field.harmonics().map_or(0.5, |rules| f64::from(rules.offset));
            let fitted = CellViews::of_fit(&field, degree, &cameras, inner, &limits, &**watch)?;
            let judged = CellViews::of_held_out(&field, &cameras, inner, &limits, &**watch)?;
            Result::Ok(Self { fitted, judged, functions: (degree + 1).pow(2), offset })
        })?;
        made.map_err(|error| raised(py, &error))
    }

    /// The directions that colours of these nodes are fitted along.
    fn directions<'py>(
        &self,
        py: Python<'py>,
        nodes: PyReadonlyArray2<'py, i64>,
    ) -> PyResult<Directions<'py>> {
        directions(py, &self.fitted, &nodes)
    }

    /// The directions that judge the fit at these nodes.
    fn judges<'py>(
        &self,
        py: Python<'py>,
        nodes: PyReadonlyArray2<'py, i64>,
    ) -> PyResult<Directions<'py>> {
        directions(py, &self.judged, &nodes)
    }

    /// Coefficients of nodes from their colours along [`Self::directions`]: node by node, red, green
    /// and blue, and of each the functions in order.
    fn coefficients<'py>(
        &self,
        py: Python<'py>,
        nodes: PyReadonlyArray2<'py, i64>,
        colors: PyReadonlyArray1<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        // Copied while nobody else runs: another thread may write the model's own array meanwhile.
        let (nodes, colors) = (places(&nodes)?, colors.as_slice()?.to_vec());
        let found = py.detach(|| self.fit_all(&nodes, &colors));
        Ok(PyArray1::from_vec(py, found))
    }
}

impl NativeFit {
    fn fit_all(&self, nodes: &[[usize; 3]], colors: &[f32]) -> Vec<f32> {
        let mut cells: HashMap<[usize; 3], (usize, Fit)> = HashMap::new();
        let mut found = vec![0.0; nodes.len() * 3 * self.functions];
        let mut left = colors.as_chunks::<3>().0;
        let mut own = [(); 3].map(|()| Vec::new());
        for (node, out) in nodes.iter().zip(found.chunks_exact_mut(3 * self.functions)) {
            let (count, fit) = cells.entry(self.fitted.cell(*node)).or_insert_with_key(|cell| {
                let count = self.fitted.directions(*cell).len();
                (count, self.fitted.fit(*cell, self.functions))
            });
            let (here, rest) = left.split_at((*count).min(left.len()));
            left = rest;
            for (channel, own) in own.iter_mut().enumerate() {
                own.clear();
                own.extend(here.iter().map(|color| f64::from(color[channel]) - self.offset));
            }
            // They come function by function, red, green and blue of each.
            for (number, value) in fit.coefficients(&own).enumerate() {
                out[number % 3 * self.functions + number / 3] = value as f32;
            }
        }
        found
    }
}

fn directions<'py>(
    py: Python<'py>,
    views: &CellViews,
    nodes: &PyReadonlyArray2<'py, i64>,
) -> PyResult<Directions<'py>> {
    let nodes = places(nodes)?;
    let (values, counts) = py.detach(|| {
        let mut cells: HashMap<[usize; 3], Vec<[f64; 3]>> = HashMap::new();
        let (mut values, mut counts) = (Vec::new(), Vec::new());
        for node in nodes {
            let cell = views.cell(node);
            let own = cells.entry(cell).or_insert_with(|| views.directions(cell));
            values.extend(own.as_flattened().iter().map(|value| *value as f32));
            counts.push(own.len() as i64);
        }
        (values, counts)
    });
    Ok((PyArray1::from_vec(py, values), PyArray1::from_vec(py, counts)))
}

/// Nodes by their numbers along x, y and z.
fn places(nodes: &PyReadonlyArray2<'_, i64>) -> PyResult<Vec<[usize; 3]>> {
    let rows = nodes.as_slice()?.as_chunks::<3>().0;
    Ok(rows.iter().map(|node| node.map(|at| at.max(0) as usize)).collect())
}

/// The box around a box of nodes with nodes twice as far apart: its corners and its nodes.
#[pyfunction]
pub fn doubled(
    min: [f32; 3],
    max: [f32; 3],
    nodes: [usize; 3],
) -> ([f32; 3], [f32; 3], [usize; 3]) {
    let Lattice { bounds, nodes } = Lattice::new(Bounds { min, max }, Nodes(nodes)).doubled();
    (bounds.min, bounds.max, nodes.0)
}

/// Values of the first functions along unit directions, flat, direction by direction.
#[pyfunction]
pub fn harmonics<'py>(
    py: Python<'py>,
    directions: PyReadonlyArray2<'py, f32>,
    functions: usize,
) -> PyResult<Bound<'py, PyArray1<f32>>> {
    let rows = directions.as_slice()?.as_chunks::<3>().0.iter();
    let values = rows.flat_map(|row| basis_f64(row.map(f64::from)).into_iter().take(functions));
    Ok(PyArray1::from_vec(py, values.map(|value| value as f32).collect()))
}
