//! One level's arrays and trilinear interpolation in them.

use crate::model::anisotropy::{ANISOTROPY, added_density};
use crate::model::baked::DensityDomain;
use crate::model::scene::{Activation, ActivationOrder};

/// A position's cell: its lowest node in the level's arrays, and the position in the cell.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cell {
    /// Number of the lowest node.
    pub node: usize,
    /// Place between the lowest node and the next along each axis, 0 to 1.
    pub fraction: [f32; 3],
}

/// Values of nodes, and the distances of neighbours along x and y (along z it is 1).
#[derive(Debug)]
pub struct Values<const C: usize> {
    /// None if the level has no density.
    pub density: Option<Vec<f32>>,
    /// Meaning of densities.
    pub domain: DensityDomain,
    /// Anisotropy of densities; empty if the level has none.
    pub anisotropy: Vec<[f32; ANISOTROPY]>,
    pub color: Vec<[f32; C]>,
    pub strides: [usize; 2],
}

/// The lowest node of a position's cell along one axis of `nodes`, and the position in the cell.
#[inline(always)]
pub fn split(position: f64, nodes: usize) -> (usize, f32) {
    let at = position * (nodes - 1) as f64;
    let low = (at as usize).min(nodes - 2);
    (low, (at - low as f64) as f32)
}

impl<const C: usize> Values<C> {
    #[inline(always)]
    fn corners(&self, node: usize) -> [usize; 4] {
        let [x, y] = self.strides;
        [node, node + y, node + x, node + x + y]
    }

    /// Interpolated density of a level with density, in a direction with the values `along` of
    /// anisotropy's functions.
    #[inline(always)]
    pub fn density(&self, cell: &Cell, along: &[f32; ANISOTROPY]) -> f32 {
        let density = self.mean_density(cell);
        if self.anisotropy.is_empty() {
            return density;
        }
        let anisotropy = self.interpolated(&self.anisotropy, cell);
        (density + added_density(&anisotropy, along)).max(0.0)
    }

    /// Interpolated density without anisotropy.
    #[inline(always)]
    fn mean_density(&self, cell: &Cell) -> f32 {
        let density = self.density.as_deref().unwrap_or_default();
        let [fx, fy, fz] = cell.fraction;
        let mut along_z = [0.0; 4];
        for (value, node) in along_z.iter_mut().zip(self.corners(cell.node)) {
            let pair = &density[node..node + 2];
            *value = pair[0] + (pair[1] - pair[0]) * fz;
        }
        let low = along_z[0] + (along_z[1] - along_z[0]) * fy;
        let high = along_z[2] + (along_z[3] - along_z[2]) * fy;
        low + (high - low) * fx
    }

    /// Interpolated colour.
    #[inline(always)]
    pub fn color(&self, cell: &Cell) -> [f32; C] {
        self.interpolated(&self.color, cell)
    }

    #[inline(always)]
    fn interpolated<const N: usize>(&self, values: &[[f32; N]], cell: &Cell) -> [f32; N] {
        let [fx, fy, fz] = cell.fraction;
        let weights = [(1.0 - fx) * (1.0 - fy), (1.0 - fx) * fy, fx * (1.0 - fy), fx * fy];
        let mut sum = [0.0; N];
        for (node, weight) in self.corners(cell.node).into_iter().zip(weights) {
            let pair = &values[node..node + 2];
            let (near, far) = (weight * (1.0 - fz), weight * fz);
            for lane in 0..N {
                sum[lane] += near * pair[0][lane] + far * pair[1][lane];
            }
        }
        sum
    }
}

/// Densities are clamped here without visible change, because differences of larger ones overflow.
const LARGEST_DENSITY: f32 = 1e30;

/// A node's density in its interpolated form.
pub fn interpolated_density(activation: &Activation, domain: DensityDomain, raw: f32) -> f32 {
    let raw = raw.clamp(-LARGEST_DENSITY, LARGEST_DENSITY);
    if domain != DensityDomain::Raw {
        return raw;
    }
    match activation.order {
        ActivationOrder::Raw => raw,
        ActivationOrder::Density => activation.density(raw.into()) as f32,
        ActivationOrder::Opacity => activation.opacity(raw.into()) as f32,
    }
}
