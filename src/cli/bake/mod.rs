//! `bake`: arguments ([`arguments`]), trained inputs ([`trained`]), containers ([`again`]), and the
//! report ([`report`]), which `transcode` shares. [`merge`] adds other scenes to the input.

mod again;
mod arguments;
mod forecast;
mod merge;
mod report;
mod run;
mod trained;

pub use arguments::Arguments;
#[cfg(feature = "schemas")]
pub use report::BakeJson;
pub use report::{Baked, Work, short_name};
pub use run::run;
