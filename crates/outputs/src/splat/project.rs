//! One splat, and its projection by a camera.

use glam::{DMat3, DVec3};

use crate::model::activate::lanes;
use crate::model::camera::{Camera, Lens};
use crate::model::harmonics::{FUNCTIONS, basis};

/// Numbers of a splat.
pub const PARAMETERS: usize = 5 + 3 * FUNCTIONS;

/// A round splat: its centre, the logarithm of its standard deviation in world units, the logit of
/// its opacity, and coefficients of harmonics, function by function, each red, green and blue.
///
/// Its colour in a direction is `max(0, 0.5 + sum)`.
pub type GaussianSplat = [f32; PARAMETERS];

/// The place of the size, of the opacity, and of the first coefficient.
pub(super) const SIZE: usize = 3;
pub(super) const OPACITY: usize = 4;
pub(super) const COLOR: usize = 5;

/// Renderers widen splats by this many square pixels.
const WIDENED: f32 = 0.3;
/// Nearer splats are not drawn, in world units.
const NEAREST: f64 = 1e-3;
/// Opacity below which a splat is not drawn at a pixel.
pub(super) const FAINT: f32 = 1.0 / 255.0;
/// Directions are clamped to this many half pictures, so that splats far outside do not become
/// huge.
const BESIDE: f64 = 1.3;

/// Differences between the renderers of file kinds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rules {
    /// Splats are sorted by their distance from the camera instead of their depth.
    pub by_distance: bool,
    /// Cutoff of a splat in standard deviations.
    pub reach: f32,
}

impl Rules {
    /// Those of the training code of 3D Gaussian Splatting.
    pub const TRAINING: Self = Self { by_distance: false, reach: f32::INFINITY };
    /// Those of glTF's extension `KHR_gaussian_splatting`.
    pub const GLTF: Self = Self { by_distance: true, reach: 3.0 };
}

/// A camera for projecting splats.
#[derive(Debug)]
pub(super) struct Eye {
    pub(super) lens: Lens,
    rules: Rules,
    position: DVec3,
    /// World to the camera's axes: right, down, forwards.
    turn: DMat3,
}

impl Eye {
    pub(super) fn of(camera: &Camera, rules: Rules) -> Self {
        let axes = camera.to_world;
        let [x, y, z] = [axes.x_axis, axes.y_axis, axes.z_axis].map(|axis| axis.truncate());
        let turn = DMat3::from_cols(x, -y, -z).transpose();
        Self { lens: camera.lens, rules, position: axes.w_axis.truncate(), turn }
    }
}

/// A splat in a picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Projected {
    /// In pixels.
    pub(super) middle: [f32; 2],
    /// The inverse of its covariance: xx, xy, yy.
    pub(super) inverse: [f32; 3],
    /// Its radius in pixels.
    pub(super) reach: [f32; 2],
    /// `d^T inverse d` up to which it is drawn.
    pub(super) drawn: f32,
    pub(super) depth: f32,
    pub(super) opacity: f32,
    pub(super) color: [f32; 3],
}

/// Derivatives of an error by the values of [`Projected`], but by the covariance, not by its
/// inverse.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ByProjected {
    pub(super) middle: [f32; 2],
    pub(super) covariance: [f32; 3],
    pub(super) opacity: f32,
    pub(super) color: [f32; 3],
}

impl ByProjected {
    /// Adds those of other pixels.
    pub(super) fn add(&mut self, other: &Self) {
        let add = |sums: &mut [f32], own: &[f32]| {
            sums.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
        };
        add(&mut self.middle, &other.middle);
        add(&mut self.covariance, &other.covariance);
        add(&mut self.color, &other.color);
        self.opacity += other.opacity;
    }
}

/// Common values of both directions.
struct Geometry {
    /// The centre: right, down, forwards.
    at: DVec3,
    direction: [f64; 3],
    /// Covariance of a splat of size 1, in square pixels.
    shape: [f64; 3],
}

fn geometry(splat: &GaussianSplat, eye: &Eye) -> Option<Geometry> {
    let &[x, y, z, ..] = splat;
    let towards = DVec3::from([x, y, z].map(f64::from)) - eye.position;
    let at = eye.turn * towards;
    if at.z < NEAREST {
        return None;
    }
    let [fx, fy] = eye.lens.focal;
    let half = [0.5 * eye.lens.width as f64 / fx, 0.5 * eye.lens.height as f64 / fy];
    let slope = |at: f64, half: f64| (at).clamp(-BESIDE * half, BESIDE * half);
    let (a, b) = (slope(at.x / at.z, half[0]), slope(at.y / at.z, half[1]));
    let (px, py) = (fx / at.z, fy / at.z);
    let shape = [px * px * (1.0 + a * a), px * py * a * b, py * py * (1.0 + b * b)];
    Some(Geometry { at, direction: (towards / towards.length()).to_array(), shape })
}

