//! Densities of a model at the nodes of a box.

use std::sync::Arc;

use super::cell::points;
use super::world::World;
use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::model::activate;
use crate::model::field::{Lattice, NodeValues, Scene};
use crate::model::grid::Nodes;
use crate::network::visit;

/// Positions that a model is asked for at once, about.
const AT_ONCE: usize = 512;
/// Optical depth between two nodes behind which nothing is seen.
const OPAQUE: f64 = 60.0;

/// Raw densities at the nodes of a box, plane by plane.
#[derive(Debug)]
pub struct SampledDensity<W> {
    world: Arc<W>,
    lattice: Lattice,
    /// What a raw density means.
    raw: RawDensity,
    /// True for 0 where the model takes no samples; else a mask says so.
    masked: bool,
}

/// Optical depths per world unit as raw densities of a softplus.
#[derive(Debug, Clone, Copy)]
struct RawDensity {
    shift: f64,
    /// Softplus of a raw density for an optical depth of 1 per world unit.
    per_unit: f64,
    /// Optical depths per world unit are cut off here.
    densest: f64,
    empty: f32,
}

impl RawDensity {
    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn of(self, density: f64) -> f32 {
        let raw = activate::inverse_softplus(density.min(self.densest) * self.per_unit);
        (raw - self.shift).max(self.empty.into()) as f32
    }
}

impl<W: World> SampledDensity<W> {
    /// Of the nodes of `lattice`, as raw densities of a scene with this activation and these steps.
    pub fn new(world: Arc<W>, lattice: Lattice, scene: &Scene, masked: bool) -> Self {
        let activation = &scene.activation;
        let spacing = lattice.nodes.spacing(&lattice.bounds).into_iter().fold(0.0, f64::max);
        let raw = RawDensity {
            shift: f64::from(activation.shift),
            per_unit: scene.march.interval_length() / f64::from(activation.interval),
            densest: OPAQUE / spacing,
            empty: activation.empty_raw(),
        };
        Self { world, lattice, raw, masked }
    }
}

impl<W: World> NodeValues for SampledDensity<W> {
    fn nodes(&self) -> Nodes {
        self.lattice.nodes
    }

    fn channels(&self) -> usize {
        1
    }

    fn memory_bytes(&self) -> u64 {
        self.world.memory_bytes()
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.world.digest(hash)
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.world.load().map(drop)
    }

    fn read(&self, _: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let loaded = self.world.load()?;
        let Nodes([_, _, nz]) = self.lattice.nodes;
        let (mut positions, mut densities) = (Vec::new(), Vec::new());
        // Places of nodes in the plane, and how many positions each has.
        let mut nodes: Vec<(usize, usize)> = Vec::new();
        let mut find = |positions: &mut Vec<[f64; 3]>, nodes: &mut Vec<(usize, usize)>| {
            densities.clear();
            self.world.densities(&loaded, positions, self.masked, &mut densities);
            let mut left = densities.as_slice();
            for (at, count) in nodes.drain(..) {
                let (own, rest) = left.split_at(count.min(left.len()));
                left = rest;
                if let Some(out) = out.get_mut(at) {
                    *out = self.raw.of(own.iter().sum::<f64>() / count as f64);
                }
            }
            positions.clear();
        };
        visit(self.lattice.nodes, region, |[y, z]| {
            let own = points(&*self.world, &self.lattice, [x, y, z], false);
            nodes.push((y * nz + z, own.len()));
            positions.extend(own);
            if positions.len() >= AT_ONCE {
                find(&mut positions, &mut nodes);
            }
        });
        find(&mut positions, &mut nodes);
        Ok(0)
    }
}
