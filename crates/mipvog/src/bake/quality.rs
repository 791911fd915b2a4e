//! One number for how much pictures may lose, in place of several options.
//!
//! At 75, errors are those of the preset `web`. Every 25 less doubles them, every 25 more halves
//! them. The codes by which colours may move where viewers nearby see little scale likewise. With
//! cameras, the options that use them scale by the same factor.

use std::fmt;
use std::str::FromStr;

use super::preset::{WEB_ERRORS, WEB_NEARBY_COARSENESS};
use super::{BakeOptions, MaxErrors};

/// The quality with the errors of `web`.
const WEB: f64 = 75.0;
/// Errors double over this much.
const DOUBLES_OVER: f64 = 25.0;
/// The options for cameras at [`WEB`]. In a sweep with cameras all around and test cameras between
/// them, these had the smallest files for their loss.
const MIN_WEIGHT: f64 = 1e-3;
const COARSENESS: f64 = 1.0;
const FILL_ERROR: f64 = 0.25;

/// From 1, few bytes, to 100, small errors.
///
/// ```
/// use mipvog::{BakeOptions, Preset, Quality};
///
/// let mut options = BakeOptions::default();
/// let quality: Quality = "75".parse()?;
/// quality.apply(&mut options, false);
/// assert_eq!(options, Preset::Web.options());
/// # Ok::<(), String>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quality(f64);

impl Quality {
    /// That of the preset `web`.
    pub const OF_WEB: Self = Self(WEB);

    /// Sets the errors, and [`BakeOptions::nearby_coarseness`]; where the field is `seen` from
    /// given cameras, also [`BakeOptions::min_weight`], [`BakeOptions::coarseness`] and
    /// [`BakeOptions::fill_error`].
    pub fn apply(self, options: &mut BakeOptions, seen: bool) {
        let factor = libm::exp2((WEB - self.0) / DOUBLES_OVER);
        options.max_error = Some(errors_of(factor));
        options.nearby_coarseness = nearby_coarseness_of(factor);
        if seen {
            let share = |at_web: f64| (at_web * factor).min(1.0) as f32;
            options.min_weight = Some(share(MIN_WEIGHT));
            options.fill_error = Some(share(FILL_ERROR));
            options.coarseness = (COARSENESS * factor) as f32;
        }
    }
}

/// The factor on the errors of `web`.
pub(super) fn errors_of(factor: f64) -> MaxErrors {
    WEB_ERRORS.scaled(factor)
}

/// The factor on the codes by which colours of `web` may move at nodes of importance 1 to viewers
/// nearby.
pub(super) fn nearby_coarseness_of(factor: f64) -> f32 {
    (f64::from(WEB_NEARBY_COARSENESS) * factor) as f32
}

impl FromStr for Quality {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number: Option<f64> = text.parse().ok();
        let quality = number.filter(|number| (1.0..=100.0).contains(number));
        quality.map(Self).ok_or_else(|| "expected a number from 1 to 100".to_owned())
    }
}

impl fmt::Display for Quality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::baked::Group;

    fn options(quality: &str, seen: bool) -> BakeOptions {
        let mut options = BakeOptions::default();
        quality.parse::<Quality>().expect("a quality").apply(&mut options, seen);
        options
    }

    #[test]
    fn less_quality_allows_more_of_everything() {
        let all = ["1", "25", "50", "62.5", "75", "100"].map(|quality| options(quality, true));
        for (coarser, finer) in all.iter().zip(&all[1..]) {
            assert!(coarser.check().is_ok() && finer.check().is_ok());
            let error = |of: &BakeOptions| of.max_error.expect("errors").of(Group::Density);
            assert!(error(coarser) > error(finer));
            assert!(coarser.coarseness > finer.coarseness);
            assert!(coarser.nearby_coarseness > finer.nearby_coarseness);
            // Shares end at 1.
            for of in [|of: &BakeOptions| of.min_weight, |of: &BakeOptions| of.fill_error] {
                assert!(of(coarser) > of(finer) || of(finer) == Some(1.0));
            }
        }
        let doubled = MaxErrors::new(0.04, 0.036, 0.1).with_direction(0.08, 0.08);
        assert_eq!(options("50", false).max_error, Some(doubled));
    }

    #[test]
    fn nothing_depends_on_cameras_without_them() {
        assert!(!options("10", false).sees() && options("10", true).sees());
    }

    #[test]
    fn only_numbers_from_1_to_100_are_qualities() {
        for text in ["", "0.9", "100.5", "nan", "inf", "-5", "high"] {
            assert!(text.parse::<Quality>().is_err(), "{text}");
        }
    }
}
