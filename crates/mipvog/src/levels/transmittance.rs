//! Transmittance from outside the box to each node, along the 26 directions to a neighbour.
//!
//! Planes are swept in order, once upwards and once downwards along x. A sweep carries the
//! transmittance of nine directions from each plane to the next. The eight directions within planes
//! follow plane by plane. So the working set stays in the caches, and the whole grid is read three
//! times instead of once per direction. Both sweeps run at the same time. The sweep that reaches a
//! plane later adds to the sums of the other, so each node has one set of sums. Adding two numbers
//! is commutative, and all other terms of a sum have a fixed order, so results do not depend on
//! threads.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use multiversion::multiversion;

use crate::base::error::Result;
use crate::base::lock::lock;
use crate::base::parallel;
use crate::model::activate::lanes;
use crate::model::grid::Nodes;

/// Smaller transmittances and optical depths count as 0, because subnormal products are slow.
pub const NEGLIGIBLE: f32 = 1e-9;
/// The greatest optical depth from a node to the next, for the same reason.
const GREATEST_DEPTH: f32 = 30.0;
/// Steps along y and z on the way from a plane to the next.
const SIDEWAYS: [[isize; 2]; 9] =
    [[0, 0], [-1, 0], [1, 0], [0, -1], [0, 1], [-1, -1], [-1, 1], [1, -1], [1, 1]];

/// The integer that represents a bent normal component of 1.
pub const BENT_ONE: f32 = 32767.0;

/// Bent normals by axis, as 16-bit integers; 32767 represents 1.
pub type BentNormals = [Vec<i16>; 3];

/// The light that reaches the nodes of a plane.
#[derive(Debug, Default)]
pub struct PlaneLight {
    /// The sum over all directions of each node's transmittance, 0 to 26.
    pub sums: Vec<f32>,
    /// Bent normals if requested, else empty.
    pub bent: BentNormals,
}

/// A grid of optical depths.
#[derive(Debug, Clone, Copy)]
pub struct TransmittanceSweep<'a> {
    /// The grid's size.
    pub nodes: Nodes,
    /// Intervals from a node to the next along each axis.
    pub spacing: [f32; 3],
    /// Optical depth over one interval by plane, z fastest.
    pub depths: &'a [Vec<f32>],
    /// The share of lost light that recovers behind an empty node, 0 to 1. At 0, light comes only
    /// from outside the box; above 0, also from empty space in the box.
    pub recovery: f32,
}

