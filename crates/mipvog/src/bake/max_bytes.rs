//! The best quality that fits into a number of bytes.
//!
//! Quality is one factor: on the errors of `--preset web`, which divide bytes well between the
//! groups, and on the codes by which colours may move. Each factor is the eighth root of two times
//! the next smaller one. The search for the smallest one that fits is a regula falsi (with the
//! correction of Dowell and Jarratt 1971, "Illinois"), so the result depends only on the sizes. If the largest error does not fit, the finest level is dropped, then the
//! next.

use std::fmt;

use serde::Serialize;

use super::MaxErrors;
use super::quality::errors_of;
use crate::base::error::{Error, ErrorKind, Result};

/// The largest factor: the error of opacity then reaches its upper limit.
const LARGEST: f64 = 12.5;
/// Factors on each halving, and how many there are.
const PER_HALVING: usize = 8;
const STEPS: usize = 128;
/// The step to try first: about the errors of the preset.
const MIDDLE: usize = 29;

/// A container that was packed, but not written.
pub struct Attempt<T> {
    /// Size of the container in bytes.
    pub bytes: u64,
    /// How far colours may move, in codes, at nodes of importance 1 to nearby viewers, if they may.
    pub nearby_coarseness: Option<f32>,
    /// Its parts.
    pub packed: T,
}

/// The best quality within a size limit.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct Chosen {
    /// Size of the container in bytes.
    pub bytes: u64,
    /// Chosen error bounds of the groups; null if the container fitted unchanged.
    #[cfg_attr(feature = "schemas", schemars(with = "Option<serde_json::Value>"))]
    pub max_error: Option<MaxErrors>,
    /// How far colours may move, in codes, at nodes of importance 1 to nearby viewers; absent if
    /// they may not move.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nearby_coarseness: Option<f32>,
    /// Number of finest levels that were dropped, including requested ones.
    pub without_finest: usize,
}

impl fmt::Display for Chosen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.without_finest, self.max_error) {
            (0, None) => write!(f, "it fits as it is")?,
            (0, Some(errors)) => write!(f, "the best that fits has --max-error {errors}")?,
            (1, _) => write!(f, "it fits only without the finest level (--without-finest 1)")?,
            (count, _) => {
                write!(
                    f,
                    "it fits only without the {count} finest levels (--without-finest {count})"
                )?;
            }
        }
        if let (1.., Some(errors)) = (self.without_finest, self.max_error) {
            write!(f, ", and the best quality that then fits has --max-error {errors}")?;
        }
        match self.nearby_coarseness {
            Some(_) => write!(f, ", and coarser colours where they are hardly seen"),
            None => Ok(()),
        }
    }
}

/// Finds the smallest factor for which `attempt(finest levels dropped, factor)` has at most
/// `max_bytes` bytes, for a container of `levels` levels.
///
/// # Errors
///
/// [`crate::base::error::ErrorKind::InvalidOption`] if nothing fits; errors of `attempt`.
pub fn search<T>(
    max_bytes: u64,
    levels: usize,
    mut attempt: impl FnMut(usize, f64) -> Result<Attempt<T>>,
) -> Result<(T, Chosen)> {
    let mut least = u64::MAX;
    for dropped in 0..levels {
        let (mut best, mut range) = (None, Range::new(max_bytes));
        while let Some(step) = range.next() {
            let tried = match attempt(dropped, factor(step)) {
                // Some levels cannot be dropped, and the remaining ones are too large.
                Err(error)
                    if dropped > 0 && matches!(error.kind(), ErrorKind::InvalidOption { .. }) =>
                {
                    return Err(too_small(max_bytes, least));
                }
                tried => tried?,
            };
            least = least.min(tried.bytes);
            if range.narrow(step, tried.bytes) {
                best = Some((tried, step));
            }
        }
        let Some((best, step)) = best else { continue };
        let chosen = Chosen {
            bytes: best.bytes,
            max_error: Some(errors_of(factor(step))),
            nearby_coarseness: best.nearby_coarseness,
            without_finest: dropped,
        };
        return Ok((best.packed, chosen));
    }
    Err(too_small(max_bytes, least))
}

