//! The reference renderer of trained and baked fields.
//!
//! All fields share one code path above [`crate::view::sample::SampleLevels`]. A [`View`] holds the
//! rules of a trained scene or of a container's metadata. [`route`] walks a ray: it picks the level
//! of detail from the pixel's footprint and skips empty space. [`nested_route`] handles nested
//! boxes. [`packet`] interpolates, activates and composites many samples at once, with
//! transmittance as accumulated optical depth. [`frame`] renders tiles of a picture in parallel and
//! adds the view-dependent colour of many rays at once. The picture does not depend on the number
//! of threads.

mod color_rule;
mod coverage;
mod footprint;
mod frame;
mod march;
mod nested_route;
mod packet;
mod path;
mod rays;
mod renderer;
mod route;
mod sample;
mod shade;
mod trained;

pub use crate::view::sample::View;
pub use color_rule::ColorRule;
pub use coverage::{CameraCoverage, camera_coverage};
pub use frame::{Frame, FrameOptions, LevelChoice, Statistics, render, render_depths, tiles};
pub use path::Path;
pub use renderer::Renderer;
pub(crate) use renderer::{Lanes, with_lanes};
pub use route::{Route, RouteSample};
pub use sample::Directions;
pub use trained::TrainedLevels;
