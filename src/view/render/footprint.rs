//! Level of detail from a pixel's footprint.
//!
//! `rho` is the larger, over the picture's x and y, of the distance in voxels of size `(max - min)
//! / N` between a sample and one on the ray half a pixel aside (of the same distance or the same
//! index, as the rule says), divided by that half pixel; [`LevelOfDetail`] turns it into a level.
//! Both rays' samples move linearly with their index, so the offset is linear and `rho^2` a
//! quadratic in it.

use crate::model::activate::lanes;
use crate::model::baked::{Bends, FootprintNeighbour, LevelOfDetail};

/// The rule for a ray's level of detail at each sample.
#[derive(Debug, Clone, Copy)]
pub struct Footprint {
    /// Offset to the ray aside along x and y: at index 0, and for each step; voxels for a whole
    /// pixel.
    sides: [[[f64; 3]; 2]; 2],
    rule: LevelOfDetail,
    finest: f32,
    last: f32,
}

impl Footprint {
    /// From the sides' offsets in voxels for a whole pixel, `[x or y][at index 0, a step]`;
    /// `levels` are the finest and the coarsest that may be read.
    pub fn new(sides: [[[f64; 3]; 2]; 2], rule: &LevelOfDetail, levels: [usize; 2]) -> Self {
        let [finest, coarsest] = levels.map(|level| level as f32);
        let last = rule.bound.map_or(coarsest, |bound| bound.min(coarsest)).max(finest);
        Self { sides, rule: *rule, finest, last }
    }

    /// A level that does not depend on the footprint.
    pub fn fixed(level: usize) -> Self {
        let only = level as f32;
        let rule = LevelOfDetail {
            factor: 0.0,
            bias: only,
            neighbour: FootprintNeighbour::SameDistance,
            bound: None,
            bends: Bends::default(),
        };
        Self { sides: [[[0.0; 3]; 2]; 2], rule, finest: only, last: only }
    }

    /// The fractional level of sample `k`.
    #[inline(always)]
    pub fn lambda(&self, k: f64) -> f32 {
        let square = |[start, step]: &[[f64; 3]; 2]| {
            let along = |axis: usize| start[axis] + k * step[axis];
            let (x, y, z) = (along(0), along(1), along(2));
            x * x + y * y + z * z
        };
        self.level(f64::max(square(&self.sides[0]), square(&self.sides[1])))
    }

    /// Bounds of the levels of all samples from `first` to `last`, equal where the level is.
    pub fn range(&self, first: f64, last: f64) -> [f32; 2] {
        if self.finest == self.last {
            return [self.last; 2];
        }
        // Each side's square is convex: largest at an end, least at its vertex.
        let highest = self.lambda(first).max(self.lambda(last));
        let least = self.sides.map(|[start, step]| {
            let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            let vertex = -dot(start, step) / dot(step, step).max(f64::MIN_POSITIVE);
            let k = vertex.clamp(first, last);
            let offset = [0, 1, 2].map(|axis| start[axis] + k * step[axis]);
            dot(offset, offset)
        });
        [self.level(f64::max(least[0], least[1])).min(highest), highest]
    }

    /// The level of a footprint whose square is this.
    #[inline(always)]
    fn level(&self, square: f64) -> f32 {
        // log2(rho) from rho^2; a pixel of no size is the finest level.
        let log = 0.5 * lanes::log2(square as f32);
        self.rule.level(log).clamp(self.finest, self.last)
    }
}
