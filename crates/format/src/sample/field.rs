//! A field as a renderer reads it.

use super::level::Cell;
use super::skip::SkipGrid;
use crate::model::anisotropy::ANISOTROPY;
use crate::model::baked::DensityDomain;

/// A field between its nodes.
pub trait SampleLevels<const C: usize>: Sync {
    /// Levels, finest first.
    fn levels(&self) -> usize;

    /// The part that shows a level in a nested box: the level itself, or its shell where no smaller
    /// box is. Everything below takes the numbers of parts.
    #[inline(always)]
    fn part(&self, level: usize, number: usize) -> usize {
        if number > 0 && level == number { self.levels() + number - 1 } else { level }
    }

    /// The cell of a position, `0..=1` along each axis of the box of everything; none where nothing
    /// is stored.
    fn locate(&self, level: usize, position: [f64; 3]) -> Option<Cell>;

    /// Interpolated density of a located cell of a level that has density, in a direction in which
    /// the functions of anisotropy have the values `along`; with zeros, the mean of all directions.
    fn density(&self, level: usize, cell: &Cell, along: &[f32; ANISOTROPY]) -> f32;

    /// Interpolated raw colour and features of a located cell.
    fn color(&self, level: usize, cell: &Cell) -> [f32; C];

    /// True if a level has density of its own.
    fn density_level(&self, level: usize) -> bool;

    /// Meaning of a level's densities.
    fn density_domain(&self, level: usize) -> DensityDomain;

    /// What optical depths that are stored are multiplied by to be those over one interval: in box `m`
    /// they are over `2^m`.
    fn depth_scale(&self, _part: usize) -> f32 {
        1.0
    }

    /// Density where nothing is stored, of a level that has density.
    fn empty_density(&self, level: usize) -> f32;

    /// Raw colour and features where nothing is stored.
    fn empty_color(&self, level: usize) -> [f32; C];

    /// The space that can be skipped in a nested box. Its first level is the box's number.
    fn skip(&self, number: usize) -> &SkipGrid;
}
