//! Transmittance from outside the box to each node, along the 26 directions to a neighbour.
//!
//! Planes are swept in order, once upwards and once downwards along x. A sweep carries the
//! transmittance of nine directions from each plane to the next. The eight directions within planes
//! follow plane by plane. So the working set stays in the caches, and the whole grid is read three
//! times instead of once for each direction. Both sweeps run at the same time, and the terms of
//! each sum have one order, so results do not depend on threads.

use multiversion::multiversion;

use crate::base::error::Result;
use crate::base::parallel;
use crate::model::activate::lanes;
use crate::model::grid::Nodes;

/// Smaller transmittances and optical depths are 0: processors are slow with subnormal products.
pub const NEGLIGIBLE: f32 = 1e-9;
/// The greatest optical depth from a node to the next, for the same reason.
const GREATEST_DEPTH: f32 = 30.0;
/// Steps along y and z on the way from a plane to the next.
const SIDEWAYS: [[isize; 2]; 9] =
    [[0, 0], [-1, 0], [1, 0], [0, -1], [0, 1], [-1, -1], [-1, 1], [1, -1], [1, 1]];

/// A grid of optical depths.
#[derive(Debug, Clone, Copy)]
pub struct TransmittanceSweep<'a> {
    /// The grid's size.
    pub nodes: Nodes,
    /// Intervals from a node to the next along each axis.
    pub spacing: [f32; 3],
    /// Optical depth over one interval, z fastest.
    pub depths: &'a [f32],
}

impl TransmittanceSweep<'_> {
    /// The sum over all directions of each node's transmittance, 0 to 26.
    pub fn sums(&self) -> Result<Vec<f32>> {
        let (mut up, down) = parallel::join(|| self.along_x(false), || self.along_x(true));
        let size = self.plane_size();
        let mut planes: Vec<_> = up.chunks_mut(size).zip(down.chunks(size)).collect();
        parallel::map_mut(&mut planes, |x, (sums, down)| {
            sums.iter_mut().zip(*down).for_each(|(sum, down)| *sum += down);
            self.within_plane(self.plane(x), sums);
            Ok(())
        })?;
        Ok(up)
    }

    fn plane_size(&self) -> usize {
        self.nodes.0[1] * self.nodes.0[2]
    }

    fn plane(&self, x: usize) -> &[f32] {
        &self.depths[x * self.plane_size()..][..self.plane_size()]
    }

    /// Transmittances from the nodes of a plane to neighbours that are one step away along the axes
    /// in `steps`.
    fn node_transmittances(&self, depths: &[f32], steps: [bool; 3], transmittances: &mut [f32]) {
        let lengths = [0, 1, 2].map(|axis| if steps[axis] { self.spacing[axis] } else { 0.0 });
        let [x, y, z] = lengths.map(|length| length * length);
        exponentials(depths, (x + y + z).sqrt(), transmittances);
    }

    /// The sums over the nine directions up along x, or down.
    fn along_x(&self, down: bool) -> Vec<f32> {
        let [nx, ny, nz] = self.nodes.0;
        let size = self.plane_size();
        let mut sums = vec![0.0; nx * size];
        // From outside to the plane, by direction.
        let mut light = [(); SIDEWAYS.len()].map(|()| vec![1.0; size]);
        let mut through = [(); 4].map(|()| vec![1.0; size]);
        let mut next = vec![1.0; size];
        for x in 0..nx {
            let x = if down { nx - 1 - x } else { x };
            let sums = &mut sums[x * size..][..size];
            for ([dy, dz], light) in SIDEWAYS.into_iter().zip(&mut light) {
                let through = &through[kind(dy, dz)];
                for y in 0..ny {
                    let row = y * nz..(y + 1) * nz;
                    let (next, sums) = (&mut next[row.clone()], &mut sums[row]);
                    match y.checked_add_signed(-dy).filter(|&from| from < ny) {
                        Some(from) => {
                            let from = from * nz..(from + 1) * nz;
                            step(dz, &light[from.clone()], &through[from], next);
                        }
                        None => next.fill(1.0),
                    }
                    add(sums, next);
                }
                std::mem::swap(light, &mut next);
            }
            for (kind, through) in through.iter_mut().enumerate() {
                self.node_transmittances(
                    self.plane(x),
                    [true, kind & 2 > 0, kind & 1 > 0],
                    through,
                );
            }
        }
        sums
    }

    /// Adds the transmittances along the eight directions within a plane.
    fn within_plane(&self, depths: &[f32], sums: &mut [f32]) {
        let nz = self.nodes.0[2];
        let mut through = vec![0.0; depths.len()];
        let [mut light, mut next] = [(); 2].map(|()| vec![1.0; nz]);
        for dz in [0, -1, 1] {
            // Both ways along z are equally long.
            if dz <= 0 {
                self.node_transmittances(depths, [false, true, dz != 0], &mut through);
            }
            for down in [false, true] {
                light.fill(1.0);
                let mut go = |(through, sums): (&[f32], &mut [f32])| {
                    add(sums, &light);
                    step(dz, &light, through, &mut next);
                    std::mem::swap(&mut light, &mut next);
                };
                let rows = through.chunks_exact(nz).zip(sums.chunks_exact_mut(nz));
                if down { rows.rev().for_each(&mut go) } else { rows.for_each(&mut go) }
            }
        }
        self.node_transmittances(depths, [false, false, true], &mut through);
        for (through, sums) in through.chunks_exact(nz).zip(sums.chunks_exact_mut(nz)) {
            let [mut up, mut down] = [1.0; 2];
            for z in 0..nz {
                let opposite = nz - 1 - z;
                sums[z] += up;
                sums[opposite] += down;
                up = behind(up, through[z]);
                down = behind(down, through[opposite]);
            }
        }
    }
}

/// The number, of four, of the transmittances that steps along y and z need.
fn kind(dy: isize, dz: isize) -> usize {
    2 * usize::from(dy != 0) + usize::from(dz != 0)
}

/// The transmittances of the next row, `dz` nodes further along z; 1 where the ray enters there.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn step(dz: isize, light: &[f32], through: &[f32], next: &mut [f32]) {
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
        *next = behind(*light, *through);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn add(sums: &mut [f32], light: &[f32]) {
    for (sum, light) in sums.iter_mut().zip(light) {
        *sum += light;
    }
}

/// Transmittances over `length` intervals.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn exponentials(depths: &[f32], length: f32, transmittances: &mut [f32]) {
    for (transmittance, depth) in transmittances.iter_mut().zip(depths) {
        *transmittance = lanes::exp(-(depth * length).min(GREATEST_DEPTH));
    }
}

/// The transmittance behind a node that lets the share `through` through.
#[inline(always)]
fn behind(light: f32, through: f32) -> f32 {
    let product = light * through;
    if product > NEGLIGIBLE { product } else { 0.0 }
}
