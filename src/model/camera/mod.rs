//! Cameras: which ray a pixel looks along.
//!
//! The ray through pixel centre `(i + 0.5, j + 0.5)` has direction
//! `((i + 0.5 - cx) / fx, -(j + 0.5 - cy) / fy, -1)` in the camera's axes (x right, y up, looking
//! along -z), rotated by the camera's matrix and not normalised.

mod path;
mod pinhole;
mod transforms;
mod turntable;

pub use path::flight;
pub use pinhole::{Camera, LARGEST_SIDE, Lens, Ray, digest};
pub use transforms::{CameraFile, parse, pick, picture_path, read};
pub use turntable::{Orbit, direction, sphere, turntable};
