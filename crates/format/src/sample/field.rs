//! The renderer's interface to a field.

use super::level::Cell;
use super::skip::SkipGrid;
use crate::model::anisotropy::ANISOTROPY;
use crate::model::baked::DensityDomain;

/// A field between its nodes.
pub trait SampleLevels<const C: usize>: Sync {
    /// Levels, finest first.
    fn levels(&self) -> usize;

    /// The part for a level in a nested box: the level itself, or its shell outside the smaller
    /// boxes. All following methods take part numbers.
    #[inline(always)]
    fn part(&self, level: usize, number: usize) -> usize {
        if number > 0 && level == number { self.levels() + number - 1 } else { level }
    }

    /// The cell of a position, `0..=1` along each axis of the outermost box; none in blocks that
    /// are not stored.
    fn locate(&self, level: usize, position: [f64; 3]) -> Option<Cell>;

    /// Interpolated density in a cell of a level with density. `along` has the values of
    /// anisotropy's functions in the direction; zeros give the mean of all directions.
    fn density(&self, level: usize, cell: &Cell, along: &[f32; ANISOTROPY]) -> f32;

    /// Interpolated raw colour and features in a cell.
    fn color(&self, level: usize, cell: &Cell) -> [f32; C];

    /// True if a level has density of its own.
    fn density_level(&self, level: usize) -> bool;

    /// Meaning of a level's densities.
    fn density_domain(&self, level: usize) -> DensityDomain;

    /// The factor from stored optical depths to those over one interval: in box `m` they are over
    /// `2^m` intervals.
    fn depth_scale(&self, _part: usize) -> f32 {
        1.0
    }

    /// Density in blocks that are not stored, of a level with density.
    fn empty_density(&self, level: usize) -> f32;

    /// Raw colour and features in blocks that are not stored.
    fn empty_color(&self, level: usize) -> [f32; C];

    /// The empty space in a nested box. Its first level is the box's number.
    fn skip(&self, number: usize) -> &SkipGrid;
}
