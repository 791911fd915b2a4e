//! The voxels of a box.

use crate::model::grid::Bounds;
use mipvog_inputs::snerg::layout::APRON;

/// Tolerance in voxels for boxes of a whole number of voxels, because sizes are float32.
const ROUNDING: f64 = 1e-4;

/// Cubic voxels that cover a box, in the axes of OpenGL: `(-x, z, y)` of the world's.
#[derive(Debug, Clone)]
pub(super) struct VoxelGrid {
    /// Edge of a voxel, in world units.
    pub(super) voxel: f64,
    /// Voxels along each axis.
    pub(super) counts: [usize; 3],
    /// The lowest corner.
    pub(super) min: [f64; 3],
    /// Voxels along the edge of a block.
    pub(super) block: usize,
    bounds: Bounds,
}

impl VoxelGrid {
    /// `longest` voxels along the longest axis of a `part` of a field's `bounds`.
    pub(super) fn new(bounds: &Bounds, part: &Bounds, longest: usize, block: usize) -> Self {
        let [low, high] = [part.min, part.max].map(|corner| corner.map(f64::from));
        let min = [-high[0], low[2], low[1]];
        let max = [-low[0], high[2], high[1]];
        let extent: [f64; 3] = std::array::from_fn(|axis| max[axis] - min[axis]);
        let voxel = extent.into_iter().fold(0.0, f64::max) / longest as f64;
        let counts = extent.map(|extent| (extent / voxel - ROUNDING).ceil().max(1.0) as usize);
        Self { voxel, counts, min, block, bounds: *bounds }
    }

    /// Texels along the edge of a block with its apron.
    pub(super) fn edge(&self) -> usize {
        self.block + 2 * APRON
    }

    /// Blocks along each axis.
    pub(super) fn blocks(&self) -> [usize; 3] {
        self.counts.map(|count| count.div_ceil(self.block))
    }

    /// The voxel of a block's first texel, which belongs to the apron.
    pub(super) fn first(&self, block: [usize; 3]) -> [i64; 3] {
        block.map(|number| (number * self.block) as i64 - APRON as i64)
    }

    /// True for a voxel of the grid. Others are clear.
    pub(super) fn contains(&self, voxel: [i64; 3]) -> bool {
        voxel.into_iter().zip(self.counts).all(|(at, count)| (0..count as i64).contains(&at))
    }

    /// The middle of a voxel in shares of the box, along the world's axes.
    pub(super) fn share(&self, voxel: [i64; 3]) -> [f64; 3] {
        let at = |axis: usize| self.min[axis] + (voxel[axis] as f64 + 0.5) * self.voxel;
        let world = [-at(0), at(2), at(1)];
        let extent = self.bounds.extent();
        [0, 1, 2].map(|axis| (world[axis] - f64::from(self.bounds.min[axis])) / extent[axis])
    }

    /// Two corners around all texels of a block, in shares of the box.
    pub(super) fn corners(&self, block: [usize; 3]) -> [[f64; 3]; 2] {
        let first = self.first(block);
        let [a, b] = [first, first.map(|at| at + self.edge() as i64 - 1)].map(|at| self.share(at));
        let corner = |pick: fn(f64, f64) -> f64| {
            [0, 1, 2].map(|axis| pick(a[axis], b[axis]).clamp(0.0, 1.0))
        };
        [corner(f64::min), corner(f64::max)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_cover_the_box_in_axes_of_opengl() {
        let bounds = Bounds { min: [-1.0, -2.0, 0.0], max: [1.0, 2.0, 1.0] };
        let grid = VoxelGrid::new(&bounds, &bounds, 8, 14);
        assert_eq!((grid.voxel, grid.counts), (0.5, [4, 2, 8]));
        assert_eq!(grid.min, [-1.0, 0.0, -2.0]);
        assert_eq!(grid.blocks(), [1, 1, 1]);
        // Voxel 0 along x of OpenGL is the last one of the world's x.
        assert_eq!(grid.share([0, 1, 7]), [1.75 / 2.0, 3.75 / 4.0, 0.75]);
        assert_eq!(grid.corners([0, 0, 0]), [[0.0; 3], [1.0; 3]]);
    }
}
