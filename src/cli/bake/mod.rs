//! `bake`: arguments ([`arguments`]), trained inputs ([`trained`]), containers ([`again`]), and the
//! report ([`report`]), which `transcode` shares.

mod again;
mod arguments;
mod forecast;
mod report;
mod run;
mod trained;

pub use arguments::Arguments;
#[cfg(feature = "schemas")]
pub use report::BakeJson;
pub use report::{Baked, Work, short_name};
pub use run::run;
