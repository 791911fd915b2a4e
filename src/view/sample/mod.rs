//! Reading fields between nodes.
//!
//! [`Sample`] is what a renderer sees of a field: values at positions of a level, and where nothing
//! is to be seen. It has two implementations, [`Dense`] for a field as trained and [`Sparse`] for a
//! baked one, over the same arrays: a level's density, its colours interleaved node by node, and a
//! rule that finds the lowest node of a position's cell. Colours have `C` lanes, unused ones zero,
//! so that interpolating them is a handful of vector instructions.
//!
//! What is interpolated is what the level holds; of raw density what the activation's order says: raw
//! density, density or opacity.

mod dense;
mod level;
mod skip;
mod sparse;

pub use dense::Dense;
pub use level::Cell;
pub use skip::{Macro, SkipGrid};
pub use sparse::Sparse;

use crate::model::activate;
use crate::model::baked::Decode;
use crate::model::field::{Activation, ActivationOrder};

/// A field between its nodes.
pub trait Sample<const C: usize>: Sync {
    /// Levels, finest first.
    fn levels(&self) -> usize;

    /// The cell of a position, `0..=1` along each axis of the box; none where nothing is stored.
    fn locate(&self, level: usize, position: [f64; 3]) -> Option<Cell>;

    /// Interpolated density of a located cell of a level that has density.
    fn density(&self, level: usize, cell: &Cell) -> f32;

    /// Interpolated raw colour and features of a located cell.
    fn color(&self, level: usize, cell: &Cell) -> [f32; C];

    /// Whether a level has density of its own.
    fn density_level(&self, level: usize) -> bool;

    /// What densities of a level mean.
    fn decode(&self, level: usize) -> Decode;

    /// Density where nothing is stored, of a level that has density.
    fn empty_density(&self, level: usize) -> f32;

    /// Raw colour and features where nothing is stored.
    fn empty_color(&self, level: usize) -> [f32; C];

    /// What can be skipped.
    fn skip(&self) -> &SkipGrid;
}

/// Values of either kind.
#[derive(Debug)]
pub enum Stored<const C: usize> {
    /// As trained.
    Dense(Dense<C>),
    /// Baked.
    Sparse(Sparse<C>),
}

/// Densities beyond are as good as these, and differences of larger ones overflow.
const LARGEST_DENSITY: f32 = 1e30;

/// A node's density as it is interpolated.
fn interpolated_density(activation: &Activation, decode: Decode, raw: f32) -> f32 {
    let raw = raw.clamp(-LARGEST_DENSITY, LARGEST_DENSITY);
    if decode != Decode::RawDensity {
        return raw;
    }
    let (shift, interval) = (f64::from(activation.shift), f64::from(activation.interval));
    match activation.order {
        ActivationOrder::Raw => raw,
        ActivationOrder::Density => activate::softplus(f64::from(raw) + shift) as f32,
        ActivationOrder::Opacity => activate::opacity(raw.into(), shift, interval) as f32,
    }
}
