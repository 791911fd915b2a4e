//! Density and colours at nodes, plane by plane.

use std::sync::Arc;

use super::evaluate::Ngp;
use super::file::NgpFile;
use super::frame::Frame;
use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::model::field::{Activation, EMPTY_LOGIT, NodeValues};
use crate::model::grid::Nodes;
use crate::network::{NodeColors, OnNode, visit};
use crate::packets::{Directions, FieldScratch, LANES, Places};

/// Optical depth of an opaque voxel.
const OPAQUE: f64 = 60.0;

/// Nodes at which a model is evaluated: `side` along each axis of its cube.
#[derive(Debug, Clone)]
pub(super) struct Samples {
    pub(super) file: Arc<NgpFile>,
    pub(super) side: usize,
}

impl Samples {
    /// Edges of the unit cube between two nodes.
    fn spacing(&self) -> f64 {
        1.0 / (self.side - 1) as f64
    }

    /// Calls `on_nodes` with up to [`LANES`] nodes of a region at a time, and their positions.
    /// Nodes that touch no occupied cell are skipped.
    fn for_each(
        &self,
        x: usize,
        region: &[u64],
        mut on_nodes: impl FnMut(&[[usize; 2]], &[[f64; 3]]),
    ) {
        let (mut nodes, mut positions) = (Vec::new(), Vec::new());
        let spacing = self.spacing();
        let mut found = |nodes: &mut Vec<[usize; 2]>, positions: &mut Vec<[f64; 3]>| {
            on_nodes(nodes, positions);
            nodes.clear();
            positions.clear();
        };
        visit(Nodes([self.side; 3]), region, |[y, z]| {
            let at = Frame::turned([x, y, z].map(|at| at as f64 * spacing));
            if !self.file.occupancy.touches(at, spacing) {
                return;
            }
            nodes.push([y, z]);
            positions.push(at);
            if nodes.len() == LANES {
                found(&mut nodes, &mut positions);
            }
        });
        if !nodes.is_empty() {
            found(&mut nodes, &mut positions);
        }
    }
}

/// Raw densities: logits of the optical depth of a voxel.
#[derive(Debug)]
pub(super) struct DensityValues(pub(super) Samples);

impl NodeValues for DensityValues {
    fn nodes(&self) -> Nodes {
        Nodes([self.0.side; 3])
    }

    fn channels(&self) -> usize {
        1
    }

    fn memory_bytes(&self) -> u64 {
        self.0.file.memory_bytes()
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.0.file.digest(hash)
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.0.file.load().map(drop)
    }

    fn read(&self, _: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let model = self.0.file.load()?;
        out.fill(EMPTY_LOGIT);
        let activation = Activation::logits(0.0, 1.0);
        let spacing = self.0.spacing();
        let (mut scratch, mut densities) = (FieldScratch::<f32>::default(), Vec::new());
        self.0.for_each(x, region, |nodes, positions| {
            densities.clear();
            model.densities(positions, &mut scratch, &mut densities);
            for (&[y, z], density) in nodes.iter().zip(&densities) {
                if let Some(out) = out.get_mut(y * self.0.side + z) {
                    *out = activation.stored_raw((density * spacing).min(OPAQUE));
                }
            }
        });
        Ok(0)
    }
}

impl NodeColors for Samples {
    type Network = Ngp;
    type Along = Directions<f32>;

    fn nodes(&self) -> Nodes {
        Nodes([self.side; 3])
    }

    fn memory_bytes(&self, _: usize) -> [u64; 2] {
        // The digest of density covers the model.
        [0; 2]
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.file.digest(hash)
    }

    fn load(&self, _: &dyn Progress) -> Result<Arc<Ngp>> {
        self.file.load()
    }

    fn along(&self, model: &Ngp, directions: &[[f64; 3]]) -> Self::Along {
        model.along(directions)
    }

    fn visit(
        &self,
        model: &Ngp,
        x: usize,
        region: &[u64],
        on_node: OnNode<'_, Self::Along>,
    ) -> Result<()> {
        let (mut scratch, mut places) = (FieldScratch::default(), Places::default());
        self.for_each(x, region, |nodes, positions| {
            model.places(positions, &mut scratch, &mut places);
            for (lane, &node) in nodes.iter().enumerate() {
                on_node(node, &mut |along, colors| {
                    model.field.colors_along(along, &places, lane, &mut scratch, colors);
                });
            }
        });
        Ok(())
    }
}
