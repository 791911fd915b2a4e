//! Nodes above each level's opacity threshold, found as density streams by.
//!
//! If logits are averaged, one pass over all density makes every level. If alpha is averaged, a
//! first pass over all density finds the opaque nodes of level 0 and the nodes that are not empty;
//! a second pass reads only the latter and makes the coarser levels.

use std::sync::{Mutex, PoisonError};

use super::pyramid::SLAB;
use super::{
    AlphaDomain, Content, Direction, FieldPass, LevelFilter, Light, OpticalDepthGrid, Plane,
    PlaneSink, PlaneSource, Pyramid, RequiredNodes, Verify, Visibility,
};
use crate::base::error::Result;
use crate::base::lock::lock;
use crate::base::progress::{Progress, Step};
use crate::model::field::{NonfiniteCount, Planes, Scene};
use crate::model::grid::{Bounds, NodeMask, Nodes, row};

/// Planes of a slab if only level 0 is read.
const READ_SLAB: usize = 16;

/// The opacity of a field's levels.
#[derive(Debug)]
pub struct Opacity {
    /// Nodes of each level above its threshold, finest first.
    pub opaque: Vec<NodeMask>,
    /// Nodes of level 0 whose alpha is not 0, if alpha is averaged.
    pub occupied: Option<NodeMask>,
    /// Visibility, if alpha is averaged and there are coarser levels.
    pub visibility: Option<Visibility>,
    /// Values of density that were replaced.
    pub nonfinite: NonfiniteCount,
    /// CRC-32 of each plane of density.
    pub checksums: Vec<u32>,
    /// Bytes that were read, in all passes.
    pub bytes_read: u64,
}

/// A search for the opaque nodes of all levels.
pub struct OpacitySearch<'a> {
    /// The field.
    pub planes: &'a Planes<'a>,
    /// Sizes of the levels that have density, finest first.
    pub sizes: &'a [Nodes],
    /// Filter of coarser levels.
    pub filter: &'a dyn LevelFilter,
    /// Directional terms of coarser levels.
    pub direction: Option<Direction>,
    /// The light that visibility is measured with.
    pub light: Light,
    /// The threshold as raw density at level 0, and as alpha at coarser levels if alpha is
    /// averaged.
    pub thresholds: Vec<f32>,
}

impl OpacitySearch<'_> {
    /// Passes over density: progress counts this many times the planes of level 0.
    pub fn passes(&self) -> usize {
        let coarser = self.domain().filter(|_| self.sizes.len() > 1);
        if coarser.is_some() { 2 } else { 1 }
    }

    fn domain(&self) -> Option<AlphaDomain> {
        self.filter.alpha(&self.planes.field().scene.activation)
    }

    /// Reads density and makes its levels.
    ///
    /// # Errors
    ///
    /// Errors of reading, a wrong checksum of density, and
    /// [`crate::base::error::ErrorKind::Cancelled`].
    pub fn run(&self, progress: &dyn Progress) -> Result<Opacity> {
        let (domain, weights) = (self.domain(), self.filter.weights());
        let extent = extent_in_intervals(&self.planes.field().scene);
        let bent = self.direction.is_some_and(|direction| direction.moments.is_some());
        let depths = domain.filter(|_| self.sizes.len() > 1).map(|domain| {
            let grid = OpticalDepthGrid::new(domain, self.sizes, extent);
            grid.with_bent_normals(bent).with_light(self.light)
        });
        let occupied = domain.map(|domain| (domain.empty_up_to(), self.empty_mask(0)));
        let mut bits = OpacityBits {
            sizes: self.sizes,
            thresholds: &self.thresholds,
            first_level: 0,
            opaque: (0..self.sizes.len()).map(|level| self.empty_mask(level)).collect(),
            occupied,
            depths: depths.as_ref(),
        };
        // Alpha is filtered in a separate pass.
        let sizes = if domain.is_some() { &self.sizes[..1] } else { self.sizes };
        let all = sizes.iter().map(|&nodes| NodeMask::full(nodes)).collect();
        let required = RequiredNodes::new(all, None, &weights)?;
        let slab = if sizes.len() > 1 { SLAB } else { READ_SLAB };
        let pass = FieldPass::new(self.planes, Verify::Density);
        self.stream(&pass, &required, Content::Logits(0..1), slab, &bits, progress)?;
        let summary = pass.finish()?;
        let mut bytes_read = summary.bytes;
        let mut occupied = bits.occupied.take().map(|(_, mask)| into_mask(mask));
        if let Some(domain) = domain.filter(|_| depths.is_some()) {
            let not_empty = occupied.take().unwrap_or_else(|| NodeMask::empty(self.sizes[0]));
            let required = RequiredNodes::of_occupied(not_empty, self.sizes, &weights)?;
            bits.first_level = 1;
            let pass = FieldPass::new(self.planes, Verify::Nothing);
            self.stream(&pass, &required, Content::Alpha(domain), SLAB, &bits, progress)?;
            bytes_read += pass.finish()?.bytes;
            occupied = required.into_finest();
        }
        let opaque = std::mem::take(&mut bits.opaque).into_iter().map(into_mask).collect();
        Ok(Opacity {
            opaque,
            occupied,
            visibility: depths.map(OpticalDepthGrid::visibility).transpose()?,
            nonfinite: summary.nonfinite_density,
            checksums: summary.density_checksums,
            bytes_read,
        })
    }

    fn stream(
        &self,
        pass: &FieldPass,
        required: &RequiredNodes,
        content: Content,
        slab: usize,
        bits: &OpacityBits,
        progress: &dyn Progress,
    ) -> Result<()> {
        let source = &Density(pass);
        Pyramid { source, required, content, slab, pipelined: true }.run(
            bits,
            Step::Prune,
            progress,
        )
    }

    fn empty_mask(&self, level: usize) -> Mutex<NodeMask> {
        Mutex::new(NodeMask::empty(self.sizes[level]))
    }
}

