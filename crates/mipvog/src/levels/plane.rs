//! Planes of values, the unit of data in a pyramid.

use std::ops::Range;
use std::sync::Mutex;

use crate::base::error::Result;
use crate::base::lock::lock;

/// One plane of one channel of one level.
#[derive(Debug)]
pub struct Plane<'a> {
    /// The level, 0 is the finest.
    pub level: usize,
    /// The plane's number along x.
    pub x: usize,
    /// The channel, counted over the channels that the level has. Density is channel 0 where the
    /// level has density.
    pub channel: usize,
    /// Values of the nodes, `[y][z]`, z fastest. Nodes that are not required have unspecified
    /// values.
    pub values: &'a mut [f32],
}

/// A source of planes of level 0.
pub trait PlaneSource: Sync {
    /// Channels of level 0, density among them.
    fn channels(&self) -> usize;

    /// Fills the nodes of a plane of level 0 whose bits are set in `required`, rows along z. Other
    /// nodes may be filled too. Called from any thread, once for each plane.
    ///
    /// # Errors
    ///
    /// Reading may fail.
    fn read(&self, channel: usize, x: usize, required: &[u64], values: &mut [f32]) -> Result<()>;
}

/// A consumer of planes, which makes bits, ranges, codes or dense arrays of them.
pub trait PlaneSink: Sync {
    /// Consumes a plane while it is in the caches. Called from any thread, in any order.
    ///
    /// # Errors
    ///
    /// A value may be refused.
    fn plane(&self, plane: Plane) -> Result<()>;

    /// Called when all channels of some planes of a level have been taken: for each level in order,
    /// a slab at a time, while later planes are being made.
    ///
    /// # Errors
    ///
    /// The work on a slab may fail.
    fn slab(&self, _level: usize, _planes: Range<usize>) -> Result<()> {
        Ok(())
    }
}

/// Planes for reuse: touching fresh memory costs more than filtering it.
#[derive(Debug, Default)]
pub struct PlanePool(Mutex<Vec<Vec<f32>>>);

impl PlanePool {
    /// A plane of this many unspecified values.
    pub fn take(&self, length: usize) -> Vec<f32> {
        let mut planes = lock(&self.0);
        match planes.iter().rposition(|plane| plane.len() == length) {
            Some(i) => planes.swap_remove(i),
            None => {
                drop(planes);
                vec![0.0; length]
            }
        }
    }

    /// Gives planes back.
    pub fn give(&self, planes: impl IntoIterator<Item = Vec<f32>>) {
        lock(&self.0).extend(planes);
    }
}
