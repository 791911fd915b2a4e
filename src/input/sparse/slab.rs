//! A few planes of rows, and the last ones that were wanted.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use super::array::RowArray;
use super::index::{Index, NO_ROW};
use crate::base::error::Result;

/// Planes of a slab, at most: rows in Morton order then lie together.
const PLANES: usize = 8;
/// Bytes of a slab, at most, unless one plane is larger.
const SLAB_BYTES: usize = 48 << 20;
/// Slabs that are kept.
const KEPT: usize = 3;

/// The rows of the nodes of one plane.
#[derive(Debug)]
pub(super) struct Plane {
    /// Nodes that have a row, ascending, `y * nz + z`.
    pub(super) nodes: Vec<u32>,
    /// Their rows as stored.
    pub(super) rows: Vec<u8>,
}

/// Consecutive planes.
#[derive(Debug)]
struct Slab {
    planes: Vec<Plane>,
}

/// A slab that one thread fills while others wait.
type Slot = Arc<Mutex<Option<Arc<Slab>>>>;

/// The last slabs that were wanted.
#[derive(Debug)]
pub(super) struct Slabs {
    planes: usize,
    kept: Mutex<VecDeque<(usize, Slot)>>,
}

impl Slabs {
    pub(super) fn new(index: &Index, array: &RowArray) -> Self {
        let [_, ny, nz] = index.nodes().0;
        let plane_bytes = (ny * nz).saturating_mul(array.row_bytes() + 4).max(1);
        let planes = (SLAB_BYTES / plane_bytes).clamp(1, PLANES);
        Self { planes, kept: Mutex::default() }
    }

    /// Bytes of all that is kept, at most.
    pub(super) fn memory_bytes(&self, index: &Index, array: &RowArray) -> u64 {
        let [_, ny, nz] = index.nodes().0;
        let plane_bytes = (ny * nz) as u64 * (array.row_bytes() as u64 + 4);
        // One more while the oldest is still in use.
        (KEPT as u64 + 1) * self.planes as u64 * plane_bytes
    }

    /// Calls `take` with plane `x`, and returns the bytes that were read for it.
    pub(super) fn with_plane(
        &self,
        index: &Index,
        array: &RowArray,
        x: usize,
        take: impl FnOnce(&Plane),
    ) -> Result<u64> {
        let number = x / self.planes;
        let slot = self.slot(number);
        let mut filled = slot.lock().unwrap_or_else(PoisonError::into_inner);
        let mut read = 0;
        let slab = match &*filled {
            Some(slab) => Arc::clone(slab),
            None => {
                let (slab, bytes) = self.fill(index, array, number)?;
                read = bytes;
                let slab = Arc::new(slab);
                *filled = Some(Arc::clone(&slab));
                slab
            }
        };
        drop(filled);
        if let Some(plane) = slab.planes.get(x % self.planes) {
            take(plane);
        }
        Ok(read)
    }

    fn slot(&self, number: usize) -> Slot {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = kept.iter().position(|(own, _)| *own == number)
            && let Some(entry) = kept.remove(at)
        {
            let slot = Arc::clone(&entry.1);
            kept.push_back(entry);
            return slot;
        }
        if kept.len() >= KEPT {
            kept.pop_front();
        }
        let slot = Slot::default();
        kept.push_back((number, Arc::clone(&slot)));
        slot
    }

    fn fill(&self, index: &Index, array: &RowArray, number: usize) -> Result<(Slab, u64)> {
        let first = number * self.planes;
        let end = (first + self.planes).min(index.nodes().0[0]);
        let (mut planes, mut rows) = (Vec::new(), Vec::new());
        let mut wanted: Vec<(u32, u32)> = Vec::new();
        for x in first..end {
            index.plane(x, &mut rows)?;
            let mut nodes = Vec::new();
            for (node, &row) in (0u32..).zip(&rows).filter(|(_, row)| **row != NO_ROW) {
                nodes.push(node);
                // Fewer than 2^32: a slab has as many nodes at most.
                wanted.push((row, u32::try_from(wanted.len()).unwrap_or(NO_ROW)));
            }
            planes.push(Plane { nodes, rows: Vec::new() });
        }
        let size = array.row_bytes();
        let mut bytes = vec![0; wanted.len() * size];
        let read = array.gather(&mut wanted, &mut bytes)?;
        let mut rest = &bytes[..];
        for plane in &mut planes {
            let (own, left) = rest.split_at(plane.nodes.len() * size);
            plane.rows = own.to_vec();
            rest = left;
        }
        Ok((Slab { planes }, read))
    }
}
