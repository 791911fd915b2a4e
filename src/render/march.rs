//! One ray.

use super::footprint::Footprint;
use super::view::View;
use crate::activate::lanes;
use crate::baked::Aside;
use crate::camera::Ray;
use crate::field::ActivationOrder;
use crate::sample::{Cell, Macro, Sample};

/// Samples whose activations are computed together.
const PACKET: usize = 16;
/// Optical depth from which a ray ends: transmittance 1e-5, a hundredth of an 8-bit step over white.
const OPAQUE_DEPTH: f32 = 11.6;

/// What a ray gathers.
#[derive(Debug, Clone, Copy)]
pub struct Gathered<const C: usize> {
    /// Weighted activated colour and features.
    pub color: [f32; C],
    /// Light left behind the field.
    pub transmittance: f32,
    /// Weighted distance from the camera, in world units.
    pub distance: f32,
    /// Weighted level.
    pub level: f32,
    /// Samples that were interpolated.
    pub samples: u32,
    /// Samples between entry and exit, looked at or not.
    pub steps: u32,
}

/// A ray in the field's own coordinates: sample `k` is at `start + k * step`, `0..=1` along each axis.
struct Path {
    start: [f64; 3],
    step: [f64; 3],
    first: f64,
    last: f64,
    /// `t` of sample 0, and for each step.
    entry: f64,
    t_step: f64,
    /// World units for a unit of `t`.
    length: f64,
}

/// Samples that wait for their activation.
struct Packet {
    count: usize,
    k: [f64; PACKET],
    level: [usize; PACKET],
    /// Share of the next coarser level.
    blend: [f32; PACKET],
    cells: [[Option<Cell>; 2]; PACKET],
    density: [f32; PACKET],
}

/// Follows a ray; `aside` are the rays half a pixel aside along x and y, if the level depends on them.
pub fn march<const C: usize, S: Sample<C> + ?Sized>(
    view: &View,
    field: &S,
    ray: &Ray,
    aside: Option<[Ray; 2]>,
    fixed_level: Option<usize>,
) -> Gathered<C> {
    let mut gathered = Gathered {
        color: [0.0; C],
        transmittance: 1.0,
        distance: 0.0,
        level: 0.0,
        samples: 0,
        steps: 0,
    };
    let Some(path) = Path::new(view, ray) else { return gathered };
    gathered.steps = (path.last - path.first) as u32 + 1;
    let footprint = aside.and_then(|aside| {
        let rule = view.level_of_detail.as_ref()?;
        let sides = aside.map(|other| path.offsets(view, rule.aside, &other));
        Some(Footprint::new(sides, rule, field.levels()))
    });
    let constant = match (&footprint, fixed_level) {
        (_, Some(level)) => Some(level.min(field.levels() - 1) as f32),
        (None, None) => Some(0.0),
        (Some(footprint), None) => footprint.constant(path.first, path.last),
    };
    let lambda = |k: f64| match (constant, &footprint) {
        (Some(level), _) => level,
        (None, Some(footprint)) => footprint.lambda(k),
        (None, None) => 0.0,
    };
    let mut packet = Packet::empty();
    let mut depth = 0.0f32;
    let mut k = path.first;
    let skip = field.skip();
    // A macro cell that samples are in, until they leave it; and what is in it.
    let mut inside: Option<(f64, usize, Macro)> = None;
    while k <= path.last && depth < OPAQUE_DEPTH {
        let position = path.position(k);
        let level_at = lambda(k);
        let level = level_at as usize;
        let state = match inside {
            Some((leaves, same, state)) if k < leaves && same == level => state,
            _ => {
                let place = skip.place(position);
                let leaves = skip.leaves(place, path.start, path.step);
                let state = skip.state(level, place);
                if state == Macro::Empty {
                    // The first sample that is no longer in it; never the same again.
                    let next = (leaves.min(path.last + 1.0)).ceil().max(k + 1.0);
                    // Between, the level may change to one whose cells are not empty.
                    let end = lambda(next.min(path.last)) as usize;
                    let (low, high) = (level.min(end), level.max(end));
                    let empty = (low..=high).all(|l| skip.state(l, place) == Macro::Empty);
                    k = if empty { next } else { k + 1.0 };
                    continue;
                }
                inside = Some((leaves, level, state));
                state
            }
        };
        if state == Macro::Open || view.keeps(position) {
            packet.push(field, k, position, level_at);
            if packet.count == PACKET {
                packet.shade(view, field, &path, &mut depth, &mut gathered);
            }
        }
        k += 1.0;
    }
    packet.shade(view, field, &path, &mut depth, &mut gathered);
    gathered.transmittance = lanes::exp(-depth);
    gathered
}

