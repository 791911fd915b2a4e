//! The renderer's settings beside the grids.

use crate::base::error::{Error, Place, Result};
use crate::model::activate;
pub use crate::model::free_space::{FreeSpace, Lookup};
pub use crate::model::generated::{Activation, ActivationOrder, DensityFunction, March};
use crate::model::grid::{Bounds, Nodes};

/// An invisible opacity over one interval: 10^4 such samples change a picture by 10^-6.
pub const INVISIBLE_OPACITY: f64 = 1e-10;

/// Logit of empty space.
pub const EMPTY_LOGIT: f32 = -100.0;

/// Opacity of raw density, and the march of rays.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The box that every level spans.
    pub bounds: Bounds,
    /// Nodes of level 0.
    pub nodes: Nodes,
    /// Raw density to opacity.
    pub activation: Activation,
    /// Steps along a ray.
    pub march: March,
    /// Colour behind the field, in the colour space of training, 0 to 1.
    pub background: [f32; 3],
}

/// The meaning of stored colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ColorDomain {
    /// Logits: `sigmoid(value)` is a colour.
    #[default]
    Logit,
    /// Colours themselves, or coefficients of harmonics.
    Linear,
}

impl Activation {
    /// For raw densities that are logits, interpolated before activation.
    pub const fn logits(shift: f32, interval: f32) -> Self {
        let (order, function) = (ActivationOrder::Raw, DensityFunction::Softplus);
        Self { shift, interval, order, function }
    }

    /// For raw densities that may be negative, interpolated before activation.
    pub const fn relu(interval: f32) -> Self {
        let (order, function) = (ActivationOrder::Raw, DensityFunction::Relu);
        Self { shift: 0.0, interval, order, function }
    }

    /// The raw density of an opacity of 1e-10. Renderers can skip cells whose corners are all at or
    /// below it, and bakes give don't-care nodes at most this value.
    pub fn invisible_raw(&self) -> f32 {
        self.raw_at_opacity(INVISIBLE_OPACITY) as f32
    }

    /// Density of a raw density: optical depth over one interval, divided by the interval.
    pub fn density(&self, raw: f64) -> f64 {
        match self.function {
            DensityFunction::Softplus => activate::softplus(raw + f64::from(self.shift)),
            DensityFunction::Relu => raw.max(0.0),
        }
    }

    /// The raw density of a density: minus infinity at 0, except with `relu`.
    pub fn raw(&self, density: f64) -> f64 {
        match self.function {
            DensityFunction::Softplus => {
                activate::inverse_softplus(density) - f64::from(self.shift)
            }
            DensityFunction::Relu => density,
        }
    }

    /// The raw density of a density as a node stores it: emptiness at 0.
    pub fn stored_raw(&self, density: f64) -> f32 {
        self.raw(density).max(self.empty_raw().into()) as f32
    }

    /// Opacity over one interval of a raw density, 0 to 1. Monotone in raw density.
    pub fn opacity(&self, raw: f64) -> f64 {
        -libm::expm1(-self.density(raw) * f64::from(self.interval))
    }

    /// The raw density of this opacity over one interval.
    /// Minus infinity at 0 (0 with `relu`), infinity at 1.
    pub fn raw_at_opacity(&self, opacity: f64) -> f64 {
        self.raw(-libm::log1p(-opacity) / f64::from(self.interval))
    }

    /// The raw density at which opacity over one interval is steepest, and the slope there: opacity
    /// moves by at most this much for each unit of raw density.
    ///
    /// With softplus and `s = sigmoid(x)`, the slope is `interval * s * (1 - s)^interval`, which is
    /// largest at `s = 1 / (1 + interval)`.
    pub fn steepest(&self) -> (f64, f64) {
        let (shift, interval) = (f64::from(self.shift), f64::from(self.interval));
        match self.function {
            DensityFunction::Softplus => {
                let s = 1.0 / (1.0 + interval);
                let slope = interval * s * libm::exp(interval * libm::log1p(-s));
                (-libm::log(interval) - shift, slope)
            }
            DensityFunction::Relu => (0.0, interval),
        }
    }

