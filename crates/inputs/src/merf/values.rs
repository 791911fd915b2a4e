//! Density and logits at nodes, plane by plane.

use std::sync::Arc;

use super::parameters::LOW;
use super::sums::{Assets, Sums, density};
use super::texel::DENSITY;
use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::folder::raw_density;
use crate::model::field::{EMPTY_LOGIT, NodeValues};
use crate::model::grid::Nodes;
use crate::network::{PlaneCache, visit};

/// Nodes beyond each face.
const BORDER: usize = 1;

impl Assets {
    fn nodes(&self) -> Nodes {
        self.parameters.cells().nodes()
    }
}

/// Sums at node `node`, if it may be occupied.
fn at_node(sums: &Sums, node: [usize; 3]) -> Option<[f64; 8]> {
    let (parameters, Nodes(counts)) = (&sums.parameters, sums.parameters.cells().nodes());
    let mut voxel = [0; 3];
    for (axis, (at, count)) in node.into_iter().zip(counts).enumerate() {
        let (own, flipped) = parameters.axes.of_world(axis);
        let at = if flipped { count - 1 - at } else { at };
        if let Some(voxel) = voxel.get_mut(own) {
            *voxel = parameters.resolution() / 4 + at - BORDER;
        }
    }
    if !sums.occupancy.is_near(voxel) {
        return None;
    }
    let edge = parameters.voxel_size();
    sums.at(voxel.map(|at| LOW + (at as f64 + 0.5) * edge), edge)
}

/// Raw densities, whose opacity is a voxel's.
#[derive(Debug)]
pub(super) struct DensityValues(pub(super) Arc<Assets>);

impl NodeValues for DensityValues {
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
        // The digests of pictures have the checksums of all values.
        hash(&[]);
        Ok(())
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.0.sums().map(drop)
    }

    fn read(&self, _: usize, x: usize, _: &[u64], out: &mut [f32]) -> Result<u64> {
        let sums = self.0.sums()?;
        let (Nodes([_, _, nz]), edge) = (self.nodes(), self.0.parameters.voxel_size());
        for (y, row) in out.chunks_exact_mut(nz).enumerate() {
            for (z, out) in row.iter_mut().enumerate() {
                *out = at_node(&sums, [x, y, z]).map_or(EMPTY_LOGIT, |values| {
                    let sum = values.get(DENSITY).copied().unwrap_or(0.0);
                    raw_density(-libm::expm1(-density(sum) * edge))
                });
            }
        }
        Ok(0)
    }
}

/// Logits of diffuse colours, then of features.
#[derive(Debug)]
pub(super) struct ColorValues {
    assets: Arc<Assets>,
    channels: usize,
    planes: PlaneCache,
}

impl ColorValues {
    pub(super) fn new(assets: Arc<Assets>, channels: usize) -> Self {
        Self { assets, channels, planes: PlaneCache::default() }
    }
}

impl NodeValues for ColorValues {
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
        hash(&[]);
        Ok(())
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.assets.sums().map(drop)
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let (plane, nodes, sums) = (out.len(), self.nodes(), self.assets.sums()?);
        let Nodes([_, _, nz]) = nodes;
        let channels = [channel, self.channels];
        self.planes.read(nodes, x, channels, region, out, |region, values| {
            visit(nodes, region, |[y, z]| {
                let [red, green, blue, _, features @ ..] =
                    at_node(&sums, [x, y, z]).unwrap_or_default();
                let found = [red, green, blue].into_iter().chain(features);
                let out = values.iter_mut().skip(y * nz + z).step_by(plane);
                #[expect(clippy::cast_possible_truncation, reason = "logits are float32")]
                out.zip(found).for_each(|(out, value)| *out = value as f32);
            });
            Ok(())
        })?;
        Ok(0)
    }
}
