//! The level of samples in pictures, and warnings about it.

use std::fmt::Write;

use super::common::Common;
use super::outcome::warn;
use crate::base::error::{Error, Result};
use crate::model::camera::Camera;
use crate::view::compare::ScaleErrors;
use crate::view::render::{LevelChoice, Renderer};

/// Pictures with a mean level up to this count as level 0.
const FULL_DETAIL: f64 = 0.02;
/// Names in a warning, at most.
const NAMED: usize = 5;

/// `auto`, `off` or a level's number.
///
/// # Errors
/// Any other text.
pub fn parse_levels(text: &str) -> std::result::Result<LevelChoice, String> {
    match text {
        "auto" => Ok(LevelChoice::Auto),
        "off" => Ok(LevelChoice::Fixed(0)),
        _ => match text.parse() {
            Ok(level) => Ok(LevelChoice::Fixed(level)),
            Err(_) => Err("expected auto, off or a level's number".to_owned()),
        },
    }
}

/// Refuses a level that the field does not have.
///
/// # Errors
/// `InvalidOption`.
pub fn check_levels(levels: LevelChoice, field: &Renderer) -> Result<()> {
    let (finest, count) = (field.view().finest, field.level_count());
    let LevelChoice::Fixed(level) = levels else { return Ok(()) };
    if level == 0 || (finest..count).contains(&level) {
        return Ok(());
    }
    let expected = match finest {
        0 => format!("auto, off, or a level from 0 to {} that the field has", count - 1),
        _ => format!("auto, off, or a level from {finest} to {} that is there", count - 1),
    };
    Err(Error::invalid_option("level_of_detail", level.to_string(), expected))
}

/// Warns of misleading figures: full pictures so small that they read coarser levels, and blank
/// frames. `remedy` is an alternative to larger pictures, if there is one.
pub fn warn_of_figures(
    errors: &[ScaleErrors],
    cameras: &[Camera],
    remedy: Option<&str>,
    common: &Common,
) {
    let full = errors.iter().min_by_key(|error| error.scale);
    if let (Some(full), Some(camera)) = (full, cameras.first())
        && let Some(level) = full.mean_level.filter(|level| *level > FULL_DETAIL)
        && full.scale == 1
    {
        let [width, height] = [camera.lens.width, camera.lens.height];
        let mut message = format!(
            "pictures of {width} x {height} read level {level:.2} on average: 1/1 includes the \
             error of coarser levels, not only that of the bake; pass --size {} or more",
            large_enough([width, height], level)
        );
        if let Some(remedy) = remedy {
            write!(message, ", or {remedy}").ok();
        }
        warn(&message, common);
    }
    if let Some(blank) = full.map(|full| &full.blank_frames).filter(|blank| !blank.is_empty()) {
        let names = blank.iter().take(NAMED).cloned().collect::<Vec<_>>().join(", ");
        let others = blank.len().saturating_sub(NAMED);
        let more = if others > 0 { format!(" and {others} more") } else { String::new() };
        let shows = "nothing shows in these frames, so they say nothing about the field";
        warn(&format!("{shows}: {names}{more}"), common);
    }
}

/// A size, rounded to two digits, whose pictures read level 0: each level is a factor of 2.
fn large_enough(size: [usize; 2], level: f64) -> String {
    let factor = libm::exp2(level.ceil());
    let side = |pixels: usize| {
        let wanted = pixels as f64 * factor;
        let unit = libm::pow(10.0, (libm::log10(wanted).floor() - 1.0).max(0.0));
        (wanted / unit).ceil() * unit
    };
    match size {
        [width, height] if width == height => side(width).to_string(),
        [width, height] => format!("{}x{}", side(width), side(height)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_round_and_large_enough() {
        assert_eq!(large_enough([100, 100], 1.8), "400");
        assert_eq!(large_enough([33, 20], 0.5), "66x40");
        assert_eq!(large_enough([213, 160], 0.03), "430x320");
    }
}