    /// Raw density of a missing node. For logits, it is far below any threshold, and the value of
    /// invisible nodes in trained scenes.
    pub fn empty_raw(&self) -> f32 {
        match self.function {
            DensityFunction::Softplus => EMPTY_LOGIT,
            DensityFunction::Relu => 0.0,
        }
    }
}

/// Voxels of level 0, which has this many `nodes` in `bounds`, along the edges of a box around it.
pub fn voxels_along(nodes: Nodes, bounds: &Bounds, outer: &Bounds) -> [f64; 3] {
    let (own, outer_extent) = (bounds.extent(), outer.extent());
    std::array::from_fn(|axis| {
        let nodes = nodes.0[axis] as f64;
        if own[axis] == outer_extent[axis] {
            nodes
        } else {
            nodes * (outer_extent[axis] / own[axis])
        }
    })
}

impl March {
    /// Steps of this length in voxels through the whole box, starting at the camera, without
    /// thresholds.
    pub const fn new(stepsize: f32, voxel_size: f32) -> Self {
        Self {
            stepsize,
            voxel_size,
            voxel: None,
            near: 0.0,
            far: None,
            color_threshold: 0.0,
            alpha_threshold: 0.0,
            sampled: None,
        }
    }

    /// Samples that a ray may have, at most: `floor(|(Nx+1, Ny+1, Nz+1)| / stepsize)` for level 0's
    /// nodes. The largest grids have half as many at a step of a quarter of a voxel, and the viewer
    /// counts samples in f32, which represents integers exactly only up to 2^24.
    pub const MAX_SAMPLES: u32 = 1 << 20;

    /// Steps of level 0 through the outermost of nested boxes, at most. Samples are farther apart
    /// in the larger boxes, so a ray has far fewer; step numbers must be exact in f32.
    pub const MAX_NESTED_STEPS: u32 = 1 << 24;

    /// The interval that opacities are stated over, in world units.
    pub fn interval_length(&self) -> f64 {
        f64::from(self.stepsize) * f64::from(self.voxel_size)
    }

    /// Length of a step along a unit direction, in world units.
    pub fn step_length(&self, direction: [f64; 3]) -> f64 {
        let Some(voxel) = self.voxel else { return self.interval_length() };
        let square = |axis: usize| (direction[axis] / f64::from(voxel[axis])).powi(2);
        f64::from(self.stepsize) / (square(0) + square(1) + square(2)).sqrt()
    }

    /// Length of the longest step in any direction, in world units.
    pub fn longest_step(&self) -> f64 {
        let edges = self.voxel.unwrap_or([self.voxel_size; 3]);
        f64::from(self.stepsize) * f64::from(edges.into_iter().fold(0.0, f32::max))
    }

    /// The part of a box in which rays are sampled, 0 to 1 along each axis.
    pub fn sampled_shares(&self, bounds: &Bounds) -> [[f64; 2]; 3] {
        let Some(sampled) = &self.sampled else { return [[0.0, 1.0]; 3] };
        let extent = bounds.extent();
        std::array::from_fn(|axis| {
            let corners = [sampled.min[axis], sampled.max[axis]];
            corners.map(|at| (f64::from(at) - f64::from(bounds.min[axis])) / extent[axis])
        })
    }

    /// True if the part in which rays are sampled is a box within `bounds`.
    pub fn samples_within(&self, bounds: &Bounds) -> bool {
        let Some(sampled) = &self.sampled else { return true };
        let within = |axis: usize| {
            let (low, high) = (sampled.min[axis], sampled.max[axis]);
            bounds.min[axis] <= low && low < high && high <= bounds.max[axis]
        };
        (0..3).all(within)
    }