/// A splat's projection; none behind the eye or outside the picture.
#[expect(clippy::cast_possible_truncation, reason = "splats are float32")]
pub(super) fn project(splat: &GaussianSplat, eye: &Eye) -> Option<Projected> {
    let Geometry { at, direction, shape } = geometry(splat, eye)?;
    let size = lanes::exp(splat[SIZE]);
    let [xx, xy, yy] = shape.map(|value| value as f32 * size * size);
    let (xx, yy) = (xx + WIDENED, yy + WIDENED);
    let determinant = xx * yy - xy * xy;
    if determinant <= 0.0 || !determinant.is_finite() {
        return None;
    }
    let [cx, cy] = eye.lens.center;
    let [fx, fy] = eye.lens.focal;
    let middle = [(cx + fx * at.x / at.z) as f32, (cy + fy * at.y / at.z) as f32];
    let opacity = lanes::sigmoid(splat[OPACITY]);
    if opacity <= FAINT {
        return None;
    }
    let cut = eye.rules.reach * eye.rules.reach;
    let drawn = (2.0 * lanes::ln(f64::from(opacity / FAINT)) as f32).min(cut);
    let reach = [xx, yy].map(|value| (value * drawn).sqrt());
    let sides = [eye.lens.width as f32, eye.lens.height as f32];
    if (0..2).any(|i| middle[i] + reach[i] < 0.0 || middle[i] - reach[i] > sides[i]) {
        return None;
    }
    let mut color = [0.5f32; 3];
    let coefficients = splat[COLOR..].as_chunks::<3>().0;
    for (value, coefficients) in basis(direction).iter().zip(coefficients) {
        color.iter_mut().zip(coefficients).for_each(|(sum, own)| *sum += value * own);
    }
    Some(Projected {
        middle,
        inverse: [yy / determinant, -xy / determinant, xx / determinant],
        reach,
        drawn,
        depth: if eye.rules.by_distance { at.length() as f32 } else { at.z as f32 },
        opacity,
        color: color.map(|channel| channel.max(0.0)),
    })
}

/// Derivatives by a splat's numbers, from those by its projection.
///
/// The change of the view direction with the centre and of the ellipse with the depth are ignored:
/// both are small compared with the shift of the middle.
#[expect(clippy::cast_possible_truncation, reason = "splats are float32")]
pub(super) fn by_parameters(splat: &GaussianSplat, eye: &Eye, by: &ByProjected) -> GaussianSplat {
    let mut out = [0.0; PARAMETERS];
    let Some(Geometry { at, direction, shape }) = geometry(splat, eye) else { return out };
    let [fx, fy] = eye.lens.focal;
    let [u, v] = by.middle.map(f64::from);
    let of_eye =
        DVec3::new(u * fx / at.z, v * fy / at.z, -(u * fx * at.x + v * fy * at.y) / (at.z * at.z));
    let of_world = eye.turn.transpose() * of_eye;
    for (out, value) in out.iter_mut().zip(of_world.to_array()) {
        *out = value as f32;
    }
    let size = lanes::exp(splat[SIZE]);
    let [xx, xy, yy] = by.covariance;
    let by_square = shape[0] as f32 * xx + 2.0 * shape[1] as f32 * xy + shape[2] as f32 * yy;
    out[SIZE] = 2.0 * size * size * by_square;
    let opacity = lanes::sigmoid(splat[OPACITY]);
    out[OPACITY] = by.opacity * opacity * (1.0 - opacity);
    let values = basis(direction);
    let coefficients = splat[COLOR..].as_chunks::<3>().0;
    let mut sums = [0.0f32; 3];
    for (value, own) in values.iter().zip(coefficients) {
        sums.iter_mut().zip(own).for_each(|(sum, own)| *sum += value * own);
    }
    for (channel, sum) in sums.into_iter().enumerate() {
        // A colour below 0 is 0, whatever its coefficients.
        if 0.5 + sum > 0.0 {
            for (function, value) in values.iter().enumerate() {
                out[COLOR + 3 * function + channel] = value * by.color[channel];
            }
        }
    }
    out
}
