//! The program `mipvog-bake`: its verbs, reports and exit codes, the checks of `validate`, sweeps
//! and the server of `view`.
//!
//! This library is for the program, for its Python module and for its tests. Programs in Rust use
//! the crates below it: `mipvog` bakes, reads and renders, `mipvog-inputs` opens trained models,
//! `mipvog-outputs` writes other programs' formats, and `mipvog-format` is the container alone.

#[doc(hidden)]
pub mod check;
#[doc(hidden)]
pub mod cli;
#[doc(hidden)]
pub mod formats;
#[doc(hidden)]
pub mod html;
#[doc(hidden)]
pub mod report_page;
#[doc(hidden)]
pub mod serve;
#[doc(hidden)]
pub mod sweep;

use mipvog::{bake, base, container, model, picture, quantize, unpacked, view};
