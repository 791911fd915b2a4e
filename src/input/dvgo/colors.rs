//! Harmonics that are fitted to a network at nodes.

use std::sync::Arc;

use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::input::lazy::Lazy;
use crate::input::network::{Fit, Network, NetworkFile, PlaneCache, visit};
use crate::model::field::{Grid, NodeValues};
use crate::model::grid::Nodes;
use crate::model::harmonics::Harmonics;

/// Coefficients at nodes.
#[derive(Debug)]
pub(super) struct FittedColors {
    color: Grid,
    network: NetworkFile,
    harmonics: Harmonics,
    fit: Fit,
    limits: Limits,
    loaded: Lazy<Network>,
    planes: PlaneCache,
}

impl FittedColors {
    pub(super) fn new(
        color: Grid,
        network: NetworkFile,
        harmonics: Harmonics,
        limits: &Limits,
    ) -> Self {
        let (fit, limits) = (Fit::new(harmonics.functions()), limits.clone());
        let (loaded, planes) = (Lazy::default(), PlaneCache::default());
        Self { color, network, harmonics, fit, limits, loaded, planes }
    }

    fn network(&self) -> Result<Arc<Network>> {
        self.loaded.get(|| self.network.load(&mut Budget::new(&self.limits)))
    }
}

impl NodeValues for FittedColors {
    fn nodes(&self) -> Nodes {
        self.color.nodes()
    }

    fn channels(&self) -> usize {
        3 * self.harmonics.functions()
    }

    fn memory_bytes(&self) -> u64 {
        let features = match &self.color {
            Grid::Array(_) => 0,
            Grid::Values(values) => values.memory_bytes(),
        };
        features + PlaneCache::bytes(self.nodes(), self.channels() + self.color.channels())
    }

    fn digest(&self, see: &mut dyn FnMut(&[u8])) -> Result<()> {
        // The checksums of an archive, if there are any, stand for all values.
        let Nodes([nx, ny, nz]) = self.nodes();
        let mut plane = vec![0.0; ny * nz];
        self.color.read_plane(0, nx / 2, &mut plane, see)
    }

    #[expect(clippy::cast_possible_truncation, reason = "coefficients are float32")]
    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let (plane, channels) = (out.len(), self.channels());
        let Nodes([_, _, nz]) = self.nodes();
        let offset = f64::from(self.harmonics.offset);
        self.planes.read(x, [channel, channels], region, out, |values| {
            let network = self.network()?;
            let place = Place::Tensor("k0.grid".to_owned());
            let mut budget = Budget::new(&self.limits);
            let count = plane * self.color.channels();
            let mut stored: Vec<f32> = budget.zeroed(count, "bytes of a plane", &place)?;
            for (channel, out) in stored.chunks_exact_mut(plane).enumerate() {
                self.color.read_plane(channel, x, out, |_| {})?;
            }
            visit(self.nodes(), region, |[y, z]| {
                let node = y * nz + z;
                let features: Vec<f64> =
                    stored.iter().skip(node).step_by(plane).map(|v| f64::from(*v)).collect();
                let colors = self.fit.directions.iter().map(|&direction| {
                    network.color(&features, [0.0; 3], direction).map(|value| value - offset)
                });
                let out = values.iter_mut().skip(node).step_by(plane);
                let found = self.fit.coefficients(colors);
                out.zip(found).for_each(|(out, value)| *out = value as f32);
            });
            Ok(())
        })?;
        Ok(0)
    }
}
