//! Colours of a network whose features are channels of a grid.

use std::sync::Arc;

use super::batch::{Batch, BatchNetwork, Scratch};
use super::fitted::{NodeColors, OnNode};
use super::node_set::{corner_shares, corners};
use super::planes::visit;
use super::projected::{OnPoint, PointColors};
use super::run::{Network, NetworkFile};
use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::progress::Progress;
use crate::model::field::Grid;
use crate::model::grid::Nodes;

/// Cells of a row of nodes, at most.
const CELLS: u64 = 64;

/// A grid of features, and the network that makes colours of them.
#[derive(Debug)]
pub struct StoredFeatures {
    features: Grid,
    network: NetworkFile,
    limits: Limits,
}

impl StoredFeatures {
    /// All channels of `features` are inputs of the network.
    pub fn new(features: Grid, network: NetworkFile, limits: &Limits) -> Self {
        Self { features, network, limits: limits.clone() }
    }

    /// The features of a plane, channel by channel.
    fn plane(&self, x: usize, region: &[u64]) -> Result<Vec<f32>> {
        let Nodes([_, ny, nz]) = self.features.nodes();
        let mut budget = Budget::new(&self.limits);
        let place = Place::Key("features".to_owned());
        let count = ny * nz * self.features.channels();
        let mut stored: Vec<f32> = budget.zeroed(count, "bytes of a plane", &place)?;
        for (channel, out) in stored.chunks_exact_mut(ny * nz).enumerate() {
            match &self.features {
                Grid::Array(_) => self.features.read_plane(channel, x, out, |_| {})?,
                Grid::Values(values) => {
                    values.read(channel, x, region, out)?;
                }
            }
        }
        Ok(stored)
    }
}

impl NodeColors for StoredFeatures {
    type Network = (Network, BatchNetwork);
    type Along = Batch;

    fn nodes(&self) -> Nodes {
        self.features.nodes()
    }

    fn memory_bytes(&self, directions: usize) -> [u64; 2] {
        let Nodes([_, ny, nz]) = self.nodes();
        let stored = (4 * ny * nz * self.features.channels()) as u64;
        let cells = Batch::bytes(directions, self.network.hidden_width()) * CELLS;
        let features = match &self.features {
            Grid::Array(_) => 0,
            Grid::Values(values) => values.memory_bytes(),
        };
        [stored + cells, features]
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        match &self.features {
            Grid::Values(values) => values.digest(hash),
            Grid::Array(_) => {
                // The checksums of an archive, if any, cover all values.
                let Nodes([nx, ny, nz]) = self.nodes();
                let mut plane = vec![0.0; ny * nz];
                self.features.read_plane(0, nx / 2, &mut plane, hash)
            }
        }
    }

    fn load(&self, progress: &dyn Progress) -> Result<Arc<Self::Network>> {
        self.features.prepare(progress)?;
        let network = self.network.load(&mut Budget::new(&self.limits))?;
        let batches = BatchNetwork::new(&network);
        Ok(Arc::new((network, batches)))
    }

    fn along(&self, (network, batches): &Self::Network, directions: &[[f64; 3]]) -> Batch {
        batches.batch(network, directions)
    }

    fn visit(
        &self,
        (network, batches): &Self::Network,
        x: usize,
        region: &[u64],
        on_node: OnNode<'_, Batch>,
    ) -> Result<()> {
        let Nodes([nx, ny, nz]) = self.nodes();
        let stored = self.plane(x, region)?;
        let (mut features, mut scratch) = (Vec::new(), Scratch::default());
        let place = |at: usize, count: usize| 2.0 * at as f64 / (count - 1) as f64 - 1.0;
        visit(self.nodes(), region, |[y, z]| {
            let own = stored.iter().skip(y * nz + z).step_by(ny * nz);
            features.clear();
            features.extend(own.map(|value| f64::from(*value)));
            let at = [place(x, nx), place(y, ny), place(z, nz)];
            on_node([y, z], &mut |batch, colors| {
                batches.colors(network, batch, &features, at, &mut scratch, colors);
            });
        });
        Ok(())
    }
}

impl PointColors for StoredFeatures {
    fn visit_points(
        &self,
        (network, batches): &Self::Network,
        x: usize,
        cells: &[u64],
        offsets: &[[f64; 3]],
        on_point: OnPoint<'_, Batch>,
    ) -> Result<()> {
        let Nodes([nx, ny, nz]) = self.features.nodes();
        let region = corners(self.nodes(), cells);
        let planes = [self.plane(x, &region)?, self.plane(x + 1, &region)?];
        let (mut features, mut scratch) = (Vec::new(), Scratch::default());
        let place = |at: f64, count: usize| 2.0 * at / (count - 1) as f64 - 1.0;
        visit(self.nodes(), cells, |[y, z]| {
            for (number, &[by_x, by_y, by_z]) in offsets.iter().enumerate() {
                on_point([y, z], number, &mut |batch, colors| {
                    features.clear();
                    features.resize(self.features.channels(), 0.0);
                    for (corner, share) in corner_shares([by_x, by_y, by_z]).iter().enumerate() {
                        let node = (y + (corner >> 1 & 1)) * nz + z + (corner & 1);
                        let plane = planes.get(corner >> 2).map_or(&[][..], Vec::as_slice);
                        let own = plane.iter().skip(node).step_by(ny * nz);
                        let sums = features.iter_mut().zip(own);
                        sums.for_each(|(sum, value)| *sum += share * f64::from(*value));
                    }
                    let at = [
                        place(x as f64 + by_x, nx),
                        place(y as f64 + by_y, ny),
                        place(z as f64 + by_z, nz),
                    ];
                    batches.colors(network, batch, &features, at, &mut scratch, colors);
                });
            }
        });
        Ok(())
    }
}
