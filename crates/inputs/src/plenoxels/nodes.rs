//! Values at the nodes of the boxes of a model with background spheres.

use std::sync::Arc;

use super::world::{Whole, WholeFile};
use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::model::field::{Grid, Lattice, NodeValues, Scene, Shell};
use crate::model::grid::Nodes;
use crate::nested::{SampledDensity, World, points};
use crate::network::{PlaneCache, visit};
use crate::sparse::RowGrid;

/// The model's own values in its box, and the background in the box's corners.
#[derive(Debug)]
struct OwnBox {
    world: Arc<WholeFile>,
    lattice: Lattice,
    /// Nodes beyond each face of the cells.
    border: usize,
    density: RowGrid,
    /// None for densities.
    color: Option<RowGrid>,
    planes: PlaneCache,
}

impl OwnBox {
    fn of(
        world: &Arc<WholeFile>,
        (lattice, border): (Lattice, usize),
        density: RowGrid,
        color: Option<RowGrid>,
    ) -> Grid {
        let (world, planes) = (Arc::clone(world), PlaneCache::default());
        Grid::Values(Arc::new(Self { world, lattice, border, density, color, planes }))
    }

    /// Radius in half edges from which nodes include the background: the corners of cells that the
    /// unit sphere crosses.
    fn rim(&self) -> f64 {
        let Nodes(counts) = self.world.arrays.cells.cells;
        let cells = counts.into_iter().map(|count| 2.0 / count as f64);
        1.0 - cells.map(|cell| cell * cell).sum::<f64>().sqrt()
    }

    /// Mixes the background into the model's own values of a plane.
    fn mix(&self, whole: &Whole, x: usize, region: &[u64], values: &mut [f32]) -> Result<()> {
        let nodes = self.lattice.nodes;
        let Nodes([_, ny, nz]) = nodes;
        let mut densities = vec![0.0; ny * nz];
        self.density.read(0, x, region, &mut densities)?;
        for (channel, out) in values.chunks_exact_mut(ny * nz).enumerate() {
            match &self.color {
                Some(color) => color.read(channel, x, region, out).map(drop)?,
                None => out.copy_from_slice(&densities),
            }
        }
        let rim = self.rim();
        let mut channels = vec![0.0; self.channels()];
        visit(nodes, region, |[y, z]| {
            let node = [x, y, z];
            let (radius, behind) =
                self.world.background(self.world.spheres(whole), self.lattice.position(node));
            if radius < rim {
                return;
            }
            let is_border = node
                .into_iter()
                .zip(nodes.0)
                .any(|(at, count)| at < self.border || at + self.border >= count);
            let raw = match densities.get(y * nz + z) {
                Some(raw) if !is_border => f64::from(*raw),
                _ => 0.0,
            };
            let own = raw.max(0.0);
            let sum = own + behind.density;
            let out = values.iter_mut().skip(y * nz + z).step_by(ny * nz);
            if self.color.is_none() {
                #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
                out.for_each(|out| *out = sum as f32);
                return;
            }
            // An empty row still affects the cells around its node.
            let share = if sum > 0.0 { own / sum } else { f64::from(u8::from(raw != 0.0)) };
            self.world.put(behind.coefficients, &mut channels);
            #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
            out.zip(&channels).for_each(|(out, behind)| {
                *out = (behind + share * (f64::from(*out) - behind)) as f32;
            });
        });
        Ok(())
    }
}

impl NodeValues for OwnBox {
    fn nodes(&self) -> Nodes {
        self.lattice.nodes
    }

    fn channels(&self) -> usize {
        self.color.as_ref().map_or(1, NodeValues::channels)
    }

    fn memory_bytes(&self) -> u64 {
        let own = self.color.as_ref().map_or(0, NodeValues::memory_bytes);
        self.planes.bytes(self.nodes(), self.channels()) + self.density.memory_bytes() + own
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.color.as_ref().unwrap_or(&self.density).digest(hash)?;
        self.world.digest(hash)
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.world.load().map(drop)
    }

    fn release(&self) {
        self.density.release();
        self.color.iter().for_each(NodeValues::release);
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let whole = self.world.load()?;
        let asked = [channel, self.channels()];
        self.planes.read(self.nodes(), x, asked, region, out, |region, values| {
            self.mix(&whole, x, region, values)
        })?;
        Ok(0)
    }
}

/// Channels of colour at the nodes of a box that is sampled.
#[derive(Debug)]
struct SampledColors {
    world: Arc<WholeFile>,
    lattice: Lattice,
    planes: PlaneCache,
}

impl SampledColors {
    /// Means weighted by the light that points of a node's cell absorb.
    fn at_node(&self, whole: &Whole, node: [usize; 3], means: &mut [f64], own: &mut [f64]) {
        let points = points(&*self.world, &self.lattice, node, false);
        let spacing = self.lattice.nodes.spacing(&self.lattice.bounds);
        let edge = spacing.into_iter().fold(0.0, f64::max) / libm::cbrt(points.len() as f64);
        let mut all = 0.0;
        means.fill(0.0);
        for point in &points {
            let density = self.world.shown(whole, *point, own);
            let share = -libm::expm1(-density * edge);
            all += share;
            means.iter_mut().zip(&*own).for_each(|(mean, own)| *mean += share * own);
        }
        if all > 0.0 {
            means.iter_mut().for_each(|mean| *mean /= all);
        } else {
            // The node is empty, but its colour counts between it and its neighbours.
            self.world.shown(whole, self.lattice.position(node), means);
        }
    }
}

impl NodeValues for SampledColors {
    fn nodes(&self) -> Nodes {
        self.lattice.nodes
    }

    fn channels(&self) -> usize {
        self.world.channels()
    }

    fn memory_bytes(&self) -> u64 {
        self.planes.bytes(self.nodes(), self.channels())
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.world.digest(hash)
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.world.load().map(drop)
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let (plane, nodes, whole) = (out.len(), self.nodes(), self.world.load()?);
        let Nodes([_, _, nz]) = nodes;
        let channels = self.channels();
        let (mut means, mut own) = (vec![0.0; channels], vec![0.0; channels]);
        self.planes.read(nodes, x, [channel, channels], region, out, |region, values| {
            visit(nodes, region, |[y, z]| {
                self.at_node(&whole, [x, y, z], &mut means, &mut own);
                let out = values.iter_mut().skip(y * nz + z).step_by(plane);
                #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
                out.zip(&means).for_each(|(out, value)| *out = *value as f32);
            });
            Ok(())
        })?;
        Ok(0)
    }
}

/// The values of the model's own box, of its rows.
pub(super) fn own_box(
    world: &Arc<WholeFile>,
    (lattice, border): (Lattice, usize),
    rows: impl Fn() -> [RowGrid; 2],
) -> Shell {
    let ([density, _], [of_colors, color]) = (rows(), rows());
    Shell {
        lattice,
        density: OwnBox::of(world, (lattice, border), density, None),
        color: vec![OwnBox::of(world, (lattice, border), of_colors, Some(color))],
    }
}

/// The values of a box that is sampled.
pub(super) fn sampled_box(world: &Arc<WholeFile>, lattice: Lattice, scene: &Scene) -> Shell {
    let density = SampledDensity::new(Arc::clone(world), lattice, scene, true);
    let (world, planes) = (Arc::clone(world), PlaneCache::default());
    Shell {
        lattice,
        density: Grid::Values(Arc::new(density)),
        color: vec![Grid::Values(Arc::new(SampledColors { world, lattice, planes }))],
    }
}
