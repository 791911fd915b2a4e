//! Cameras: the mapping from pixels to rays.
//!
//! The ray through pixel centre `(i + 0.5, j + 0.5)` has direction
//! `((i + 0.5 - cx) / fx, -(j + 0.5 - cy) / fy, -1)` in the camera's axes (x right, y up, looking
//! along -z), rotated by the camera's matrix and not normalised.

mod colmap;
mod document;
mod frame_lens;
mod frame_names;
mod frames;
mod moved;
mod path;
mod pinhole;
mod transforms;
mod turntable;

pub use frame_names::photograph_path;
pub use frames::{CameraFile, PickedCameras, pick};
pub use moved::WorldTransform;
pub use path::flight;
pub use pinhole::{Camera, LARGEST_SIDE, Lens, Ray, digest};
pub use transforms::{parse, read};
pub use turntable::{Orbit, direction, sphere, turntable};
