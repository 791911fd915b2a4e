//! Directional brightness: the direction dependence of a coarse node's diffuse colour.
//!
//! ```text
//! colour  c = sigmoid(v_c + d . b),  for red, green and blue
//! ```
//!
//! `d` is the unit direction from the camera into the scene, `v` the logits of diffuse colour, and
//! `b` the three values of directional brightness, which all channels share. A coarse node
//! represents many fine nodes, which occlude each other differently in each direction. So its look
//! depends on the direction, although no fine node's colour does. The three values are the linear
//! harmonics of that brightness; separate ones per channel would be nine.

use crate::model::activate::lanes;

/// Values of a node.
pub const DIRECTIONAL: usize = 3;
/// Maximum colour channels and features of a node with directional brightness, including its
/// values.
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
