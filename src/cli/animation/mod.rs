//! Films of rendered frames: GIF and WebP without other programs, video via ffmpeg.
//!
//! Frames are streamed, not kept. A film gets its name when it is complete.

mod format;
mod gif;
mod video;
mod webp;
mod write;

pub use format::{FilmFormat, FilmOptions};
pub use write::Film;
