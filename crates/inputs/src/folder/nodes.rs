//! Density and logits at nodes, plane by plane.

use std::fmt::Debug;
use std::sync::Arc;

use super::scene::raw_density;
use crate::base::error::Result;
use crate::base::progress::{Progress, Silent};
use crate::model::field::NodeValues;
use crate::model::grid::Nodes;
use crate::network::{PlaneCache, visit};

/// Nodes beyond each face.
pub const BORDER: usize = 1;

/// Logits of a colour and of four features.
pub type Logits = [f32; 7];

/// A folder's values at the nodes of its field.
pub trait FieldNodes: Debug + Send + Sync {
    /// Nodes along each axis.
    fn nodes(&self) -> Nodes;

    /// Bytes of all values in memory, at most, and of what reading them takes.
    fn memory_bytes(&self) -> u64;

    /// Reads all values, once.
    ///
    /// # Errors
    /// Errors of the pictures.
    fn load(&self) -> Result<()>;

    /// The opacity that a voxel has at each node of plane `x`, z fastest.
    ///
    /// # Errors
    /// Those of [`Self::load`].
    fn opacities(&self, x: usize) -> Result<Vec<f64>>;

    /// The logits at nodes `[y, z]` of plane `x`.
    ///
    /// # Errors
    /// Those of [`Self::load`].
    fn logits(&self, x: usize) -> Result<impl Fn([usize; 2]) -> Logits>;
}

fn digest(hash: &mut dyn FnMut(&[u8])) -> Result<()> {
    // The digests of pictures have the checksums of all values.
    hash(&[]);
    Ok(())
}

/// Raw densities, whose opacity is a voxel's.
#[derive(Debug)]
pub struct DensityValues<A>(pub Arc<A>);

impl<A: FieldNodes> NodeValues for DensityValues<A> {
    fn nodes(&self) -> Nodes {
        self.0.nodes()
    }

    fn channels(&self) -> usize {
        1
    }

    fn memory_bytes(&self) -> u64 {
        self.0.memory_bytes()
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        digest(hash)
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.0.load()
    }

    fn read(&self, _: usize, x: usize, _: &[u64], out: &mut [f32]) -> Result<u64> {
        let opacities = self.0.opacities(x)?;
        out.iter_mut().zip(opacities).for_each(|(out, opacity)| *out = raw_density(opacity));
        Ok(0)
    }
}

/// Logits of diffuse colours, then of features.
#[derive(Debug)]
pub struct ColorValues<A> {
    assets: Arc<A>,
    channels: usize,
    planes: PlaneCache,
}

impl<A> ColorValues<A> {
    /// The first `channels` of them.
    pub fn new(assets: Arc<A>, channels: usize) -> Self {
        Self { assets, channels, planes: PlaneCache::default() }
    }
}

impl<A: FieldNodes> NodeValues for ColorValues<A> {
    fn nodes(&self) -> Nodes {
        self.assets.nodes()
    }

    fn channels(&self) -> usize {
        self.channels
    }

    fn memory_bytes(&self) -> u64 {
        self.planes.bytes(self.nodes(), self.channels)
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        digest(hash)
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.assets.load()
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let (plane, nodes) = (out.len(), self.nodes());
        let Nodes([_, _, nz]) = nodes;
        let channels = [channel, self.channels];
        // Before the plane is locked: loading runs in parallel.
        self.prepare(&Silent)?;
        self.planes.read(nodes, x, channels, region, out, |region, values| {
            let logits = self.assets.logits(x)?;
            visit(nodes, region, |[y, z]| {
                let out = values.iter_mut().skip(y * nz + z).step_by(plane);
                out.zip(logits([y, z])).for_each(|(out, value)| *out = value);
            });
            Ok(())
        })?;
        Ok(0)
    }
}
