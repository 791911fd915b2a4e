//! A grid of one or more channels that is read in place.

use crate::base::bytes::Storage;
use crate::base::error::Result;
use crate::model::grid::{Element, Nodes};

/// Values of a node-centred grid in a file or in memory. The last axis is contiguous; the others
/// have any stride.
#[derive(Debug, Clone)]
pub struct Volume {
    /// Nodes along each axis.
    pub nodes: Nodes,
    /// Channels; the slowest axis.
    pub channels: usize,
    /// Type of the stored numbers.
    pub element: Element,
    /// Place of the bytes.
    pub storage: Storage,
    /// Elements before the first one.
    pub first: u64,
    /// Elements from one channel, x and y to the next.
    pub strides: [u64; 3],
}

impl Volume {
    /// Bytes of all values.
    pub fn bytes(&self) -> u64 {
        (self.channels * self.nodes.count() * self.element.size()) as u64
    }

    /// Some of its channels.
    #[must_use]
    pub fn with_channels(mut self, channels: std::ops::Range<usize>) -> Self {
        self.first += channels.start as u64 * self.strides[0];
        self.channels = channels.len();
        self
    }

    /// True if the values fill the storage contiguously in C order, so that the storage's checksum
    /// covers exactly these bytes.
    pub fn fills_storage(&self) -> bool {
        let [nx, ny, nz] = self.nodes.0.map(|n| n as u64);
        let dense = [nx * ny * nz, ny * nz, nz];
        let channels_dense = self.channels == 1 || self.strides[0] == dense[0];
        let rows_dense = self.strides[1..] == dense[1..];
        self.first == 0 && channels_dense && rows_dense && self.bytes() == self.storage.length()
    }

    /// Element number of the node `(channel, x, y, 0)`.
    fn row(&self, channel: usize, x: usize, y: usize) -> u64 {
        let [c, i, j] = [channel, x, y].map(|index| index as u64);
        self.first + c * self.strides[0] + i * self.strides[1] + j * self.strides[2]
    }

    /// Reads `out.len()` consecutive values that start at node `(x, y, z)` of `channel`. They may
    /// span several rows if rows are contiguous ([`Volume::rows_are_contiguous`]). `hash` gets the
    /// bytes as stored; `scratch` holds them if they are not float32.
    pub fn read_run(
        &self,
        channel: usize,
        [x, y, z]: [usize; 3],
        out: &mut [f32],
        scratch: &mut Vec<u8>,
        hash: impl FnOnce(&[u8]),
    ) -> Result<()> {
        let size = self.element.size();
        let first = (self.row(channel, x, y) + z as u64) * size as u64;
        // Little-endian float32 needs no conversion: it is read straight into the result.
        if self.element == Element::F32 && cfg!(target_endian = "little") {
            let bytes = bytemuck::cast_slice_mut(out);
            self.storage.read_into(first, bytes)?;
            hash(bytes);
            return Ok(());
        }
        scratch.resize(out.len() * size, 0);
        self.storage.read_into(first, scratch)?;
        hash(scratch);
        self.element.decode(scratch, out);
        Ok(())
    }

    /// True if the rows of one x plane follow each other without gaps.
    pub fn rows_are_contiguous(&self) -> bool {
        self.strides[2] == self.nodes.0[2] as u64
    }
}
