//! Kinds of films, by the extensions of their names, and the shape of their frames.

/// A kind of film.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FilmFormat {
    /// 256 colours per frame, one bit of alpha.
    Gif,
    /// All colours, lossless, with alpha.
    Webp,
    /// By ffmpeg, with its codec for the extension: mp4, webm or mov.
    Video(&'static str),
}

impl FilmFormat {
    /// Extensions of films, without the dot.
    pub const EXTENSIONS: [&str; 5] = ["gif", "webp", "mp4", "webm", "mov"];

    /// The kind of film that an extension in lower case names.
    pub fn of_extension(extension: &str) -> Option<Self> {
        let known = Self::EXTENSIONS.into_iter().find(|known| *known == extension)?;
        Some(match known {
            "gif" => Self::Gif,
            "webp" => Self::Webp,
            video => Self::Video(video),
        })
    }

    /// Pixels along a side of a frame, at most.
    pub fn largest_side(self) -> usize {
        match self {
            Self::Webp => 1 << 14,
            Self::Gif | Self::Video(_) => usize::from(u16::MAX),
        }
    }

    /// Maximum frames per second, because viewers slow down faster GIFs.
    pub fn fastest(self) -> u8 {
        if self == Self::Gif { 50 } else { 120 }
    }

    /// True if frames can have alpha.
    pub fn has_alpha(self) -> bool {
        !matches!(self, Self::Video(_))
    }
}

/// Frames of a film.
#[derive(Debug, Clone, Copy)]
pub struct FilmOptions {
    /// The kind of film.
    pub format: FilmFormat,
    /// Pixels along a row, and rows.
    pub size: [usize; 2],
    /// Frames a second.
    pub rate: u8,
    /// True if frames have four values per pixel, with alpha last, instead of three.
    pub alpha: bool,
}

impl FilmOptions {
    /// The time of frame `number`, in units of 1 / `units` seconds. The ends of frames are rounded,
    /// not their lengths, so that films keep their speed.
    pub fn delay(&self, number: usize, units: f64) -> u32 {
        let end = |number: usize| (units * number as f64 / f64::from(self.rate)).round();
        (end(number + 1) - end(number)) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_take_the_time_of_their_film() {
        for rate in 1..=120 {
            let options = FilmOptions { format: FilmFormat::Gif, size: [2, 2], rate, alpha: false };
            for units in [100.0, 1000.0] {
                let delays: Vec<u32> = (0..97).map(|number| options.delay(number, units)).collect();
                let all = (97.0 * units / f64::from(rate)).round();
                assert_eq!(f64::from(delays.iter().sum::<u32>()), all, "{rate}");
                let own = units / f64::from(rate);
                assert!(delays.iter().all(|&delay| (f64::from(delay) - own).abs() < 1.0), "{rate}");
            }
        }
    }
}