/// A field of which density alone is read.
struct Density<'a>(&'a FieldPass<'a>);

impl PlaneSource for Density<'_> {
    fn channels(&self) -> usize {
        1
    }

    fn read(&self, channel: usize, x: usize, required: &[u64], values: &mut [f32]) -> Result<()> {
        self.0.read(channel, x, required, values)
    }
}

/// Bits of nodes above thresholds.
struct OpacityBits<'a> {
    sizes: &'a [Nodes],
    thresholds: &'a [f32],
    /// Finer levels are known already.
    first_level: usize,
    opaque: Vec<Mutex<NodeMask>>,
    /// Nodes of level 0 above a raw density.
    occupied: Option<(f32, Mutex<NodeMask>)>,
    depths: Option<&'a OpticalDepthGrid>,
}

impl PlaneSink for OpacityBits<'_> {
    fn plane(&self, Plane { level, x, values, .. }: Plane) -> Result<()> {
        if level < self.first_level {
            return Ok(());
        }
        let nodes = self.sizes[level];
        mark_above(&self.opaque[level], nodes, x, values, self.thresholds[level]);
        if let Some((empty_up_to, occupied)) = self.occupied.as_ref().filter(|_| level == 0) {
            mark_above(occupied, nodes, x, values, *empty_up_to);
        }
        if let Some(depths) = self.depths {
            depths.take(level, x, values);
        }
        Ok(())
    }
}

/// Marks the nodes of a plane that are above the threshold.
fn mark_above(mask: &Mutex<NodeMask>, nodes: Nodes, x: usize, values: &[f32], threshold: f32) {
    let (nz, words) = (nodes.0[2], row::words(nodes));
    let mut rows = vec![0; nodes.0[1] * words];
    for (values, row) in values.chunks_exact(nz).zip(rows.chunks_exact_mut(words)) {
        row::pack_above(values, threshold, row);
    }
    lock(mask).plane_mut(x).copy_from_slice(&rows);
}

fn into_mask(mask: Mutex<NodeMask>) -> NodeMask {
    mask.into_inner().unwrap_or_else(PoisonError::into_inner)
}

/// Lengths of the box's edges in intervals.
fn extent_in_intervals(scene: &Scene) -> [f64; 3] {
    let Scene { bounds: Bounds { min, max }, march, .. } = scene;
    let step = march.interval_length();
    [0, 1, 2].map(|axis| (f64::from(max[axis]) - f64::from(min[axis])) / step)
}
