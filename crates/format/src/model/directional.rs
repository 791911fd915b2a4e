//! Directional brightness: what a node of a coarser level adds to its diffuse colour in a direction.
//!
//! ```text
//! colour  c = sigmoid(v_c + d . b),  for red, green and blue
//! ```
//!
//! `d` is the unit direction from the camera into the scene, `v` the logits of diffuse colour, and
//! `b` the three values of directional brightness, which all channels share. A node far from the
//! camera stands for many fine ones, which hide each other otherwise from each side: what it shows
//! depends on the direction, though no fine node's colour does. The three values are the linear
//! harmonics of that brightness; those of each channel apart would be nine.

use crate::model::activate::lanes;

/// Values of a node.
pub const DIRECTIONAL: usize = 3;
/// Colour channels and features of a node that has directional brightness, its own values among
/// them, at most.
pub const MOST_CHANNELS: usize = 64;

/// The logit that `brightness` adds along a unit `direction`.
#[inline(always)]
pub fn added_logit(direction: [f32; DIRECTIONAL], brightness: [f32; DIRECTIONAL]) -> f32 {
    let [x, y, z] = direction;
    let [bx, by, bz] = brightness;
    x * bx + y * by + z * bz
}

/// A diffuse `color`, 0 to 1, with the `brightness` that it has along a unit `direction`.
pub fn color_from(
    color: [f32; 3],
    brightness: [f32; DIRECTIONAL],
    direction: [f64; 3],
) -> [f32; 3] {
    if brightness == [0.0; DIRECTIONAL] {
        return color;
    }
    let added = added_logit(direction.map(|part| part as f32), brightness);
    color.map(|channel| lanes::sigmoid(libm::logf(channel / (1.0 - channel)) + added))
}
