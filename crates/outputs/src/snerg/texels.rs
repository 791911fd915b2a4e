//! The texels of a block.

use super::grid::VoxelGrid;
use crate::view::render::{Directions, Renderer};
use mipvog_inputs::snerg::layout::FEATURES;

/// Voxel opacity above which a block is stored, as in SNeRG's exporter.
const KEPT_OPACITY: f64 = 0.005;
/// The least opacity that is not rounded to 0.
const LEAST_OPACITY: f64 = 0.5 / 255.0;

/// The source of texels.
pub(super) struct Texels<'a> {
    pub(super) field: &'a Renderer,
    pub(super) level: usize,
    pub(super) grid: &'a VoxelGrid,
    /// Directions for averaging colours, for a field without a network per ray.
    pub(super) directions: Option<&'a Directions>,
}

/// Texels of a block, x fastest, then y.
pub(super) struct BlockTexels {
    /// Colour times opacity, opacity.
    pub(super) rgba: Vec<[u8; 4]>,
    /// Features times opacity; empty without a network.
    pub(super) features: Vec<[u8; 4]>,
}

impl Texels<'_> {
    /// True if any texel of a block is visible.
    pub(super) fn keeps(&self, block: [usize; 3]) -> bool {
        if self.field.is_empty(self.grid.corners(block), self.level) {
            return false;
        }
        self.voxels(block).any(|voxel| self.opacity(voxel) >= KEPT_OPACITY)
    }

    /// The texels of a block.
    pub(super) fn of(&self, block: [usize; 3]) -> BlockTexels {
        let (mut rgba, mut features) = (Vec::new(), Vec::new());
        for voxel in self.voxels(block) {
            let opacity = self.opacity(voxel);
            let (mut color, mut specular) = ([0; 4], [0; 4]);
            if opacity >= LEAST_OPACITY {
                let byte = |value: f32| {
                    let value = f64::from(value).clamp(0.0, 1.0) * opacity;
                    (value * 255.0).round() as u8
                };
                let share = self.grid.share(voxel);
                let seen = match self.directions {
                    Some(directions) => self.field.mean_color(share, self.level, directions),
                    None => {
                        let sample = self.field.sample_at(share, self.level);
                        for (to, feature) in specular.iter_mut().zip(sample.features) {
                            *to = byte(feature);
                        }
                        sample.color
                    }
                };
                let [red, green, blue] = seen.map(byte);
                color = [red, green, blue, (opacity * 255.0).round() as u8];
            }
            rgba.push(color);
            if self.directions.is_none() {
                features.push(specular);
            }
        }
        BlockTexels { rgba, features }
    }

    /// The voxels of a block's texels, x fastest, then y.
    fn voxels(&self, block: [usize; 3]) -> impl Iterator<Item = [i64; 3]> {
        let ([x0, y0, z0], edge) = (self.grid.first(block), self.grid.edge() as i64);
        (z0..z0 + edge).flat_map(move |z| {
            (y0..y0 + edge).flat_map(move |y| (x0..x0 + edge).map(move |x| [x, y, z]))
        })
    }

    /// Opacity of one step of a voxel.
    fn opacity(&self, voxel: [i64; 3]) -> f64 {
        if !self.grid.contains(voxel) {
            return 0.0;
        }
        let density = self.field.density_at(self.grid.share(voxel), self.level);
        -libm::expm1(-f64::from(density) * self.grid.voxel)
    }
}

const _: () = assert!(FEATURES == 4, "features fill the four channels of a picture");
