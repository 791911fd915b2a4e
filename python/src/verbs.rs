//! The program, and its verbs as functions.

use std::ffi::OsString;
use std::path::Path;
use std::sync::Arc;

use mipvog::base::bytes::SourceFile;
use mipvog_bake::cli::{self, Call, ColorFit, SharedWatcher};
use pyo3::prelude::*;

use crate::arrays::Arrays;
use crate::error::exception;
use crate::watch::watched;

/// Runs the program with these arguments, the first of which is its name; gives its exit code.
#[pyfunction]
pub fn main(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| cli::main_of(arguments))
}

/// Runs a verb and gives its report as JSON. `arrays`, or the bytes `data`, are the input of a bake
/// whose argument is `-`; `fit` is the degree and the held-out PSNR of the harmonics in them, if they were fitted.
#[pyfunction]
#[pyo3(signature = (arguments, arrays=None, progress=None, fit=None, data=None))]
pub fn call(
    py: Python<'_>,
    arguments: Vec<OsString>,
    arrays: Option<&Bound<'_, Arrays>>,
    progress: Option<&Bound<'_, PyAny>>,
    fit: Option<(usize, f64)>,
    data: Option<Vec<u8>>,
) -> PyResult<String> {
    let color_fit = fit.map(|(degree, held_out_psnr)| ColorFit { degree, held_out_psnr });
    let held = |bytes| Arc::new(SourceFile::decoded(bytes, Path::new("bytes")));
    let input = arrays.map(|arrays| arrays.get().file()).or_else(|| data.map(held));
    let report = watched(py, progress, |watch| {
        let watcher = Some(SharedWatcher(Arc::clone(watch) as _));
        cli::call(Call { arguments, input, color_fit, watcher })
    })?;
    report.map(|report| report.to_string()).map_err(|failure| exception(py, &failure))
}

/// The long names of a verb's options, and whether one can be given again.
#[pyfunction]
pub fn option_names(verb: &str) -> Vec<(String, bool)> {
    cli::option_names(verb)
}