impl Path {
    /// Where the ray samples the box; none if it misses it.
    fn new(view: &View, ray: &Ray) -> Option<Self> {
        let (entry, length) = (entry_t(view, ray), ray.direction.length());
        let t_step = step_world(view) / length;
        let (start, step) = samples(view, ray, entry, t_step);
        let most = view.nodes.0.map(|size| (size + 1) as f64);
        let most = (most[0] * most[0] + most[1] * most[1] + most[2] * most[2]).sqrt();
        // The first and the last sample inside, along every axis.
        let (mut first, mut last) = (0.0f64, (most / f64::from(view.march.stepsize)).floor());
        for axis in 0..3 {
            let (from, by) = (start[axis], step[axis]);
            if by == 0.0 {
                if !(0.0..=1.0).contains(&from) {
                    return None;
                }
                continue;
            }
            let (a, b) = (-from / by, (1.0 - from) / by);
            first = first.max(a.min(b).ceil());
            last = last.min(a.max(b).floor());
        }
        (first <= last).then_some(Self { start, step, first, last, entry, t_step, length })
    }

    fn position(&self, k: f64) -> [f64; 3] {
        [0, 1, 2].map(|axis| (self.start[axis] + k * self.step[axis]).clamp(0.0, 1.0))
    }

    /// Offset of the samples of `other`, half a pixel aside, in voxels for a whole pixel: of sample
    /// 0, and its growth with each step.
    fn offsets(&self, view: &View, aside: Aside, other: &Ray) -> [[f64; 3]; 2] {
        let (start, step) = match aside {
            Aside::SameIndex => {
                let t_step = step_world(view) / other.direction.length();
                samples(view, other, entry_t(view, other), t_step)
            }
            Aside::SameDistance => samples(view, other, self.entry, self.t_step),
        };
        // Positions are shares of the box, which is N voxels along an axis.
        let voxels = |axis: usize| 2.0 * view.nodes.0[axis] as f64;
        [
            [0, 1, 2].map(|axis| (start[axis] - self.start[axis]) * voxels(axis)),
            [0, 1, 2].map(|axis| (step[axis] - self.step[axis]) * voxels(axis)),
        ]
    }
}

impl View {
    /// Whether the free-space mask keeps a sample.
    fn keeps(&self, position: [f64; 3]) -> bool {
        let Some(free_space) = &self.free_space else { return true };
        let extent = self.bounds.extent();
        let world =
            [0, 1, 2].map(|axis| f64::from(self.bounds.min[axis]) + position[axis] * extent[axis]);
        free_space.contains(world)
    }

    fn to_box(&self, axis: usize, world: f64) -> f64 {
        (world - f64::from(self.bounds.min[axis])) / self.bounds.extent()[axis]
    }
}

/// `t` at which a ray enters the box, clamped to near and far.
fn entry_t(view: &View, ray: &Ray) -> f64 {
    let mut entry = f64::NEG_INFINITY;
    for axis in 0..3 {
        let (origin, direction) = (ray.origin[axis], ray.direction[axis]);
        // A ray along a face enters and leaves it at once, however that is rounded.
        let direction = if direction == 0.0 { 1e-12 } else { direction };
        let (min, max) = (f64::from(view.bounds.min[axis]), f64::from(view.bounds.max[axis]));
        entry = entry.max(((min - origin) / direction).min((max - origin) / direction));
    }
    let far = view.march.far.map_or(f64::INFINITY, f64::from);
    entry.max(f64::from(view.march.near)).min(far)
}

/// Length of a step in world units.
fn step_world(view: &View) -> f64 {
    f64::from(view.march.stepsize) * f64::from(view.march.voxel_size)
}

/// Sample 0 at `t = entry` and the way from one sample to the next, `t_step` later, `0..=1` along each
/// axis of the box.
fn samples(view: &View, ray: &Ray, entry: f64, t_step: f64) -> ([f64; 3], [f64; 3]) {
    let extent = view.bounds.extent();
    let start =
        [0, 1, 2].map(|axis| view.to_box(axis, ray.origin[axis] + ray.direction[axis] * entry));
    (start, [0, 1, 2].map(|axis| ray.direction[axis] * t_step / extent[axis]))
}

