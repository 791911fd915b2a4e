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
        let mut densities = Vec::new();
        visit(self.lattice.nodes, region, |[y, z]| {
            let points = points(&*self.world, &self.lattice, [x, y, z], false);
            densities.clear();
            self.world.densities(&loaded, &points, self.masked, &mut densities);
            let mean = densities.iter().sum::<f64>() / points.len() as f64;
            if let Some(out) = out.get_mut(y * nz + z) {
                *out = self.raw.of(mean);
            }
        });
        Ok(0)
    }
}
