//! The extension module `mipvog_bake._native`: what the Python package needs of the library.
//!
//! Python sees [`field::NativeField`], [`fit::NativeFit`] and the functions below. The package's own
//! modules give them their public form, so that types, defaults and documents stand once, in Python.
//!
//! Work runs on threads of its own while the interpreter lock is free; see [`watch`]. Arrays that go
//! in are read piece by piece where they lie; see [`arrays`].

mod arrays;
mod error;
mod field;
mod fit;
mod verbs;
mod watch;

use pyo3::prelude::*;

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_function(wrap_pyfunction!(verbs::main, module)?)?;
    module.add_function(wrap_pyfunction!(verbs::call, module)?)?;
    module.add_function(wrap_pyfunction!(verbs::option_names, module)?)?;
    module.add_function(wrap_pyfunction!(field::png, module)?)?;
    module.add_function(wrap_pyfunction!(field::frusta, module)?)?;
    module.add_function(wrap_pyfunction!(fit::doubled, module)?)?;
    module.add_function(wrap_pyfunction!(fit::harmonics, module)?)?;
    module.add_class::<arrays::Arrays>()?;
    module.add_class::<field::NativeField>()?;
    module.add_class::<fit::NativeFit>()
}