impl Packet {
    fn empty() -> Self {
        Self {
            count: 0,
            k: [0.0; PACKET],
            level: [0; PACKET],
            blend: [0.0; PACKET],
            cells: [[None; 2]; PACKET],
            density: [0.0; PACKET],
        }
    }

    /// Interpolates a sample's density, if anything is stored at its place.
    #[inline(always)]
    fn push<const C: usize, S: Sample<C> + ?Sized>(
        &mut self,
        field: &S,
        k: f64,
        position: [f64; 3],
        lambda: f32,
    ) {
        let level = lambda as usize;
        let blend = lambda - level as f32;
        let fine = field.locate(level, position);
        let coarse = if blend > 0.0 { field.locate(level + 1, position) } else { None };
        let at = |level: usize, cell: &Option<Cell>| match cell {
            Some(cell) => field.density(level, cell),
            None => None,
        };
        // A level without density has level 0's.
        let (low, high) = match field.density_level(level) {
            true => (at(level, &fine), at(level + 1, &coarse)),
            false => (field.locate(0, position).and_then(|cell| field.density(0, &cell)), None),
        };
        let levels_have_density = field.density_level(level + usize::from(blend > 0.0));
        let density = match (low, high) {
            (None, None) => return,
            (low, high) if blend > 0.0 && levels_have_density => {
                let low = low.unwrap_or_else(|| field.empty_density(level));
                let high = high.unwrap_or_else(|| field.empty_density(level + 1));
                low + (high - low) * blend
            }
            (Some(low), _) => low,
            (None, Some(_)) => return,
        };
        let i = self.count;
        self.k[i] = k;
        self.level[i] = level;
        self.blend[i] = blend;
        self.cells[i] = [fine, coarse];
        self.density[i] = density;
        self.count += 1;
    }

    /// Activates, composites and empties the packet.
    fn shade<const C: usize, S: Sample<C> + ?Sized>(
        &mut self,
        view: &View,
        field: &S,
        path: &Path,
        depth: &mut f32,
        gathered: &mut Gathered<C>,
    ) {
        let count = std::mem::take(&mut self.count);
        gathered.samples += count as u32;
        let (optical, opacity) = activate(view, &self.density);
        for i in 0..count {
            if opacity[i] <= view.march.alpha_threshold {
                continue;
            }
            let weight = opacity[i] * lanes::exp(-*depth);
            *depth += optical[i];
            let distance = (path.entry + self.k[i] * path.t_step) * path.length;
            gathered.distance += weight * distance as f32;
            gathered.level += weight * (self.level[i] as f32 + self.blend[i]);
            if weight > view.march.color_threshold {
                let color = self.color(field, i);
                for (sum, raw) in gathered.color.iter_mut().zip(color) {
                    *sum += weight * lanes::sigmoid(raw);
                }
            }
        }
    }

    /// Raw colour of a sample, blended between levels.
    #[inline(always)]
    fn color<const C: usize, S: Sample<C> + ?Sized>(&self, field: &S, i: usize) -> [f32; C] {
        let level = self.level[i];
        let at = |level: usize, cell: &Option<Cell>| match cell {
            Some(cell) => field.color(level, cell),
            None => [0.0; C],
        };
        let [fine, coarse] = &self.cells[i];
        let blend = self.blend[i];
        let low = at(level, fine);
        if blend == 0.0 {
            return low;
        }
        let high = at(level + 1, coarse);
        std::array::from_fn(|lane| low[lane] + (high[lane] - low[lane]) * blend)
    }
}

/// Optical depth and opacity of each sample of a packet.
#[inline(always)]
fn activate(view: &View, density: &[f32; PACKET]) -> ([f32; PACKET], [f32; PACKET]) {
    let (shift, interval) = (view.activation.shift, view.activation.interval);
    let mut optical = [0.0; PACKET];
    match view.activation.order {
        ActivationOrder::Raw => {
            for (out, raw) in optical.iter_mut().zip(density) {
                *out = lanes::softplus(raw + shift) * interval;
            }
        }
        ActivationOrder::Density => {
            for (out, sigma) in optical.iter_mut().zip(density) {
                *out = sigma * interval;
            }
        }
        ActivationOrder::Opacity => {
            let depth = |alpha: f32| -(-alpha.min(1.0 - f32::EPSILON)).ln_1p();
            return (density.map(depth), *density);
        }
    }
    (optical, optical.map(lanes::opacity))
}
