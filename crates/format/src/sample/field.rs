//! A field as a renderer reads it.

use super::level::Cell;
use super::skip::SkipGrid;
use crate::model::anisotropy::ANISOTROPY;
use crate::model::baked::DensityDomain;

/// A field between its nodes.
pub trait SampleLevels<const C: usize>: Sync {
    /// Levels, finest first.
    fn levels(&self) -> usize;

    /// The cell of a position, `0..=1` along each axis of the box; none where nothing is stored.
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

    /// Density where nothing is stored, of a level that has density.
    fn empty_density(&self, level: usize) -> f32;

    /// Raw colour and features where nothing is stored.
    fn empty_color(&self, level: usize) -> [f32; C];

    /// The space that can be skipped.
    fn skip(&self) -> &SkipGrid;
}
