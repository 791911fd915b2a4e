//! Level of detail from a pixel's footprint.
//!
//! `rho` is the larger, over the picture's x and y, of the distance in voxels of size
//! `(max - min) / N` between a sample and one on the ray half a pixel aside (of the same distance or
//! the same index, as the rule says), divided by that half pixel; `lambda = clamp(factor * log2(rho) + bias, 0, last)`. Both rays' samples
//! move linearly with their index, so the offset is linear and `rho^2` a quadratic in it.

use crate::baked::LevelOfDetail;

/// How a ray's level of detail follows from its sample index.
#[derive(Debug, Clone, Copy)]
pub struct Footprint {
    /// Offset to the ray aside along x and y: at index 0, and for each step; voxels for a whole pixel.
    sides: [[[f64; 3]; 2]; 2],
    factor: f32,
    bias: f32,
    last: f32,
}

impl Footprint {
    /// From the sides' offsets in voxels for a whole pixel: `[x or y][at index 0, a step]`.
    pub fn new(sides: [[[f64; 3]; 2]; 2], rule: &LevelOfDetail, levels: usize) -> Self {
        let last = (levels - 1) as f32;
        let last = rule.most.map_or(last, |most| most.min(last));
        Self { sides, factor: rule.factor, bias: rule.bias, last }
    }

    /// The fractional level of sample `k`.
    pub fn lambda(&self, k: f64) -> f32 {
        let squares = self.sides.map(|[start, step]| {
            (0..3).map(|axis| start[axis] + k * step[axis]).map(|offset| offset * offset).sum()
        });
        let square: f64 = f64::max(squares[0], squares[1]);
        // log2(rho) from rho^2; a pixel of no size is the finest level.
        let log = 0.5 * square.max(f64::MIN_POSITIVE).log2() as f32;
        (self.factor * log + self.bias).clamp(0.0, self.last)
    }

    /// The level of all samples from `first` to `last`, if it is the same.
    pub fn constant(&self, first: f64, last: f64) -> Option<f32> {
        // rho^2 is convex in k, so it is largest at an end; small there, it is small between.
        let (a, b) = (self.lambda(first), self.lambda(last));
        (self.last == 0.0 || (a == 0.0 && b == 0.0)).then_some(0.0)
    }
}
