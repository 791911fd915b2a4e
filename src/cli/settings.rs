//! The settings that pictures were rendered with, for reports.

use serde::Serialize;

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
        let [red, green, blue] = self.background;
        let background = if red == green && green == blue {
            red.to_string()
        } else {
            format!("{red},{green},{blue}")
        };
        [
            ("--stepsize", self.stepsize.to_string()),
            ("--near", self.near.to_string()),
            ("--far", self.far.map_or_else(|| "without bound".to_owned(), |far| far.to_string())),
            ("--background", background),
            ("--color-threshold", self.color_threshold.to_string()),
        ]
    }

    /// A line for people.
    pub fn text(&self) -> String {
        let [(_, stepsize), (_, near), (_, far), (_, background), (_, threshold)] = self.values();
        format!(
            "settings: step length {stepsize} voxels, near {near}, far {far}, background \
             {background}, colour threshold {threshold}\n"
        )
    }
}
