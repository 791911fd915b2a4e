//! Products of factors at nodes, plane by plane.

use std::sync::Arc;

use super::mix::{FactorArrays, Scratch};
use super::product::Tap;
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::base::progress::Progress;
use crate::lazy::Lazy;
use crate::model::field::NodeValues;
use crate::model::grid::Nodes;
use crate::network::{PlaneCache, visit};

/// Bytes that are hashed at once.
const PIECE: usize = 1 << 20;

/// Channels of a grid of factors, which are read with the first node.
#[derive(Debug)]
pub struct FactorGrid {
    arrays: FactorArrays,
    /// The first channels that are used.
    channels: usize,
    limits: Limits,
    loaded: Lazy<super::Mixed>,
    planes: PlaneCache,
}

impl FactorGrid {
    /// The first channels of a grid.
    pub fn new(arrays: FactorArrays, channels: usize, limits: &Limits) -> Self {
        let (loaded, planes) = (Lazy::default(), PlaneCache::default());
        Self { arrays, channels, limits: limits.clone(), loaded, planes }
    }

    fn loaded(&self) -> Result<Arc<super::Mixed>> {
        self.loaded.get(|| self.arrays.load(&mut Budget::new(&self.limits)))
    }
}

impl NodeValues for FactorGrid {
    fn nodes(&self) -> Nodes {
        self.arrays.nodes
    }

    fn channels(&self) -> usize {
        self.channels
    }

    fn memory_bytes(&self) -> u64 {
        // Factors are held twice while they are read.
        2 * self.arrays.bytes() + self.planes.bytes(self.nodes(), self.channels)
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        let mut piece = vec![0; PIECE];
        for tensor in self.arrays.tensors() {
            let storage = tensor.storage(&mut Budget::new(&self.limits))?;
            let mut at = 0;
            while at < storage.length() {
                let left = usize::try_from(storage.length() - at).unwrap_or(PIECE);
                let piece = piece.get_mut(..left.min(PIECE)).unwrap_or_default();
                storage.read_into(at, piece)?;
                hash(piece);
                at += piece.len() as u64;
            }
        }
        Ok(())
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.loaded().map(drop)
    }

    #[expect(clippy::cast_possible_truncation, reason = "values at nodes are float32")]
    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let Nodes([_, _, nz]) = self.nodes();
        let plane = out.len();
        let channels = [channel, self.channels];
        let grid = self.loaded()?;
        self.planes.read(self.nodes(), x, channels, region, out, |region, values| {
            let mut scratch = Scratch::default();
            visit(self.nodes(), region, |[y, z]| {
                let found = grid.values(&[x, y, z].map(Tap::on), &mut scratch);
                let out = values.iter_mut().skip(y * nz + z).step_by(plane);
                out.zip(found).for_each(|(out, value)| *out = value as f32);
            });
            Ok(())
        })?;
        Ok(0)
    }
}
