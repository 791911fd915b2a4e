//! A film during writing.

use std::path::Path;

use super::format::{FilmFormat, FilmOptions};
use super::gif::GifFilm;
use super::video::VideoFilm;
use super::webp::WebpFilm;
use crate::base::bytes::Output;
use crate::base::error::Result;

/// A film during writing.
pub enum Film {
    Gif(GifFilm),
    Webp(WebpFilm),
    Video(VideoFilm),
}

impl Film {
    /// Starts a film in `output`, whose name will be `path`.
    pub fn start(output: Output, path: &Path, options: FilmOptions) -> Result<Self> {
        Ok(match options.format {
            FilmFormat::Gif => Self::Gif(GifFilm::start(output, path, options)?),
            FilmFormat::Webp => Self::Webp(WebpFilm::start(output, path, options)?),
            FilmFormat::Video(kind) => Self::Video(VideoFilm::start(output, path, kind, options)?),
        })
    }

    /// Adds a frame, rows from the top.
    pub fn add(&mut self, values: &[u8]) -> Result<()> {
        match self {
            Self::Gif(film) => film.add(values),
            Self::Webp(film) => film.add(values),
            Self::Video(film) => film.add(values),
        }
    }

    /// Ends the film and gives it its name.
    pub fn finish(self) -> Result<()> {
        match self {
            Self::Gif(film) => film.finish(),
            Self::Webp(film) => film.finish(),
            Self::Video(film) => film.finish(),
        }
    }
}
