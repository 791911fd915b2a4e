//! Level of detail from a pixel's footprint.
//!
//! `rho` is the footprint of a pixel in voxels of size `(max - min) / N`: the distance between a
//! sample and the corresponding one on the ray half a pixel aside, divided by that half pixel. The
//! larger value of the picture's x and y counts. The rule decides whether the corresponding sample
//! has the same distance or the same index. [`LevelOfDetail`] converts `rho` to a level. The
//! positions of samples on both rays are linear in the index, so their offset is linear and `rho^2`
//! is quadratic in the index.

use crate::model::activate::lanes;
use crate::model::baked::{Bends, FootprintNeighbour, LevelOfDetail};

/// The rule for a ray's level of detail at each sample.
#[derive(Debug, Clone, Copy)]
pub struct Footprint {
    /// `rho^2` of the neighbouring rays along x and y: constant, linear and quadratic coefficients
    /// in the index.
    squares: [[f64; 3]; 2],
    rule: LevelOfDetail,
    finest: f32,
    last: f32,
}

impl Footprint {
    /// Makes the rule from the offsets of the neighbouring rays, in voxels per pixel:
    /// `[x or y][at index 0, per step]`. `levels` are the finest and the coarsest readable level.
    pub fn new(sides: [[[f64; 3]; 2]; 2], rule: &LevelOfDetail, levels: [usize; 2]) -> Self {
        let [finest, coarsest] = levels.map(|level| level as f32);
        let last = rule.bound.map_or(coarsest, |bound| bound.min(coarsest)).max(finest);
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let squares = sides.map(|[at, by]| [dot(at, at), 2.0 * dot(at, by), dot(by, by)]);
        Self { squares, rule: *rule, finest, last }
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
        Self { squares: [[0.0; 3]; 2], rule, finest: only, last: only }
    }

    /// The fractional level of sample `k`.
    #[inline(always)]
    pub fn lambda(&self, k: f64) -> f32 {
        self.level(self.square(k, 0).max(self.square(k, 1)))
    }

    /// `rho^2` of one neighbour at index `k`. Near the minimum, rounding may make it negative.
    #[inline(always)]
    fn square(&self, k: f64, side: usize) -> f64 {
        let [constant, linear, square] = self.squares[side];
        (constant + k * (linear + k * square)).max(0.0)
    }

    /// Bounds of the levels from sample `first` to `last`; equal if the level is constant.
    pub fn range(&self, first: f64, last: f64) -> [f32; 2] {
        if self.finest == self.last {
            return [self.last; 2];
        }
        // Each side's square is convex: largest at an end, least at its vertex.
        let highest = self.lambda(first).max(self.lambda(last));
        let least = [0, 1].map(|side| {
            let [_, linear, square] = self.squares[side];
            let vertex = -0.5 * linear / square.max(f64::MIN_POSITIVE);
            self.square(vertex.clamp(first, last), side)
        });
        [self.level(f64::max(least[0], least[1])).min(highest), highest]
    }

    /// The level of a footprint whose square is given.
    #[inline(always)]
    fn level(&self, square: f64) -> f32 {
        // log2(rho) from rho^2; a pixel of no size is the finest level.
        let log = 0.5 * lanes::log2(square as f32);
        self.rule.level(log).clamp(self.finest, self.last)
    }
}
