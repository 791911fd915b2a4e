//! Light that gets to each node along the 26 directions to a neighbour.
//!
//! Planes are gone through in order, once upwards and once downwards along x, with the light of nine directions on the
//! way from each to the next; the eight directions within planes follow plane by plane. So what is worked on stays in
//! the caches, and the whole field is read three times instead of once for each direction. Both ways run at the same
//! time, and each sum has its terms in one order: threads never show.

use multiversion::multiversion;

use crate::base::error::Result;
use crate::base::parallel;
use crate::model::activate::lanes;
use crate::model::grid::Nodes;

/// Light below this is none: it keeps products from subnormal numbers, which processors are slow with.
pub const LEAST: f32 = 1e-9;
/// No optical depth is more than this from a node to the next, for the same reason.
const MOST_DEPTH: f32 = 30.0;
/// Steps along y and z on the way from a plane to the next.
const SIDEWAYS: [[isize; 2]; 9] =
    [[0, 0], [-1, 0], [1, 0], [0, -1], [0, 1], [-1, -1], [-1, 1], [1, -1], [1, 1]];

/// What is in the way of light.
#[derive(Debug, Clone, Copy)]
pub struct Light<'a> {
    /// Its size.
    pub nodes: Nodes,
    /// Intervals from a node to the next along each axis.
    pub spacing: [f32; 3],
    /// Optical depth over one interval, z fastest.
    pub depths: &'a [f32],
}

impl Light<'_> {
    /// The sum of the light, 1 at its start, that gets to each node along all directions.
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

    /// What the nodes of a plane let through to neighbours so many steps away along each axis.
    fn passing(&self, depths: &[f32], steps: [bool; 3], passing: &mut [f32]) {
        let lengths = [0, 1, 2].map(|axis| if steps[axis] { self.spacing[axis] } else { 0.0 });
        let [x, y, z] = lengths.map(|length| length * length);
        transmittances(depths, (x + y + z).sqrt(), passing);
    }

    /// The sums over the nine directions up along x, or down.
    fn along_x(&self, down: bool) -> Vec<f32> {
        let [nx, ny, nz] = self.nodes.0;
        let size = self.plane_size();
        let mut sums = vec![0.0; nx * size];
        // Behind what has been gone through: nothing so far.
        let mut light = [(); SIDEWAYS.len()].map(|()| vec![1.0; size]);
        let mut passing = [(); 4].map(|()| vec![1.0; size]);
        let mut next = vec![1.0; size];
        for x in 0..nx {
            let x = if down { nx - 1 - x } else { x };
            let sums = &mut sums[x * size..][..size];
            for ([dy, dz], light) in SIDEWAYS.into_iter().zip(&mut light) {
                let passing = &passing[kind(dy, dz)];
                for y in 0..ny {
                    let row = y * nz..(y + 1) * nz;
                    let (next, sums) = (&mut next[row.clone()], &mut sums[row]);
                    match y.checked_add_signed(-dy).filter(|&from| from < ny) {
                        Some(from) => {
                            let from = from * nz..(from + 1) * nz;
                            step(dz, &light[from.clone()], &passing[from], next);
                        }
                        None => next.fill(1.0),
                    }
                    add(sums, next);
                }
                std::mem::swap(light, &mut next);
            }
            for (kind, passing) in passing.iter_mut().enumerate() {
                self.passing(self.plane(x), [true, kind & 2 > 0, kind & 1 > 0], passing);
            }
        }
        sums
    }

    /// Adds the light along the eight directions within a plane.
    fn within_plane(&self, depths: &[f32], sums: &mut [f32]) {
        let nz = self.nodes.0[2];
        let mut passing = vec![0.0; depths.len()];
        let [mut light, mut next] = [(); 2].map(|()| vec![1.0; nz]);
        for dz in [0, -1, 1] {
            // Both ways along z take as long.
            if dz <= 0 {
                self.passing(depths, [false, true, dz != 0], &mut passing);
            }
            for down in [false, true] {
                light.fill(1.0);
                let mut go = |(passing, sums): (&[f32], &mut [f32])| {
                    add(sums, &light);
                    step(dz, &light, passing, &mut next);
                    std::mem::swap(&mut light, &mut next);
                };
                let rows = passing.chunks_exact(nz).zip(sums.chunks_exact_mut(nz));
                if down { rows.rev().for_each(&mut go) } else { rows.for_each(&mut go) }
            }
        }
        self.passing(depths, [false, false, true], &mut passing);
        for (passing, sums) in passing.chunks_exact(nz).zip(sums.chunks_exact_mut(nz)) {
            let [mut up, mut down] = [1.0; 2];
            for z in 0..nz {
                let opposite = nz - 1 - z;
                sums[z] += up;
                sums[opposite] += down;
                up = behind(up, passing[z]);
                down = behind(down, passing[opposite]);
            }
        }
    }
}

/// Which of four transmittances steps along y and z need.
fn kind(dy: isize, dz: isize) -> usize {
    2 * usize::from(dy != 0) + usize::from(dz != 0)
}

/// The light of the next row behind one, `dz` nodes further along z; 1 where it comes from outside.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn step(dz: isize, light: &[f32], passing: &[f32], next: &mut [f32]) {
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
    for ((next, light), passing) in next.iter_mut().zip(&light[from.clone()]).zip(&passing[from]) {
        *next = behind(*light, *passing);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn add(sums: &mut [f32], light: &[f32]) {
    for (sum, light) in sums.iter_mut().zip(light) {
        *sum += light;
    }
}

/// What nodes let through to the next, `length` intervals away.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn transmittances(depths: &[f32], length: f32, passing: &mut [f32]) {
    for (passing, depth) in passing.iter_mut().zip(depths) {
        *passing = lanes::exp(-(depth * length).min(MOST_DEPTH));
    }
}

/// What is left of `light` behind what lets `passing` through.
#[inline(always)]
fn behind(light: f32, passing: f32) -> f32 {
    let left = light * passing;
    if left > LEAST { left } else { 0.0 }
}
