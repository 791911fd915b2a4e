//! Errors of the library as exceptions.

use mipvog::Error;
use mipvog_bake::cli::Failure;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The exception `mipvog_bake.Error` for a failure.
pub fn exception(py: Python<'_>, failure: &Failure) -> PyErr {
    let make = || -> PyResult<PyErr> {
        let details = PyDict::new(py);
        details.set_item("kind", failure.kind)?;
        details.set_item("help", &failure.remedy)?;
        details.set_item("place", &failure.place)?;
        details.set_item("file", &failure.file)?;
        details.set_item("exit_code", failure.exit_code)?;
        details.set_item("report", failure.report.as_ref().map(ToString::to_string))?;
        let class = py.import("mipvog_bake._error")?.getattr("from_native")?;
        Ok(PyErr::from_value(class.call((&failure.message,), Some(&details))?))
    };
    make().unwrap_or_else(|error| error)
}

/// The exception for an error.
pub fn raised(py: Python<'_>, error: &Error) -> PyErr {
    exception(py, &Failure::of(error))
}
