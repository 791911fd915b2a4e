//! The features of a network at nodes: all channels of `k0`.

use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::input::network::{NodeFeatures, visit};
use crate::model::field::{Grid, Volume};
use crate::model::grid::Nodes;

/// Features that are stored at nodes.
#[derive(Debug)]
pub(super) struct StoredFeatures {
    grid: Grid,
    limits: Limits,
}

impl StoredFeatures {
    pub(super) fn new(volume: Volume, limits: &Limits) -> Self {
        Self { grid: volume.into(), limits: limits.clone() }
    }
}

impl NodeFeatures for StoredFeatures {
    fn nodes(&self) -> Nodes {
        self.grid.nodes()
    }

    fn memory_bytes(&self) -> u64 {
        let Nodes([_, ny, nz]) = self.nodes();
        // Of some threads.
        (8 * 4 * self.grid.channels() * ny * nz) as u64
    }

    fn digest(&self, see: &mut dyn FnMut(&[u8])) -> Result<()> {
        // The checksums of an archive, if there are any, stand for all values.
        let Nodes([nx, ny, nz]) = self.nodes();
        let mut plane = vec![0.0; ny * nz];
        self.grid.read_plane(0, nx / 2, &mut plane, see)
    }

    fn visit(
        &self,
        x: usize,
        region: &[u64],
        see: &mut dyn FnMut([usize; 2], &[f64]),
    ) -> Result<()> {
        let Nodes([_, ny, nz]) = self.nodes();
        let (plane, width) = (ny * nz, self.grid.channels());
        let place = Place::Tensor("k0.grid".to_owned());
        let mut budget = Budget::new(&self.limits);
        let mut stored: Vec<f32> = budget.zeroed(plane * width, "bytes of a plane", &place)?;
        for (channel, out) in stored.chunks_exact_mut(plane).enumerate() {
            self.grid.read_plane(channel, x, out, |_| {})?;
        }
        let mut features = vec![0.0; width];
        visit(self.nodes(), region, |[y, z]| {
            let values = stored.iter().skip(y * nz + z).step_by(plane);
            features.iter_mut().zip(values).for_each(|(out, value)| *out = f64::from(*value));
            see([y, z], &features);
        });
        Ok(())
    }
}
