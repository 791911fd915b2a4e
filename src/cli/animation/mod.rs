//! Films of rendered frames: GIF and WebP without other programs, video by way of ffmpeg.
//!
//! Frames come one after another and are not kept. A film gets its name when it is whole.

mod format;
mod gif;
mod video;
mod webp;
mod write;

pub use format::{FilmFormat, FilmOptions};
pub use write::Film;
