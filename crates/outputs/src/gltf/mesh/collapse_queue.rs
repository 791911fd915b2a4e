//! The order in which edges collapse.

use std::collections::VecDeque;

/// The collapse of an edge. The queue holds millions, so the merged vertex is recomputed.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgeCollapse {
    /// The vertices, the lower number first.
    pub(super) pair: [u32; 2],
    /// Changes of both when the loss was computed.
    pub(super) changes: [u32; 2],
}

/// Collapses by their loss, to a quarter of an octave; within that, the oldest first. A heap sorts exactly,
/// but most of its entries are outdated before they are reached, and its cache misses take as long
/// as all else. Pictures are as close to the field either way.
pub(super) struct Queue {
    /// By the upper bits of the loss: non-negative floats sort like their bits.
    buckets: Vec<VecDeque<EdgeCollapse>>,
    /// All buckets below this one are empty.
    lowest: usize,
}

impl Queue {
    /// Sign, exponent and two bits of the mantissa.
    const BITS: u32 = 14;

    pub(super) fn new() -> Self {
        Self { buckets: vec![VecDeque::new(); 1 << Self::BITS], lowest: 0 }
    }

    pub(super) fn push(&mut self, loss: f64, edge: EdgeCollapse) {
        let bucket = (loss.to_bits() >> (u64::BITS - Self::BITS)) as usize;
        self.buckets[bucket].push_back(edge);
        self.lowest = self.lowest.min(bucket);
    }

    pub(super) fn pop(&mut self) -> Option<EdgeCollapse> {
        loop {
            match self.buckets.get_mut(self.lowest)?.pop_front() {
                None => self.lowest += 1,
                edge => return edge,
            }
        }
    }
}
