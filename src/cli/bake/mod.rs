//! `bake`: arguments ([`arguments`]), trained inputs ([`trained`]), containers ([`again`]), and the
//! report ([`report`]), which `transcode` shares.

mod again;
mod arguments;
mod forecast;
mod report;
mod run;
mod trained;

pub use arguments::Arguments;
pub use report::{BakeJson, Baked, Work};
pub use run::run;
