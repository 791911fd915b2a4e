//! Opacity and colour at the nodes of one level.

use crate::base::error::Result;
use crate::base::parallel;
use crate::model::baked::{BakedLevel, DensityDomain, Group, Metadata};
use crate::model::field::FreeSpace;
use crate::model::grid::Bounds;
use crate::unpacked::fill_plane;

/// Opacity over the thickness of a surface above which a node is inside.
pub const INSIDE: f64 = 0.5;
/// The thickness of a surface is a cell of the grid, but at least this share of the box's longest
/// edge, so that density which becomes opaque only over several fine cells counts too.
const LEAST_THICKNESS: f64 = 1.0 / 64.0;

/// A grid of nodes with one layer of empty nodes around it, z fastest.
#[derive(Debug)]
pub struct OpacityGrid {
    /// Nodes along each axis, the layer around included.
    pub sizes: [usize; 3],
    /// World positions along each axis; the outer layer lies on the box's faces, so that no surface
    /// leaves the box.
    pub at: [Vec<f64>; 3],
    /// Opacity over the thickness of a surface.
    pub opacity: Vec<f64>,
    /// Diffuse colour, display-referred sRGB, and how much it counts.
    pub color: Vec<([f64; 3], f64)>,
    /// Mean edge of a cell, in world units.
    pub cell: f64,
    /// True if nodes of the level were averaged.
    pub averaged: bool,
}

impl OpacityGrid {
    /// The nodes of a level; means of several if there are more than `most` along an axis. Space
    /// more than a cell within `hollow` is empty, and not a cavity.
    pub fn of_level(
        metadata: &Metadata,
        level: usize,
        codes: &BakedLevel,
        free_space: Option<&FreeSpace>,
        hollow: Option<&Bounds>,
        max_nodes: usize,
    ) -> Result<Self> {
        let level_metadata = &metadata.levels[level];
        let nodes = level_metadata.dimensions;
        let spacing = level_metadata.grid().nodes.spacing(&metadata.bounds);
        let stride = nodes.map(|count| count.div_ceil(max_nodes));
        let inner: [usize; 3] = std::array::from_fn(|axis| nodes[axis].div_ceil(stride[axis]));
        let sizes = inner.map(|count| count + 2);
        let world = |axis: usize, node: usize| {
            f64::from(metadata.bounds.min[axis]) + node as f64 * spacing[axis]
        };
        let at: [Vec<f64>; 3] = std::array::from_fn(|axis| {
            let mean = |i: usize| {
                let first = i * stride[axis];
                let last = (first + stride[axis]).min(nodes[axis]) - 1;
                0.5 * (world(axis, first) + world(axis, last))
            };
            let ends = [metadata.bounds.min[axis], metadata.bounds.max[axis]].map(f64::from);
            [ends[0]].into_iter().chain((0..inner[axis]).map(mean)).chain([ends[1]]).collect()
        });
        let cell = (0..3).map(|axis| spacing[axis] * stride[axis] as f64).sum::<f64>() / 3.0;
        let longest = metadata.bounds.extent().into_iter().fold(0.0, f64::max);
        let thickness = cell.max(longest * LEAST_THICKNESS);
        let scale = thickness / metadata.march.interval_length();
        let domain = metadata.levels[level].density_domain();
        let node = NodeRules { metadata, domain, scale };
        let slabs = parallel::map(inner[0], |i| {
            let mut slab = vec![([0.0; 3], 0.0, 0usize); inner[1] * inner[2]];
            let plane = || vec![0.0f32; nodes[1] * nodes[2]];
            let (mut density, mut color) = (plane(), [plane(), plane(), plane()]);
            for x in i * stride[0]..((i + 1) * stride[0]).min(nodes[0]) {
                fill_plane(codes, level_metadata, Group::Density, 0, x, &mut density);
                for (channel, color) in color.iter_mut().enumerate() {
                    fill_plane(codes, level_metadata, Group::Diffuse, channel, x, color);
                }
                for (number, &raw) in density.iter().enumerate() {
                    let (y, z) = (number / nodes[2], number % nodes[2]);
                    let (sum, weight, count) = &mut slab[y / stride[1] * inner[2] + z / stride[2]];
                    *count += 1;
                    let opacity = node.opacity(raw);
                    let inside = || {
                        let position = [world(0, x), world(1, y), world(2, z)];
                        free_space.is_none_or(|mask| mask.contains(position))
                    };
                    if opacity > 0.0 && inside() {
                        for (sum, color) in sum.iter_mut().zip(&color) {
                            *sum += opacity * metadata.mean_color(color[number]);
                        }
                        *weight += opacity;
                    }
                }
            }
            Ok(slab)
        })?;
        let total = sizes.iter().product();
        let (mut opacity, mut color) = (vec![0.0; total], vec![([0.0; 3], 0.0); total]);
        for (x, slab) in slabs.iter().enumerate() {
            for (number, &(sum, weight, count)) in slab.iter().enumerate() {
                let (y, z) = (number / inner[2], number % inner[2]);
                let to = ((x + 1) * sizes[1] + y + 1) * sizes[2] + z + 1;
                opacity[to] = weight / count as f64;
                if weight > 0.0 {
                    color[to] = (sum.map(|channel| channel / weight), opacity[to]);
                }
            }
        }
        let averaged = stride != [1; 3];
        let mut grid = Self { sizes, at, opacity, color, cell, averaged };
        grid.fill_cavities(hollow.map_or_else(Vec::new, |hollow| grid.within(hollow)));
        Ok(grid)
    }

