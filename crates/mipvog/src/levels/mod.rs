//! Coarser levels of a field, and the visible nodes of each level.
//!
//! ```text
//! V[k+1] = resize(lowpass(V[k]))
//! ```
//!
//! Every level spans the same box with corners aligned. A level of `N` nodes along an axis becomes
//! one of `max(2, N / 2)`, whose end nodes lie on the box's faces ([`sizes`]). The low-pass
//! ([`kernel`]) mirrors the grid at its faces without repeating the end node. Low-pass and resize
//! are separable and linear, so one axis of one step is a short list of weights for each output
//! node ([`taps`]).
//!
//! A [`filter`] names the low-pass and the values that are averaged: logits as in training, or
//! premultiplied alpha ([`alpha`]), which looks right at a distance. [`pyramid`] streams planes
//! from a [`PlaneSource`] through all levels into a [`PlaneSink`], and computes required nodes only
//! ([`required`]). One step along one axis is an [`axis_filter`], one level is a [`level_step`].
//! Level 0 is premultiplied on its way up ([`premultiply`]), and each coarser level is turned back
//! into stored values ([`unpremultiply`]). Its directional terms ([`direction`]) are [`anisotropy`]
//! and directional [`brightness`].
//!
//! [`visible`] finds the nodes that can contribute to any pixel, from opacity ([`opacity`]) and
//! from the free-space mask ([`free_space`]). [`visibility`] measures how much light reaches each
//! node ([`transmittance`]), and weights colours of coarser levels. [`importance`] estimates how
//! much of each node viewers nearby can see.

pub mod alpha;
pub mod anisotropy;
pub mod axis_filter;
pub mod brightness;
pub mod direction;
pub mod filter;
pub mod free_space;
pub mod importance;
pub mod kernel;
pub mod level_rule;
pub mod level_step;
pub mod opacity;
pub mod plane;
pub mod premultiply;
pub mod pyramid;
pub mod required;
pub mod sizes;
pub mod source;
pub mod taps;
pub mod transmittance;
pub mod unpremultiply;
pub mod visibility;
pub mod visible;

pub use alpha::AlphaDomain;
pub use direction::Direction;
pub use filter::{Filter, FilterDomain, LevelFilter, SharedFilter};
pub use kernel::Kernel;
pub use level_rule::LevelRule;
pub use plane::{Plane, PlaneSink, PlaneSource};
pub use pyramid::{Content, Pyramid};
pub use required::RequiredNodes;
pub use source::{FieldPass, ReadSummary, Verify};
pub use visibility::{Light, OpticalDepthGrid, Visibility};
pub use visible::{Visible, VisibleLevel};
