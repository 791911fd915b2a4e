//! Programs on top of the library: the command line, sweeps, the web server, validation.

pub mod check;
#[cfg(feature = "cli")]
pub mod cli;
pub mod serve;
pub mod sweep;
