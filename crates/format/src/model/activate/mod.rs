//! Density to opacity.
//!
//! ```text
//! sigma = softplus(raw + shift)        alpha = 1 - exp(-sigma * interval)
//! ```
//!
//! Raw values of -100 and +80 are common, so softplus is `max(x, 0) + ln_1p(exp(-|x|))` and opacity
//! uses `exp_m1`: `1 - exp(-x)` would be zero for x below 1.1e-16, and long faint paths add up.
//! Both maps are monotone, so a threshold on opacity is one on raw values
//! ([`Activation::raw_at_opacity`](crate::model::scene::Activation::raw_at_opacity)).
//!
//! These functions affect the stored values (thresholds, ranges), so they use the `libm` crate,
//! whose results do not depend on the platform. Rendering activates millions of samples: [`lanes`]
//! has the same functions for short arrays of f32, which the compiler vectorizes.

pub mod lanes;
mod scalar;

pub use scalar::{inverse_softplus, sigmoid, softplus};
