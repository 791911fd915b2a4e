//! The settings that pictures were rendered with, for reports.

use serde::Serialize;

use super::container_report::color_text;
use super::layout::{TIE, columns, folded};
use crate::model::field::March;
use crate::view::render::View;

/// Settings of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct Settings {
    /// Step length in voxels.
    pub stepsize: f32,
    /// Start of rays.
    pub near: f32,
    /// Farthest entry of rays into the box; null is without bound.
    pub far: Option<f32>,
    /// Colour behind the field, 0 to 1.
    pub background: [f32; 3],
    /// Weight up to which a sample adds no colour.
    pub color_threshold: f32,
}

impl Settings {
    /// Of the rules of rendering.
    pub fn of(view: &View) -> Self {
        Self::of_march(&view.march, view.background)
    }

    /// Of a container's metadata.
    pub fn of_march(march: &March, background: [f32; 3]) -> Self {
        let &March { stepsize, near, far, color_threshold, .. } = march;
        Self { stepsize, near, far, background, color_threshold }
    }

    /// Each setting by its option, as the option takes it.
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

    /// A line for people.
    pub fn text(&self) -> String {
        let pairs = self
            .values()
            .map(|(option, value)| format!("{}{TIE}{value}", option.trim_start_matches('-')));
        folded(&format!("  {}", pairs.join(", ")), columns(), 4) + "\n"
    }
}
