//! The best quality that fits into a number of bytes.
//!
//! Quality is one factor: on the errors of `--preset web`, which divide bytes well between the
//! groups, and on the codes by which colours may move. Each factor is the eighth root of two times
//! the next smaller one. A binary search finds the smallest factor that fits, so the result depends
//! only on the sizes. If the largest error does not fit, the finest level is dropped, then the
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
        match self.max_error {
            Some(errors) => write!(f, "the best that fits has --max-error {errors}")?,
            None => write!(f, "it fits as it is")?,
        }
        match self.without_finest {
            0 => {}
            count => write!(f, " and --without-finest {count}")?,
        }
        match self.nearby_coarseness {
            Some(_) => write!(f, ", and colours that move where viewers nearby see little"),
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
        let coarsest = match attempt(dropped, factor(0)) {
            // Some levels cannot be dropped, and the remaining ones are too large.
            Err(error)
                if dropped > 0 && matches!(error.kind(), ErrorKind::InvalidOption { .. }) =>
            {
                break;
            }
            coarsest => coarsest?,
        };
        least = least.min(coarsest.bytes);
        if coarsest.bytes > max_bytes {
            continue;
        }
        let (mut best, mut fits, mut too_large) = (coarsest, 0, STEPS + 1);
        while too_large - fits > 1 {
            let middle = (fits + too_large) / 2;
            let tried = attempt(dropped, factor(middle))?;
            if tried.bytes <= max_bytes {
                (best, fits) = (tried, middle);
            } else {
                too_large = middle;
            }
        }
        let chosen = Chosen {
            bytes: best.bytes,
            max_error: Some(errors_of(factor(fits))),
            nearby_coarseness: best.nearby_coarseness,
            without_finest: dropped,
        };
        return Ok((best.packed, chosen));
    }
    let expected = format!("at least {least}, the smallest container of this scene");
    Err(Error::invalid_option("max_bytes", max_bytes.to_string(), expected))
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
            let (bytes, chosen) = search(limit, 3, bytes).expect("fits");
            assert!(bytes <= limit && chosen.bytes == bytes);
            let finer = chosen.max_error.expect("an error").of(Group::Diffuse) * 0.9;
            assert!(limit < 444 || (100.0 / finer) as u64 > limit, "{chosen:?}");
            assert_eq!(chosen.without_finest, usize::from(limit < 444), "{chosen:?}");
        }
        let error = search(3, 2, bytes).expect_err("too little").to_string();
        assert!(error.contains("at least 55"), "{error}");
    }
}
