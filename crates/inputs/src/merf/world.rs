//! A whole scene at positions of the world.

use std::sync::Arc;

use super::contraction::{contracted, norm};
use super::parameters::{LOW, SPAN};
use super::sums::{Assets, Sums, density};
use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::folder::OPACITY;
use crate::model::activate::sigmoid;
use crate::model::field::{Grid, Lattice, NodeValues, Scene, Shell};
use crate::model::grid::Nodes;
use crate::nested::{SampledDensity, World, points};
use crate::network::{PlaneCache, visit};

/// Margin in cells at both ends of the sparse grid in which nothing counts.
const BORDER: f64 = 0.6;
/// Shares of colours and features, 0 to 1, keep this far from their ends as logits.
const LEAST: f64 = 1e-6;

impl Sums {
    /// Sums at a position in the folder's axes, where a ray takes samples.
    pub(super) fn shown(&self, own: [f64; 3]) -> Option<[f64; 8]> {
        let at = contracted(own);
        let inside = self.parameters.sparse.is_none_or(|sparse| {
            let count = sparse.resolution as f64;
            let node = |at: f64| (at - LOW) * count / SPAN - 0.5;
            at.iter().all(|at| node(*at) > BORDER && node(*at) < count - BORDER)
        });
        let shown = inside && self.occupancy.empty_cell(at).is_none();
        shown.then(|| self.at(at, 0.0)).flatten()
    }
}

/// A folder as boxes sample it.
#[derive(Debug)]
pub(super) struct MerfWorld(pub(super) Arc<Assets>);

impl World for MerfWorld {
    type Loaded = Sums;

    fn load(&self) -> Result<Arc<Sums>> {
        self.0.sums()
    }

    fn memory_bytes(&self) -> u64 {
        self.0.bytes()
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        // The digests of pictures have the checksums of all values.
        hash(&[]);
        Ok(())
    }

    fn detail(&self, position: [f64; 3]) -> f64 {
        self.0.parameters.voxel_size() * norm(position).max(1.0)
    }

    fn densities(&self, sums: &Sums, positions: &[[f64; 3]], _: bool, densities: &mut Vec<f64>) {
        densities.extend(positions.iter().map(|position| {
            let found = sums.shown(sums.parameters.axes.within(*position));
            found.and_then(|found| found.get(OPACITY).copied()).map_or(0.0, density)
        }));
    }
}

/// Logits of diffuse colours, then of features, at the nodes of a box.
#[derive(Debug)]
struct SampledColors {
    world: Arc<MerfWorld>,
    lattice: Lattice,
    channels: usize,
    planes: PlaneCache,
}

impl SampledColors {
    /// Means of colours and features, weighted by the light that points of the node's cell absorb.
    fn at_node(&self, sums: &Sums, node: [usize; 3]) -> [f64; 7] {
        let points = points(&*self.world, &self.lattice, node, false);
        let spacing = self.lattice.nodes.spacing(&self.lattice.bounds);
        let edge = spacing.into_iter().fold(0.0, f64::max) / libm::cbrt(points.len() as f64);
        let (mut all, mut means) = (0.0, [0.0; 7]);
        for point in points {
            let Some(found) = sums.shown(sums.parameters.axes.within(point)) else { continue };
            let [red, green, blue, sum, a, b, c, d] = found;
            let share = -libm::expm1(-density(sum) * edge);
            all += share;
            let terms = means.iter_mut().zip([red, green, blue, a, b, c, d]);
            terms.for_each(|(mean, logit)| *mean += share * sigmoid(logit));
        }
        if all <= 0.0 {
            return [0.0; 7];
        }
        means.map(|mean| {
            let share = (mean / all).clamp(LEAST, 1.0 - LEAST);
            libm::log(share / (1.0 - share))
        })
    }
}

impl NodeValues for SampledColors {
    fn nodes(&self) -> Nodes {
        self.lattice.nodes
    }

    fn channels(&self) -> usize {
        self.channels
    }

    fn memory_bytes(&self) -> u64 {
        self.planes.bytes(self.nodes(), self.channels)
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        hash(&[]);
        Ok(())
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.world.load().map(drop)
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let (plane, nodes, sums) = (out.len(), self.nodes(), self.world.load()?);
        let Nodes([_, _, nz]) = nodes;
        let channels = [channel, self.channels];
        self.planes.read(nodes, x, channels, region, out, |region, values| {
            visit(nodes, region, |[y, z]| {
                let found = self.at_node(&sums, [x, y, z]);
                let out = values.iter_mut().skip(y * nz + z).step_by(plane);
                #[expect(clippy::cast_possible_truncation, reason = "logits are float32")]
                out.zip(found).for_each(|(out, value)| *out = value as f32);
            });
            Ok(())
        })?;
        Ok(0)
    }
}

/// The values of a scene in a box.
pub(super) fn sampled(
    world: &Arc<MerfWorld>,
    lattice: Lattice,
    scene: &Scene,
    channels: usize,
) -> Shell {
    let density = SampledDensity::new(Arc::clone(world), lattice, scene, true);
    let (world, planes) = (Arc::clone(world), PlaneCache::default());
    let colors = SampledColors { world, lattice, channels, planes };
    Shell {
        lattice,
        density: Grid::Values(Arc::new(density)),
        color: vec![Grid::Values(Arc::new(colors))],
    }
}
