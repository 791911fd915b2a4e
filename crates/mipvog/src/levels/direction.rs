//! Directional terms of coarser levels.
//!
//! A coarse node stands for many fine ones, which hide each other. Levels that average alpha get
//! anisotropy ([`super::anisotropy`]) from the gradient of their alpha, and directional brightness
//! ([`super::brightness`]) from the sides on which bright and dark nodes lie. Neither casts rays.

use std::ops::Range;
use std::sync::Arc;

use super::anisotropy::{RowsAround, StructureTensor};
use super::brightness::{MOMENTS, Sums, along_axis};
use super::filter::LevelFilter;
use super::plane::PlanePool;
use super::sizes::level_sizes;
use super::{FilterDomain, OpticalDepthGrid};
use crate::model::anisotropy::ANISOTROPY;
use crate::model::baked::DensityDomain;
use crate::model::directional::{DIRECTIONAL, MOST_CHANNELS};
use crate::model::field::{ColorDomain, RadianceField};
use crate::model::grid::{Bounds, Nodes, row};

/// The direction-dependent values of coarser levels, beside density and colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// Lengths of the box's edges.
    extent: [f32; 3],
    /// The level whose nodes give the moments of brightness. Levels coarser than it have
    /// directional brightness; all coarser levels have anisotropy.
    pub moments: Option<usize>,
}

impl Direction {
    /// Over a box whose edges have these lengths.
    pub fn new(extent: [f32; 3], moments: Option<usize>) -> Self {
        Self { extent, moments }
    }

    /// For the levels that `filter` makes from `field`; none if they look the same from all sides.
    /// Directional brightness is added to logits, so other colours have none.
    pub fn of(filter: &dyn LevelFilter, field: &RadianceField) -> Option<Self> {
        let stored = match filter.domain() {
            FilterDomain::Alpha { stored, .. } => stored,
            FilterDomain::Logits { .. } => return None,
        };
        let is_directional = filter.is_directional() && stored == DensityDomain::SqrtOpticalDepth;
        let Bounds { min, max } = field.scene.bounds;
        let has_room = field.color_channels() + DIRECTIONAL <= MOST_CHANNELS;
        let is_logit = field.color_domain == ColorDomain::Logit && field.harmonics().is_none();
        let extent = std::array::from_fn(|axis| max[axis] - min[axis]);
        // Bent normals are interpolated from the level on which light is traced. On levels more
        // than twice as fine, they hardly differ between nodes.
        let sizes = level_sizes(field.scene.nodes, usize::MAX);
        let moments = OpticalDepthGrid::level(&sizes).saturating_sub(1);
        let moments = (has_room && is_logit).then_some(moments);
        is_directional.then(|| Self::new(extent, moments))
    }

    /// True if `level` has directional brightness.
    pub fn has_brightness(&self, level: usize) -> bool {
        self.moments.is_some_and(|moments| level > moments)
    }

    /// Channels of a coarser level: brightness, then anisotropy.
    pub fn channels(&self, level: usize) -> usize {
        ANISOTROPY + if self.has_brightness(level) { DIRECTIONAL } else { 0 }
    }

    /// The mean node distance divided by the node distance along each axis.
    pub(super) fn gradient_scale(&self, Nodes(nodes): Nodes) -> [f32; 3] {
        let spacing = [0, 1, 2].map(|axis| self.extent[axis] / (nodes[axis] - 1) as f32);
        let mean = (spacing[0] + spacing[1] + spacing[2]) / 3.0;
        spacing.map(|spacing| mean / spacing)
    }
}

/// The further channels of one plane, as they are made.
pub(super) struct DirectionPlane {
    tensor: StructureTensor,
    /// By axis; none if levels have no directional brightness.
    brightness: Option<[Vec<f32>; DIRECTIONAL]>,
    anisotropy: [Vec<f32>; ANISOTROPY],
}

impl DirectionPlane {
    /// A plane of `level`, with `nodes`, from planes of `pool`.
    pub fn new(direction: Direction, level: usize, nodes: Nodes, pool: &PlanePool) -> Self {
        let Nodes([_, ny, nz]) = nodes;
        // Anisotropy could make a hidden node visible.
        let anisotropy = [(); ANISOTROPY].map(|()| {
            let mut plane = pool.take(ny * nz);
            plane.fill(0.0);
            plane
        });
        let brightness =
            direction.has_brightness(level).then(|| [(); DIRECTIONAL].map(|()| pool.take(ny * nz)));
        let tensor = StructureTensor::new(direction.gradient_scale(nodes), nz);
        Self { tensor, brightness, anisotropy }
    }

    /// Makes the directional brightness of the nodes `span` of a plane with the premultiplied
    /// channels `own`, of which moments are the last. Colours have these `means`.
    pub fn fill_brightness(&mut self, own: &[Arc<Vec<f32>>], span: Range<usize>, means: &[f32]) {
        let Some(brightness) = &mut self.brightness else { return };
        let moment = |number: usize| &own[own.len() - MOMENTS + number][span.clone()];
        for (axis, brightness) in brightness.iter_mut().enumerate() {
            let sums = Sums {
                alpha: &own[0][span.clone()],
                visible: &own[1][span.clone()],
                bent: moment(axis),
                bright: moment(DIRECTIONAL + axis),
            };
            along_axis(&sums, means, &mut brightness[span.clone()]);
        }
    }

    /// Makes the anisotropy of the nodes `start..end` of a row, which are the nodes `span` of the
    /// plane, where the bits of `retained` are set.
    pub fn fill_anisotropy(
        &mut self,
        rows: &RowsAround,
        span: Range<usize>,
        (start, end): (usize, usize),
        density: &[f32],
        retained: &[u64],
    ) {
        let values = self.anisotropy.each_mut().map(|plane| &mut plane[span.clone()]);
        self.tensor.anisotropy(rows, (start, end), density, values);
        for (gap, after) in row::gaps_between(retained, start, end) {
            for plane in &mut self.anisotropy {
                plane[span.start - start + gap..span.start - start + after].fill(0.0);
            }
        }
    }

    /// The channels, those of brightness first.
    pub fn into_planes(self) -> impl Iterator<Item = Vec<f32>> {
        self.brightness.into_iter().flatten().chain(self.anisotropy)
    }
}