/// The error for a limit below the smallest container.
fn too_small(max_bytes: u64, least: u64) -> Error {
    let expected = format!("at least {least}, the smallest container of this scene");
    Error::invalid_option("max_bytes", max_bytes.to_string(), expected)
}

/// The steps between one that fits and one that is too large, once they are known, each with the
/// bytes that it is above the limit.
struct Range {
    max_bytes: f64,
    fits: Option<(usize, f64)>,
    too_large: Option<(usize, f64)>,
    /// Bytes from a step to the next, as long as one end is unknown.
    slope: f64,
    /// True if the last step fitted.
    fitted: Option<bool>,
}

impl Range {
    fn new(max_bytes: u64) -> Self {
        let max_bytes = max_bytes as f64;
        // A halving of errors adds a bit to values, of about four.
        let slope = max_bytes / (4 * PER_HALVING) as f64;
        Self { max_bytes, fits: None, too_large: None, slope, fitted: None }
    }

    /// The step to try next, if any is left.
    fn next(&self) -> Option<usize> {
        let first = self.fits.map_or(0, |(step, _)| step + 1);
        let end = self.too_large.map_or(STEPS + 1, |(step, _)| step);
        let step = match (self.fits, self.too_large) {
            (None, None) => MIDDLE,
            _ if end <= first + 2 => first,
            (Some((fits, below)), None) => fits + (-below / self.slope) as usize,
            (None, Some((end, above))) => end.saturating_sub((above / self.slope).ceil() as usize),
            (Some((fits, below)), Some((end, above))) => {
                fits + (-below / (above - below) * (end - fits) as f64) as usize
            }
        };
        (first < end).then(|| step.clamp(first, end - 1))
    }

    /// Takes the size of a step. True if it fits.
    fn narrow(&mut self, step: usize, bytes: u64) -> bool {
        let away = bytes as f64 - self.max_bytes;
        let fits = away <= 0.0;
        let (near, far) = match fits {
            true => (&mut self.fits, &mut self.too_large),
            false => (&mut self.too_large, &mut self.fits),
        };
        *near = Some((step, away));
        // An end that stays twice loses half of its weight, or the other one would creep.
        if self.fitted == Some(fits) {
            self.slope *= 0.5;
            far.iter_mut().for_each(|(_, away)| *away *= 0.5);
        }
        self.fitted = Some(fits);
        fits
    }
}

/// The factor of a step, the largest first.
fn factor(step: usize) -> f64 {
    LARGEST * libm::exp2(-(step as f64) / PER_HALVING as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::baked::Group;

    #[test]
    fn errors_are_valid_and_fall() {
        let all: Vec<MaxErrors> = (0..=STEPS).map(|step| errors_of(factor(step))).collect();
        assert!(all.iter().all(|errors| errors.check().is_ok()));
        let diffuse = |errors: &MaxErrors| errors.of(Group::Diffuse);
        assert!(all.windows(2).all(|pair| diffuse(&pair[0]) > diffuse(&pair[1])));
    }

    #[test]
    fn the_smallest_error_that_fits_is_found() {
        let bytes = |dropped: usize, factor: f64| {
            let errors = errors_of(factor);
            let bytes = (100.0 / errors.of(Group::Diffuse)) as u64 >> (3 * dropped);
            Ok(Attempt { bytes, nearby_coarseness: None, packed: bytes })
        };
        for limit in [60, 500, 3000, 100_000] {
            let mut tried = 0;
            let counted = |dropped, factor| {
                tried += 1;
                bytes(dropped, factor)
            };
            let (bytes, chosen) = search(limit, 3, counted).expect("fits");
            assert!(tried <= 10, "{tried} attempts for {limit} bytes");
            assert!(bytes <= limit && chosen.bytes == bytes);
            let finer = chosen.max_error.expect("an error").of(Group::Diffuse) * 0.9;
            assert!(limit < 444 || (100.0 / finer) as u64 > limit, "{chosen:?}");
            assert_eq!(chosen.without_finest, usize::from(limit < 444), "{chosen:?}");
        }
        let error = search(3, 2, bytes).expect_err("too little").to_string();
        assert!(error.contains("at least 55"), "{error}");
    }
}
