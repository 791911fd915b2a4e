//! Samples of a ray that are interpolated, activated and composited together, so that the compiler
//! turns the arithmetic of all of them into vector instructions.

use multiversion::multiversion;

use super::march::Gathered;
use super::path::Path;
use super::view::View;
use crate::activate::lanes;
use crate::field::{Activation, ActivationOrder};
use crate::sample::{Cell, Sample};

/// Samples of a packet: a cache line of f32, and about what a ray sees before it ends.
const PACKET: usize = 16;

/// Samples of one ray at one level, each blended with the next coarser one.
pub struct Packet {
    /// The finer of the levels that the samples blend.
    level: usize,
    count: usize,
    k: [f64; PACKET],
    /// Share of the next coarser level.
    blend: [f32; PACKET],
}

/// Where a packet's samples lie and what their densities are.
struct Located {
    cells: [[Option<Cell>; 2]; PACKET],
    density: [f32; PACKET],
}

impl Packet {
    /// Without samples.
    pub fn empty() -> Self {
        Self { level: 0, count: 0, k: [0.0; PACKET], blend: [0.0; PACKET] }
    }

    /// Whether a sample at `level` has to wait until the packet is shaded.
    #[inline(always)]
    pub fn refuses(&self, level: usize) -> bool {
        self.count == PACKET || (self.level != level && self.count > 0)
    }

    /// Adds sample `k`, of a level of detail from `level` to the next.
    #[inline(always)]
    pub fn push(&mut self, k: f64, level: usize, blend: f32) {
        self.level = level;
        self.k[self.count] = k;
        self.blend[self.count] = blend;
        self.count += 1;
    }

    /// Interpolates, activates, composites and empties the packet. `depth` is the optical depth
    /// before it, and then behind it.
    pub fn shade<const C: usize>(
        &mut self,
        view: &View,
        field: &impl Sample<C>,
        path: &Path,
        depth: &mut f32,
        gathered: &mut Gathered<C>,
    ) {
        if self.count == 0 {
            return;
        }
        let located = self.locate(field, path);
        let count = std::mem::take(&mut self.count);
        gathered.samples += count as u32;
        let shaded =
            composite(&located.density, &view.activation, view.march.alpha_threshold, *depth);
        for i in 0..count {
            let weight = shaded.weight[i];
            if weight == 0.0 {
                continue;
            }
            gathered.distance += weight * path.distance(self.k[i]) as f32;
            gathered.level += weight * (self.level as f32 + self.blend[i]);
            if weight > view.march.color_threshold {
                let color = self.color(field, &located.cells[i], self.blend[i]);
                for (sum, raw) in gathered.color.iter_mut().zip(color) {
                    *sum += weight * lanes::sigmoid(raw);
                }
            }
        }
        // Lanes without a sample are empty and add nothing.
        *depth = shaded.depth;
    }

    /// Finds the samples' cells and interpolates their densities.
    #[inline(always)]
    fn locate<const C: usize>(&self, field: &impl Sample<C>, path: &Path) -> Located {
        let level = self.level;
        let mut located = Located {
            cells: [[None; 2]; PACKET],
            // Where nothing is stored nothing is seen.
            density: [f32::NEG_INFINITY; PACKET],
        };
        // A level without density has level 0's.
        let owner = |level: usize| if field.density_level(level) { level } else { 0 };
        let (own, next) = (owner(level), owner(level + 1));
        for i in 0..self.count {
            let position = path.position(self.k[i]);
            let fine = field.locate(level, position);
            let coarse = match self.blend[i] > 0.0 {
                true => field.locate(level + 1, position),
                false => None,
            };
            located.cells[i] = [fine, coarse];
            let density = |owner: usize, at: usize, cell: Option<Cell>| {
                let cell = if owner == at { cell } else { field.locate(owner, position) };
                cell.map(|cell| field.density(owner, &cell))
            };
            let low = density(own, level, fine);
            let blends = self.blend[i] > 0.0 && next != own;
            let high = if blends { density(next, level + 1, coarse) } else { None };
            located.density[i] = match (low, high) {
                (None, None) => continue,
                (low, high) if blends => {
                    let low = low.unwrap_or_else(|| field.empty_density(own));
                    let high = high.unwrap_or_else(|| field.empty_density(next));
                    low + (high - low) * self.blend[i]
                }
                (Some(low), _) => low,
                (None, Some(_)) => continue,
            };
        }
        located
    }

    /// Raw colour of a sample, blended between levels.
    #[inline(always)]
    fn color<const C: usize>(
        &self,
        field: &impl Sample<C>,
        [fine, coarse]: &[Option<Cell>; 2],
        blend: f32,
    ) -> [f32; C] {
        let at = |level: usize, cell: &Option<Cell>| match cell {
            Some(cell) => field.color(level, cell),
            None => field.empty_color(level),
        };
        let mut color = at(self.level, fine);
        if blend > 0.0 {
            let coarser = at(self.level + 1, coarse);
            for (color, coarser) in color.iter_mut().zip(coarser) {
                *color += (coarser - *color) * blend;
            }
        }
        color
    }
}

/// What each sample of a packet adds.
struct Composited {
    /// Opacity times the light left before the sample.
    weight: [f32; PACKET],
    /// Optical depth behind all of them.
    depth: f32,
}

/// Activates densities and composites them front to back behind an optical depth of `depth`.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn composite(
    density: &[f32; PACKET],
    activation: &Activation,
    alpha_threshold: f32,
    depth: f32,
) -> Composited {
    let (shift, interval) = (activation.shift, activation.interval);
    let mut optical = [0.0f32; PACKET];
    match activation.order {
        ActivationOrder::Raw => {
            for (out, raw) in optical.iter_mut().zip(density) {
                *out = lanes::softplus(raw + shift) * interval;
            }
        }
        ActivationOrder::Density => {
            for (out, sigma) in optical.iter_mut().zip(density) {
                *out = sigma.max(0.0) * interval;
            }
        }
        ActivationOrder::Opacity => {
            for (out, alpha) in optical.iter_mut().zip(density) {
                *out = -(-alpha.clamp(0.0, 1.0 - f32::EPSILON)).ln_1p();
            }
        }
    }
    let mut weight = [0.0; PACKET];
    for (weight, depth) in weight.iter_mut().zip(optical) {
        *weight = lanes::opacity(depth);
    }
    let mut before = [0.0; PACKET];
    let mut depth = depth;
    for i in 0..PACKET {
        before[i] = depth;
        if weight[i] > alpha_threshold {
            depth += optical[i];
        } else {
            weight[i] = 0.0;
        }
    }
    for (weight, before) in weight.iter_mut().zip(before) {
        *weight *= lanes::exp(-before);
    }
    Composited { weight, depth }
}