impl TransmittanceSweep<'_> {
    /// Traces light to all nodes, plane by plane. `bent` requests bent normals.
    ///
    /// # Errors
    ///
    /// None of its own.
    pub fn run(&self, bent: bool) -> Result<Vec<PlaneLight>> {
        let met: Vec<_> = self.depths.iter().map(|_| Mutex::new(None)).collect();
        parallel::join(|| self.along_x(false, bent, &met), || self.along_x(true, bent, &met));
        let plane = |met: Mutex<Option<_>>| {
            met.into_inner().unwrap_or_else(PoisonError::into_inner).unwrap_or_default()
        };
        let mut planes: Vec<PlaneLight> = met.into_iter().map(plane).collect();
        parallel::map_mut(&mut planes, |x, PlaneLight { sums, bent: all }| {
            let mut plane = PlaneSums { sums, bent: self.bent_plane(bent) };
            self.within_plane(&self.depths[x], &mut plane);
            all.iter_mut().zip(&plane.bent).for_each(|(all, part)| add_rounded(part, all));
            Ok(())
        })?;
        Ok(planes)
    }

    /// Zeros for a plane's bent normals; empty if not requested.
    fn bent_plane(&self, bent: bool) -> [Vec<f32>; 3] {
        [(); 3].map(|()| vec![0.0; if bent { self.plane_size() } else { 0 }])
    }

    /// The unit direction from a node towards the light that comes by `steps` along the axes.
    fn outwards(&self, steps: [isize; 3]) -> [f32; 3] {
        let way = [0, 1, 2].map(|axis| steps[axis] as f32 * self.spacing[axis]);
        let [x, y, z] = way.map(|part| part * part);
        let length = (x + y + z).sqrt();
        way.map(|part| -part / length)
    }

    fn plane_size(&self) -> usize {
        self.nodes.0[1] * self.nodes.0[2]
    }

    fn dark_plane(&self, bent: bool) -> PlaneLight {
        let size = self.plane_size();
        let bent = [(); 3].map(|()| vec![0; if bent { size } else { 0 }]);
        PlaneLight { sums: vec![0.0; size], bent }
    }

    /// Transmittances from the nodes of a plane to neighbours that are one step away along the axes
    /// in `steps`.
    fn node_transmittances(&self, depths: &[f32], steps: [bool; 3], transmittances: &mut [f32]) {
        let lengths = [0, 1, 2].map(|axis| if steps[axis] { self.spacing[axis] } else { 0.0 });
        let [x, y, z] = lengths.map(|length| length * length);
        exponentials(depths, (x + y + z).sqrt(), transmittances);
    }

    /// Adds the light along the nine directions up or down x to the planes' common sums.
    fn along_x(&self, down: bool, bent: bool, met: &[Mutex<Option<PlaneLight>>]) {
        let [nx, ny, nz] = self.nodes.0;
        let size = self.plane_size();
        let mut own = self.dark_plane(bent);
        let mut bent_plane = self.bent_plane(bent);
        // From outside to the plane, by direction.
        let mut light = [(); SIDEWAYS.len()].map(|()| vec![1.0; size]);
        let mut through = [(); 4].map(|()| vec![1.0; size]);
        let mut next = vec![1.0; size];
        for x in 0..nx {
            let x = if down { nx - 1 - x } else { x };
            own.sums.fill(0.0);
            bent_plane.iter_mut().for_each(|part| part.fill(0.0));
            let mut plane = PlaneSums { sums: &mut own.sums, bent: bent_plane };
            for ([dy, dz], light) in SIDEWAYS.into_iter().zip(&mut light) {
                let through = &through[kind(dy, dz)];
                let outwards = self.outwards([if down { -1 } else { 1 }, dy, dz]);
                for y in 0..ny {
                    let row = y * nz..(y + 1) * nz;
                    let next = &mut next[row.clone()];
                    match y.checked_add_signed(-dy).filter(|&from| from < ny) {
                        Some(from) => {
                            let from = from * nz..(from + 1) * nz;
                            step(dz, self.recovery, &light[from.clone()], &through[from], next);
                        }
                        None => next.fill(1.0),
                    }
                    plane.add(row, next, outwards);
                }
                std::mem::swap(light, &mut next);
            }
            bent_plane = plane.bent;
            own.bent.iter_mut().zip(&bent_plane).for_each(|(own, part)| round(part, own));
            let mut met = lock(&met[x]);
            match &mut *met {
                Some(other) => other.add(&own),
                first => *first = Some(std::mem::replace(&mut own, self.dark_plane(bent))),
            }
            drop(met);
            for (kind, through) in through.iter_mut().enumerate() {
                self.node_transmittances(
                    &self.depths[x],
                    [true, kind & 2 > 0, kind & 1 > 0],
                    through,
                );
            }
        }
    }

    /// Adds the transmittances along the eight directions within a plane.
    fn within_plane(&self, depths: &[f32], plane: &mut PlaneSums) {
        let Nodes([_, ny, nz]) = self.nodes;
        let mut through = vec![0.0; depths.len()];
        let [mut light, mut next] = [(); 2].map(|()| vec![1.0; nz]);
        for dz in [0, -1, 1] {
            // Both ways along z are equally long.
            if dz <= 0 {
                self.node_transmittances(depths, [false, true, dz != 0], &mut through);
            }
            for down in [false, true] {
                light.fill(1.0);
                let outwards = self.outwards([0, if down { -1 } else { 1 }, dz]);
                for y in 0..ny {
                    let y = if down { ny - 1 - y } else { y };
                    let row = y * nz..(y + 1) * nz;
                    plane.add(row.clone(), &light, outwards);
                    step(dz, self.recovery, &light, &through[row], &mut next);
                    std::mem::swap(&mut light, &mut next);
                }
            }
        }
        self.node_transmittances(depths, [false, false, true], &mut through);
        let [mut up, mut down] = [(); 2].map(|()| vec![1.0; nz]);
        for y in 0..ny {
            let row = y * nz..(y + 1) * nz;
            let through = &through[row.clone()];
            for z in 1..nz {
                let opposite = nz - 1 - z;
                up[z] = behind(up[z - 1], through[z - 1], self.recovery);
                down[opposite] = behind(down[opposite + 1], through[opposite + 1], self.recovery);
            }
            // The nearer entry comes first, so that a mirrored grid has the same sums.
            let (near, far) = (row.start..row.start + nz.div_ceil(2), nz.div_ceil(2));
            let far_row = near.end..row.end;
            let [above, below] = [1, -1].map(|dz| self.outwards([0, 0, dz]));
            plane.add(near.clone(), &up[..far], above);
            plane.add(near, &down[..far], below);
            plane.add(far_row.clone(), &down[far..], below);
            plane.add(far_row, &up[far..], above);
        }
    }
}

