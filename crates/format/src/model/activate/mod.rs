//! Density to opacity.
//!
//! ```text
//! sigma = softplus(raw + shift)        alpha = 1 - exp(-sigma * interval)
//! ```
//!
//! Raw values of -100 and +80 are common, so softplus is `max(x, 0) + ln_1p(exp(-|x|))` and opacity
//! uses `exp_m1`: `1 - exp(-x)` would be zero for x below 1.1e-16, and long faint paths add up.
//! Both maps are monotone, so [`raw_at_opacity`] can turn a threshold on opacity into one
//! comparison on raw values.
//!
//! These functions affect the stored values (thresholds, ranges), so they use the `libm` crate,
//! whose results do not depend on the platform. Rendering activates millions of samples: [`lanes`]
//! has the same functions for short arrays of f32, which the compiler vectorizes.

pub mod lanes;
mod scalar;

pub use scalar::{inverse_softplus, opacity, opacity_slope, raw_at_opacity, sigmoid, softplus};