    /// Distances of neighbouring nodes along each axis.
    pub fn strides(&self) -> [usize; 3] {
        [self.sizes[1] * self.sizes[2], self.sizes[2], 1]
    }

    /// The nodes more than a cell within a box.
    fn within(&self, bounds: &Bounds) -> Vec<usize> {
        let inside = |axis: usize| {
            let ends = [bounds.min[axis], bounds.max[axis]].map(f64::from);
            let deep = move |at: f64| at > ends[0] + self.cell && at < ends[1] - self.cell;
            (0..self.sizes[axis]).filter(move |node| deep(self.at[axis][*node]))
        };
        let strides = self.strides();
        let rows = inside(0).flat_map(|x| inside(1).map(move |y| (x, y)));
        let node =
            |(x, y): (usize, usize)| inside(2).map(move |z| x * strides[0] + y * strides[1] + z);
        rows.flat_map(node).collect()
    }

    /// Makes enclosed empty nodes opaque: those that no path of empty nodes connects to the outer
    /// layer or to the nodes of `hollow`, which become empty.
    fn fill_cavities(&mut self, hollow: Vec<usize>) {
        let strides = self.strides();
        let mut reached = vec![false; self.opacity.len()];
        let mut next = hollow;
        next.iter().for_each(|node| self.opacity[*node] = 0.0);
        next.push(0);
        next.iter().for_each(|node| reached[*node] = true);
        while let Some(node) = next.pop() {
            for (stride, size) in strides.into_iter().zip(self.sizes) {
                let along = node / stride % size;
                let below = (along > 0).then(|| node - stride);
                let above = (along + 1 < size).then(|| node + stride);
                for other in [below, above].into_iter().flatten() {
                    if !reached[other] && self.opacity[other] < INSIDE {
                        reached[other] = true;
                        next.push(other);
                    }
                }
            }
        }
        for (opacity, reached) in self.opacity.iter_mut().zip(reached) {
            if !reached && *opacity < INSIDE {
                *opacity = 1.0;
            }
        }
    }
}

struct NodeRules<'a> {
    metadata: &'a Metadata,
    domain: DensityDomain,
    /// Thickness of a surface in intervals.
    scale: f64,
}

impl NodeRules<'_> {
    /// Opacity over a surface's thickness of a stored density (`formats/mipvog.md`, section 6); 0
    /// where it is below visibility.
    fn opacity(&self, stored: f32) -> f64 {
        let activation = &self.metadata.activation;
        if stored <= self.domain.invisible(activation) {
            return 0.0;
        }
        let value = f64::from(stored);
        let depth = match self.domain {
            DensityDomain::SqrtOpticalDepth => value * value,
            DensityDomain::Opacity => -libm::log1p(-value.min(1.0 - f64::from(f32::EPSILON))),
            DensityDomain::Raw => activation.density(value) * f64::from(activation.interval),
        };
        -libm::expm1(-depth * self.scale)
    }
}
