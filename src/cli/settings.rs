//! The settings that pictures were rendered with, for reports.

use serde::Serialize;

use super::container_report::color_text;
use super::layout::{TIE, columns, folded};
use crate::model::field::March;
use crate::view::render::View;

/// Settings that pictures are rendered with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct Settings {
    /// Step length in voxels, above 0.
    pub stepsize: f32,
    /// Distance along the camera's axis at which rays start, in world units.
    pub near: f32,
    /// Largest distance along the camera's axis at which sampling may start, in world units; null
    /// means unbounded.
    pub far: Option<f32>,
    /// Background colour, red, green, blue, each 0 to 1.
    pub background: [f32; 3],
    /// Samples of at most this weight add no colour; 0 to 1.
    pub color_threshold: f32,
}

impl Settings {
    /// The settings of a view.
    pub fn of(view: &View) -> Self {
        Self::of_march(&view.march, view.background)
    }

    /// The settings of a container's metadata.
    pub fn of_march(march: &March, background: [f32; 3]) -> Self {
        let &March { stepsize, near, far, color_threshold, .. } = march;
        Self { stepsize, near, far, background, color_threshold }
    }

    /// The settings by option, in the syntax of the command line.
    pub fn values(&self) -> [(&'static str, String); 5] {
        let background = color_text(self.background);
        [
            ("--stepsize", self.stepsize.to_string()),
            ("--near", self.near.to_string()),
            ("--far", self.far.map_or_else(|| "unlimited".to_owned(), |far| far.to_string())),
            ("--background", background),
            ("--color-threshold", self.color_threshold.to_string()),
        ]
    }

    /// The settings as a line of text.
    pub fn text(&self) -> String {
        let pairs = self
            .values()
            .map(|(option, value)| format!("{}{TIE}{value}", option.trim_start_matches('-')));
        folded(&format!("  {}", pairs.join(", ")), columns(), 4) + "\n"
    }
}
