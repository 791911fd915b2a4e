//! Colours that are found node by node, kept plane by plane for their other channels.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::base::error::Result;
use crate::model::grid::{Nodes, row};

/// Planes that are kept.
const KEPT_PLANES: usize = 4;

/// The planes that were found last, with all their channels.
#[derive(Debug, Default)]
pub struct PlaneCache {
    kept: Mutex<Vec<Arc<Slot>>>,
}

/// A plane.
#[derive(Debug)]
struct Slot {
    x: usize,
    filled: Mutex<Option<Filled>>,
}

#[derive(Debug)]
struct Filled {
    region: Vec<u64>,
    /// Channel by channel.
    values: Vec<f32>,
}

/// A lock that a panic elsewhere does not poison.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Visits the nodes `(y, z)` of a plane that belong to a region.
pub fn visit(nodes: Nodes, region: &[u64], mut visit: impl FnMut([usize; 2])) {
    let Nodes([_, _, nz]) = nodes;
    for (y, bits) in region.chunks_exact(row::words(nodes)).enumerate() {
        for (start, end) in row::runs(bits) {
            (start..end.min(nz)).for_each(|z| visit([y, z]));
        }
    }
}

impl PlaneCache {
    /// Bytes of the planes of so many nodes and channels.
    pub fn bytes(nodes: Nodes, channels: usize) -> u64 {
        let Nodes([_, ny, nz]) = nodes;
        (4 * KEPT_PLANES * channels * ny * nz) as u64
    }

    /// Copies one of `channels` of plane `x`. Where the plane is not there, `fill` finds all its
    /// channels at the nodes of the region, channel by channel.
    ///
    /// # Errors
    /// Those of `fill`.
    pub fn read(
        &self,
        x: usize,
        [channel, channels]: [usize; 2],
        region: &[u64],
        out: &mut [f32],
        fill: impl FnOnce(&mut [f32]) -> Result<()>,
    ) -> Result<()> {
        let slot = self.slot(x);
        let mut filled = lock(&slot.filled);
        let covers = |filled: &Filled| {
            filled.region.iter().zip(region).all(|(has, asked)| asked & !has == 0)
        };
        if !filled.as_ref().is_some_and(covers) {
            let mut values = vec![0.0; out.len() * channels];
            fill(&mut values)?;
            *filled = Some(Filled { region: region.to_vec(), values });
        }
        let values = filled.as_ref().map_or(&[][..], |filled| &filled.values);
        let values = values.get(channel * out.len()..).unwrap_or_default();
        out.iter_mut().zip(values).for_each(|(out, value)| *out = *value);
        Ok(())
    }

    /// The plane's place among those that are kept.
    fn slot(&self, x: usize) -> Arc<Slot> {
        let mut kept = lock(&self.kept);
        if let Some(slot) = kept.iter().find(|slot| slot.x == x) {
            return Arc::clone(slot);
        }
        if kept.len() == KEPT_PLANES {
            kept.remove(0);
        }
        let slot = Arc::new(Slot { x, filled: Mutex::new(None) });
        kept.push(Arc::clone(&slot));
        slot
    }
}
