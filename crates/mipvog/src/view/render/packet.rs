//! Interpolates, activates and composites samples of a ray together, so the compiler can use vector
//! instructions.

use multiversion::multiversion;

use super::color_rule::ColorRule;
use super::path::Path;
use crate::model::activate::lanes;
use crate::model::baked::{Blend, DensityDomain};
use crate::model::field::{Activation, ActivationOrder, DensityFunction};
use crate::view::sample::{Cell, SampleLevels, View, optical_depth, raw_depth};

/// Samples per packet: one cache line of f32, and about as many as a ray has before it ends.
const PACKET: usize = 16;

/// Samples of one ray at one level, each blended with the next coarser one.
pub struct Packet {
    /// The finer of the two blended levels.
    level: usize,
    /// The part of the field that contains the samples.
    part: usize,
    count: usize,
    k: [f64; PACKET],
    /// Weight of the next coarser level.
    blend: [f32; PACKET],
    /// Intervals per sample.
    intervals: [f32; PACKET],
}

/// Sums over a ray's packets, in f64. A ray can have 10^5 samples; in f32, equal small addends
/// would all round the same way, with an error of 1/300 of their sum.
pub struct Sums<const C: usize> {
    /// Optical depth.
    pub depth: f64,
    /// Weighted sum of activated colours and features.
    pub color: [f64; C],
    /// Weighted sum of distances from the camera.
    pub distance: f64,
    /// Weighted sum of levels.
    pub level: f64,
    /// Number of interpolated samples.
    pub samples: u32,
}

impl<const C: usize> Sums<C> {
    /// The sums of no samples.
    pub fn nothing() -> Self {
        Self { depth: 0.0, color: [0.0; C], distance: 0.0, level: 0.0, samples: 0 }
    }
}

/// Cells of a packet's samples, and the values stored there.
struct Located {
    cells: [[Option<Cell>; 2]; PACKET],
    /// Densities of the finer and the coarser level.
    density: [[f32; PACKET]; 2],
    /// Factor from optical depths of both to those over one interval.
    scales: [f32; 2],
    /// Meaning of the finer level's densities.
    domain: DensityDomain,
    /// Meaning of the coarser level's densities, if they are decoded before they are mixed.
    coarser: Option<DensityDomain>,
}

/// The density of empty space.
fn nothing(domain: DensityDomain) -> f32 {
    match domain {
        DensityDomain::Raw => f32::NEG_INFINITY,
        DensityDomain::SqrtOpticalDepth | DensityDomain::Opacity => 0.0,
    }
}

impl Packet {
    /// A packet without samples.
    pub fn empty() -> Self {
        let (k, blend, intervals) = ([0.0; PACKET], [0.0; PACKET], [1.0; PACKET]);
        Self { level: 0, part: 0, count: 0, k, blend, intervals }
    }

    /// True if the packet must be shaded before it can take a sample of this part.
    #[inline(always)]
    pub fn refuses(&self, part: usize) -> bool {
        self.count == PACKET || (self.part != part && self.count > 0)
    }

    /// Adds sample `k` of `intervals` intervals in a part of the field, with a level of detail
    /// between `level` and the next.
    #[inline(always)]
    pub fn push(&mut self, k: f64, [level, part]: [usize; 2], blend: f32, intervals: f32) {
        (self.level, self.part) = (level, part);
        self.k[self.count] = k;
        self.blend[self.count] = blend;
        self.intervals[self.count] = intervals;
        self.count += 1;
    }

    /// Interpolates, activates and composites the samples, adds them to `sums`, and empties the
    /// packet.
    pub fn shade<const C: usize>(
        &mut self,
        view: &View,
        field: &impl SampleLevels<C>,
        path: &Path,
        rule: &ColorRule,
        sums: &mut Sums<C>,
    ) {
        if self.count > 0 {
            shade(self, view, field, path, rule, sums);
        }
    }

    /// [`Self::shade`] of a packet that is not empty.
    #[inline(always)]
    fn add_to<const C: usize>(
        &mut self,
        view: &View,
        field: &impl SampleLevels<C>,
        path: &Path,
        rule: &ColorRule,
        sums: &mut Sums<C>,
    ) {
        let located = self.locate(view, field, path);
        let count = std::mem::take(&mut self.count);
        sums.samples += count as u32;
        let [scale, coarser_scale] = located.scales;
        let mut optical = optical_depths(&located.density[0], located.domain, view);
        optical.iter_mut().for_each(|depth| *depth *= scale);
        if let Some(domain) = located.coarser {
            let coarser = optical_depths(&located.density[1], domain, view);
            for i in 0..PACKET {
                optical[i] += (coarser_scale * coarser[i] - optical[i]) * self.blend[i];
            }
        }
        let threshold = view.march.alpha_threshold;
        let composited = composite(&optical, &self.intervals, threshold, sums.depth as f32);
        // Lanes without a sample are empty and add nothing.
        sums.depth += f64::from(composited.depth);
        let (mut colors, mut distance, mut levels) = ([0.0; C], 0.0, 0.0);
        for i in 0..count {
            let weight = composited.weight[i];
            if weight == 0.0 {
                continue;
            }
            distance += weight * path.distance(self.k[i]) as f32;
            levels += weight * (self.level as f32 + self.blend[i]);
            if weight > view.march.color_threshold {
                let cells = &located.cells[i];
                let color = self.color(view.blend, rule, field, cells, self.blend[i]);
                for (sum, color) in colors.iter_mut().zip(color) {
                    *sum += weight * color;
                }
            }
        }
        sums.distance += f64::from(distance);
        sums.level += f64::from(levels);
        for (sum, color) in sums.color.iter_mut().zip(colors) {
            *sum += f64::from(color);
        }
    }

