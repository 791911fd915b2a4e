//! One or more channels of a trained field, as a strided array or from another source.

use std::fmt::Debug;
use std::sync::Arc;

use super::Volume;
use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::model::grid::{NodeMask, Nodes};

/// Values at nodes that are not a strided array: sparse rows, products of factors, samples of
/// another model. Readers request planes of constant x, from any thread and in any order; usually
/// neighbouring planes in sequence, and all channels of a plane together.
pub trait NodeValues: Debug + Send + Sync {
    /// Nodes along each axis.
    fn nodes(&self) -> Nodes;

    /// Channels.
    fn channels(&self) -> usize;

    /// Maximum memory in bytes that the values take while planes are read.
    fn memory_bytes(&self) -> u64;

    /// Feeds a digest with bytes that represent all values.
    ///
    /// # Errors
    /// Errors of reading.
    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()>;

    /// Prepares data that all planes need. Called before the loops that read planes, so that it may
    /// run in parallel itself.
    ///
    /// # Errors
    /// Errors of reading, and a request to stop.
    fn prepare(&self, progress: &dyn Progress) -> Result<()>;

    /// Fills the nodes of `region` (rows of bits along z) of plane `x` of a channel. Other nodes
    /// may be filled or left unchanged. Prepares first if [`Self::prepare`] was not called. Returns
    /// the number of bytes read.
    ///
    /// # Errors
    /// Errors of reading.
    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64>;

    /// Frees the planes that are cached for readers of their neighbours, because reading pauses.
    fn release(&self) {}
}

/// Channels of a trained field.
#[derive(Debug, Clone)]
pub enum Grid {
    /// A dense array, in a file or in memory.
    Array(Volume),
    /// Computed values, or values from a lookup.
    Values(Arc<dyn NodeValues>),
}

impl Grid {
    /// Nodes along each axis.
    pub fn nodes(&self) -> Nodes {
        match self {
            Self::Array(volume) => volume.nodes,
            Self::Values(values) => values.nodes(),
        }
    }

    /// Channels.
    pub fn channels(&self) -> usize {
        match self {
            Self::Array(volume) => volume.channels,
            Self::Values(values) => values.channels(),
        }
    }

    /// Bytes in memory of its values, or of the data that they are computed from.
    pub fn memory_bytes(&self) -> u64 {
        match self {
            Self::Array(volume) => volume.bytes(),
            Self::Values(values) => values.memory_bytes(),
        }
    }

    /// Prepares data that all planes need; see [`NodeValues::prepare`].
    ///
    /// # Errors
    /// Errors of reading, and a request to stop.
    pub fn prepare(&self, progress: &dyn Progress) -> Result<()> {
        match self {
            Self::Array(_) => Ok(()),
            Self::Values(values) => values.prepare(progress),
        }
    }

    /// Frees cached planes; see [`NodeValues::release`].
    pub fn release(&self) {
        if let Self::Values(values) = self {
            values.release();
        }
    }

    /// The storage of an array that has a checksum of its own.
    pub fn has_checksum(&self) -> bool {
        self.array().is_some_and(|volume| volume.storage.crc32().is_some())
    }

    /// Fills all nodes of plane `x` of a channel. `hash` gets the bytes of arrays as stored.
    ///
    /// # Errors
    /// Errors of reading.
    pub fn read_plane(
        &self,
        channel: usize,
        x: usize,
        out: &mut [f32],
        mut hash: impl FnMut(&[u8]),
    ) -> Result<()> {
        match self {
            Self::Array(volume) => {
                let mut scratch = Vec::new();
                let row = if volume.rows_are_contiguous() { out.len() } else { volume.nodes.0[2] };
                for (y, row) in out.chunks_exact_mut(row).enumerate() {
                    volume.read_run(channel, [x, y, 0], row, &mut scratch, &mut hash)?;
                }
            }
            Self::Values(values) => {
                let [_, y, z] = values.nodes().0;
                let whole = NodeMask::full(Nodes([1, y, z]));
                values.read(channel, x, whole.plane(0), out)?;
            }
        }
        Ok(())
    }

    /// The array, if it is one.
    pub fn array(&self) -> Option<&Volume> {
        match self {
            Self::Array(volume) => Some(volume),
            Self::Values(_) => None,
        }
    }
}

impl From<Volume> for Grid {
    fn from(volume: Volume) -> Self {
        Self::Array(volume)
    }
}
