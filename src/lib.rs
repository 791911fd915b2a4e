//! Bakes trained Mip-VoG radiance fields into sparse, quantized, coarse-to-fine assets.

#[doc(hidden)]
pub mod app;
#[doc(hidden)]
pub mod bake;
#[doc(hidden)]
pub mod base;
#[doc(hidden)]
pub mod codec;
#[doc(hidden)]
pub mod input;
#[doc(hidden)]
pub mod levels;
#[doc(hidden)]
pub mod model;
#[doc(hidden)]
pub mod output;
#[doc(hidden)]
pub mod view;

/// Everything inside, for benchmarks, tests and the curious.
///
/// Nothing here is stable: any release may rename, move or remove any of it.
pub mod unstable {
    #[doc(inline)]
    pub use crate::{app, bake, base, codec, input, levels, model, output, view};
}