    /// Finds the samples' cells and interpolates their densities.
    #[inline(always)]
    fn locate<const C: usize>(
        &self,
        view: &View,
        field: &impl SampleLevels<C>,
        path: &Path,
    ) -> Located {
        let (level, part) = (self.level, self.part);
        // A level without density has level 0's.
        let owner = |level: usize| if field.density_level(level) { level } else { 0 };
        let (own, next) = (owner(part), owner(level + 1));
        let (domain, coarser) = (field.density_domain(own), field.density_domain(next));
        let mut located = Located {
            cells: [[None; 2]; PACKET],
            // Cells without stored values are empty.
            density: [[nothing(domain); PACKET], [nothing(coarser); PACKET]],
            scales: [field.depth_scale(own), field.depth_scale(next)],
            domain,
            coarser: (next != own && view.blend == Blend::AfterActivation).then_some(coarser),
        };
        for i in 0..self.count {
            let position = path.position(self.k[i]);
            let fine = field.locate(part, position);
            let coarse = match self.blend[i] > 0.0 {
                true => field.locate(level + 1, position),
                false => None,
            };
            located.cells[i] = [fine, coarse];
            let low_cell = if own == part { fine } else { field.locate(own, position) };
            let low = low_cell.map(|cell| field.density(own, &cell, &path.along));
            let blends = self.blend[i] > 0.0 && next != own;
            let high_cell = match blends {
                true if next == level + 1 => coarse,
                true => field.locate(next, position),
                false => None,
            };
            let high = high_cell.map(|cell| field.density(next, &cell, &path.along));
            if low.is_none() && high.is_none() {
                continue;
            }
            let [fine_density, coarse_density] = &mut located.density;
            fine_density[i] = low.unwrap_or_else(|| field.empty_density(own));
            if blends {
                let high = high.unwrap_or_else(|| field.empty_density(next));
                match view.blend {
                    Blend::BeforeActivation => {
                        fine_density[i] += (high - fine_density[i]) * self.blend[i]
                    }
                    Blend::AfterActivation => coarse_density[i] = high,
                }
            }
        }
        located
    }

    /// Activated colour of a sample, blended between levels.
    #[inline(always)]
    fn color<const C: usize>(
        &self,
        order: Blend,
        rule: &ColorRule,
        field: &impl SampleLevels<C>,
        [fine, coarse]: &[Option<Cell>; 2],
        blend: f32,
    ) -> [f32; C] {
        let at = |level: usize, cell: &Option<Cell>| match cell {
            Some(cell) => field.color(level, cell),
            None => field.empty_color(level),
        };
        let mut color = at(self.part, fine);
        if blend == 0.0 {
            rule.activate(&mut color);
            return color;
        }
        let mut coarser = at(self.level + 1, coarse);
        if order == Blend::AfterActivation {
            rule.activate(&mut color);
            rule.activate(&mut coarser);
        }
        for (color, coarser) in color.iter_mut().zip(coarser) {
            *color += (coarser - *color) * blend;
        }
        if order == Blend::BeforeActivation {
            rule.activate(&mut color);
        }
        color
    }
}

/// [`Packet::add_to`] in the processor's widest vectors.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn shade<const C: usize, S: SampleLevels<C>>(
    packet: &mut Packet,
    view: &View,
    field: &S,
    path: &Path,
    rule: &ColorRule,
    sums: &mut Sums<C>,
) {
    packet.add_to(view, field, path, rule, sums);
}

/// The share of each sample of a packet.
struct Composited {
    /// Opacity times the light left before the sample.
    weight: [f32; PACKET],
    /// Optical depth of all of them.
    depth: f32,
}

/// Optical depths over one interval of interpolated densities.
fn optical_depths(density: &[f32; PACKET], domain: DensityDomain, view: &View) -> [f32; PACKET] {
    let Activation { shift, interval, order, function } = view.activation;
    match (domain, order) {
        (DensityDomain::Raw, ActivationOrder::Raw) => {
            raw_depths(density, shift, interval, function)
        }
        _ => density.map(|density| optical_depth(density, domain, view)),
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn raw_depths(
    raw: &[f32; PACKET],
    shift: f32,
    interval: f32,
    function: DensityFunction,
) -> [f32; PACKET] {
    let mut depths = [0.0f32; PACKET];
    for (depth, &raw) in depths.iter_mut().zip(raw) {
        *depth = raw_depth(raw, shift, interval, function);
    }
    depths
}

/// Composites optical depths over one interval front to back, behind an optical depth of `outside`.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn composite(
    depths: &[f32; PACKET],
    intervals: &[f32; PACKET],
    alpha_threshold: f32,
    outside: f32,
) -> Composited {
    let mut optical = [0.0f32; PACKET];
    let mut weight = [0.0f32; PACKET];
    for i in 0..PACKET {
        optical[i] = depths[i] * intervals[i];
        weight[i] = lanes::opacity(optical[i]);
    }
    let mut before = [0.0; PACKET];
    let mut depth = 0.0;
    for i in 0..PACKET {
        before[i] = depth;
        if weight[i] > alpha_threshold {
            depth += optical[i];
        } else {
            weight[i] = 0.0;
        }
    }
    for (weight, before) in weight.iter_mut().zip(before) {
        *weight *= lanes::exp(-(outside + before));
    }
    Composited { weight, depth }
}