impl PlaneLight {
    /// Adds the light of the opposite direction.
    fn add(&mut self, other: &Self) {
        add(&mut self.sums, &other.sums);
        for (parts, others) in self.bent.iter_mut().zip(&other.bent) {
            // Nine of 26 directions each, so sums cannot overflow.
            parts.iter_mut().zip(others).for_each(|(part, other)| *part += other);
        }
    }
}

/// Sums over directions at the nodes of a plane.
struct PlaneSums<'a> {
    sums: &'a mut [f32],
    /// By axis; empty if bent normals are not requested.
    bent: [Vec<f32>; 3],
}

impl PlaneSums<'_> {
    /// Adds light that comes to a row from the unit direction `outwards`.
    fn add(&mut self, row: Range<usize>, light: &[f32], outwards: [f32; 3]) {
        add(&mut self.sums[row.clone()], light);
        for (part, along) in self.bent.iter_mut().zip(outwards) {
            if let Some(part) = part.get_mut(row.clone()).filter(|_| along != 0.0) {
                add_times(part, light, along);
            }
        }
    }
}

/// The index (of four) of the transmittances for steps along y and z.
fn kind(dy: isize, dz: isize) -> usize {
    2 * usize::from(dy != 0) + usize::from(dz != 0)
}

/// The light of the next row, `dz` nodes further along z; 1 where the ray enters the box.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn step(dz: isize, recovery: f32, light: &[f32], through: &[f32], next: &mut [f32]) {
    let last = light.len() - 1;
    let (from, next) = match dz {
        0 => (0..last + 1, next),
        1 => {
            next[0] = 1.0;
            (0..last, &mut next[1..])
        }
        _ => {
            next[last] = 1.0;
            (1..last + 1, &mut next[..last])
        }
    };
    for ((next, light), through) in next.iter_mut().zip(&light[from.clone()]).zip(&through[from]) {
        *next = behind(*light, *through, recovery);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn add(sums: &mut [f32], light: &[f32]) {
    for (sum, light) in sums.iter_mut().zip(light) {
        *sum += light;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn add_times(sums: &mut [f32], light: &[f32], times: f32) {
    for (sum, light) in sums.iter_mut().zip(light) {
        *sum += light * times;
    }
}

/// Converts sums over directions to bent normal components.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn round(sums: &[f32], parts: &mut [i16]) {
    for (part, sum) in parts.iter_mut().zip(sums) {
        *part = rounded(sum * (BENT_ONE / 26.0));
    }
}

/// Parts of bent normals from sums over the directions within planes, and from the parts of those
/// along x, which are the `parts` so far.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn add_rounded(sums: &[f32], parts: &mut [i16]) {
    for (part, sum) in parts.iter_mut().zip(sums) {
        *part = rounded(f32::from(*part) + sum * (BENT_ONE / 26.0));
    }
}

/// The nearest integer to a number below 32768 in magnitude, halves to even.
#[inline(always)]
fn rounded(value: f32) -> i16 {
    // At this magnitude, f32 numbers are integers, and the last bits are those of the integer.
    const WHOLE: f32 = 12_582_912.0;
    (value + WHOLE).to_bits() as i16
}

/// Transmittances over `length` intervals.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn exponentials(depths: &[f32], length: f32, transmittances: &mut [f32]) {
    for (transmittance, depth) in transmittances.iter_mut().zip(depths) {
        *transmittance = lanes::exp(-(depth * length).min(GREATEST_DEPTH));
    }
}

/// The light behind a node of transmittance `through`. The higher the transmittance, the more lost
/// light recovers.
#[inline(always)]
fn behind(light: f32, through: f32, recovery: f32) -> f32 {
    let (product, square) = (light * through, through * through);
    let light = product + (1.0 - product) * recovery * (square * square);
    if light > NEGLIGIBLE { light } else { 0.0 }
}