    /// The number of a ray's last sample, in a field whose level 0 has this many nodes.
    pub fn last_sample(&self, nodes: Nodes) -> f64 {
        let [x, y, z] = nodes.0.map(|size| size as f64 + 1.0);
        ((x * x + y * y + z * z).sqrt() / f64::from(self.stepsize)).floor()
    }

    /// The same in nested boxes, of which this is the outermost: an upper bound for all rays.
    pub fn last_nested_sample(&self, outer: &Bounds) -> f64 {
        let edges = self.voxel.unwrap_or([self.voxel_size; 3]);
        let squares = outer.extent().into_iter().zip(edges).map(|(extent, edge)| {
            let voxels = extent / f64::from(edge);
            voxels * voxels
        });
        (squares.sum::<f64>().sqrt() / f64::from(self.stepsize)).floor() + 1.0
    }

    /// Refuses invalid steps: lengths that are not positive, and those with more than
    /// [`Self::MAX_SAMPLES`].
    ///
    /// # Errors
    /// `Malformed`, with the key as its place.
    pub fn check(&self, nodes: Nodes) -> Result<()> {
        self.check_steps(self.last_sample(nodes), Self::MAX_SAMPLES)
    }

    /// The same in nested boxes, of at most [`Self::MAX_NESTED_STEPS`]. Level 0 has this many
    /// `nodes` in `bounds`; the outermost box is `outer`.
    ///
    /// # Errors
    /// `Malformed`, with the key as its place.
    pub fn check_nested(&self, nodes: Nodes, bounds: &Bounds, outer: &Bounds) -> Result<()> {
        if bounds == outer {
            return self.check(nodes);
        }
        self.check_steps(self.last_nested_sample(outer), Self::MAX_NESTED_STEPS)
    }

    fn check_steps(&self, samples: f64, most: u32) -> Result<()> {
        let edges = self.voxel.into_iter().flatten().map(|edge| ("voxel", edge));
        let lengths = [("stepsize", self.stepsize), ("voxel_size", self.voxel_size)];
        for (key, length) in lengths.into_iter().chain(edges) {
            if !(length > 0.0 && length.is_finite()) {
                let place = Place::Key(format!("march.{key}"));
                return Err(Error::malformed(place, length.to_string(), "a positive number"));
            }
        }
        if samples <= f64::from(most) {
            return Ok(());
        }
        let found = format!("{}: rays of {samples:.3e} samples", self.stepsize);
        let expected = format!("steps such that a ray takes at most {most}");
        Err(Error::malformed(Place::Key("march.stepsize".to_owned()), found, expected))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_and_opacities_are_inverse() {
        for interval in [1e-7, 0.25, 0.5, 1.0, 1e5] {
            let activation = Activation::logits(-4.6, interval);
            for target in [1e-12, 1e-6, 1e-3, 0.5, 0.9999] {
                let back = activation.opacity(activation.raw_at_opacity(target));
                let error = (back - target).abs();
                assert!(error <= 1e-12 * target.max(1e-3), "{interval} {target}");
            }
        }
        let activation = Activation::logits(0.0, 0.5);
        assert_eq!(activation.opacity(-1e30), 0.0);
        assert_eq!(activation.opacity(1e30), 1.0);
    }

    #[test]
    fn no_slope_is_steeper_than_stated() {
        for interval in [0.01, 0.25, 0.5, 1.0, 4.0] {
            let activation = Activation::logits(0.3, interval);
            let slope =
                |x: f64| (activation.opacity(x + 0.005) - activation.opacity(x - 0.005)) * 100.0;
            let steepest = (-4000..4000).map(|i| slope(f64::from(i) * 0.01)).fold(0.0, f64::max);
            let (at, stated) = activation.steepest();
            assert!(steepest <= stated && steepest > 0.999 * stated, "{steepest} {stated}");
            assert!(slope(at) > 0.999 * stated, "{interval}: {at}");
        }
    }
}
