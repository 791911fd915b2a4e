//! Small files of SVRaster's voxels.

use std::collections::BTreeMap;

use super::torch::{Item, TorchFile};

/// Edges of the smallest voxels in the octree's.
const SIDE: u32 = 1 << 16;
/// Edges of [`Voxels::small`]'s smallest voxels in the octree's.
const CELLS: u32 = 16;

/// A voxel's place in the smallest voxels' edges.
#[derive(Debug, Clone, Copy)]
pub struct Cube {
    pub corner: [u32; 3],
    pub edge: u32,
}

impl Cube {
    fn level(self) -> u32 {
        CELLS.ilog2() - self.edge.ilog2()
    }

    fn path(self) -> i64 {
        let unit = SIDE / CELLS;
        let mut path = 0;
        for (corner, shift) in self.corner.iter().zip([2, 1, 0]) {
            for bit in 0..16 {
                path |= i64::from((corner * unit) >> bit & 1) << (3 * bit + shift);
            }
        }
        path
    }

    /// Its corners, x slowest.
    fn corners(self) -> impl Iterator<Item = [u32; 3]> {
        (0..8).map(move |number: u32| {
            let mut at = self.corner;
            for (at, bit) in at.iter_mut().zip([2, 1, 0]) {
                *at += (number >> bit & 1) * self.edge;
            }
            at
        })
    }

    /// True if it touches a node of a lattice of so many cells.
    pub fn touches(self, node: [usize; 3], cells: usize) -> bool {
        let step = CELLS / cells as u32;
        node.iter().zip(self.corner).all(|(at, low)| {
            let at = *at as u32 * step;
            (low..=low + self.edge).contains(&at)
        })
    }
}

/// The content of a file.
pub struct Voxels {
    cubes: Vec<Cube>,
    pub paths: Vec<i64>,
    pub levels: Vec<i8>,
    pub table: Vec<f32>,
    /// 12 numbers a voxel.
    pub harmonics: Vec<f32>,
    pub degree: i64,
    pub center: [f64; 3],
    pub extent: f64,
    pub inside: f64,
    /// True for a PLY file whose voxels have one density in all corners.
    forgets_corners: bool,
}

impl Voxels {
    /// A ball of voxels of three sizes, some of the smallest left out.
    pub fn small() -> Self {
        let mut cubes = Vec::new();
        let full = |edge: u32, corner: [u32; 3]| {
            let away = corner.map(|at| f64::from(at) + 0.5 * f64::from(edge) - 8.0);
            away.iter().map(|at| at * at).sum::<f64>() < 36.0
        };
        for big in grid(4) {
            let corner = big.map(|at| 4 * at);
            if big[0] == 1 && full(4, corner) {
                cubes.push(Cube { corner, edge: 4 });
                continue;
            }
            for middle in grid(2).map(|at| [0, 1, 2].map(|axis| corner[axis] + 2 * at[axis])) {
                if middle[2] >= 8 && full(2, middle) {
                    cubes.push(Cube { corner: middle, edge: 2 });
                    continue;
                }
                let smallest = grid(2).map(|at| [0, 1, 2].map(|axis| middle[axis] + at[axis]));
                let kept =
                    smallest.filter(|at| full(1, *at) && (at[0] + at[1] * 3 + at[2]) % 5 != 0);
                cubes.extend(kept.map(|corner| Cube { corner, edge: 1 }));
            }
        }
        // Voxels come in any order.
        let count = cubes.len();
        let cubes: Vec<Cube> = (0..count).map(|at| cubes[at * 7 % count]).collect();
        let numbers = distinct(&cubes);
        let raw = |[x, y, z]: &[u32; 3]| {
            let away = [x, y, z].map(|at| f64::from(*at) - 8.0);
            let radius = away.iter().map(|at| at * at).sum::<f64>().sqrt();
            (3.0 - 1.5 * (radius - 3.0).max(0.0)) as f32
        };
        let table = numbers.keys().map(raw).collect();
        let harmonics = (0..12 * count).map(|at| ((at * 37 % 101) as f32 - 50.0) / 60.0).collect();
        Self {
            paths: cubes.iter().map(|cube| cube.path()).collect(),
            levels: cubes.iter().map(|cube| cube.level() as i8).collect(),
            cubes,
            table,
            harmonics,
            degree: 1,
            center: [0.0; 3],
            extent: 8.0,
            inside: 8.0,
            forgets_corners: false,
        }
    }

    pub fn cubes(&self) -> &[Cube] {
        &self.cubes
    }

    /// The same raw density at all corners.
    pub fn even(&mut self, raw: f32) {
        self.table.fill(raw);
    }

    /// Colours of band 0 alone.
    pub fn paint(&mut self, color: impl Fn(usize) -> [f32; 3]) {
        for (voxel, row) in self.harmonics.chunks_exact_mut(12).enumerate() {
            row.fill(0.0);
            row[..3].copy_from_slice(&color(voxel));
        }
    }

    pub fn forget_corners(&mut self) {
        self.forgets_corners = true;
    }

    /// The share of a node's cell that voxels fill, around a node of a lattice of so many cells which
    /// has voxels smaller than cells around it.
    pub fn share_around(&self, node: [usize; 3], cells: u32) -> Option<f64> {
        let step = CELLS / cells;
        let mut share = 0.0;
        let mut has_small = false;
        for cube in &self.cubes {
            // Half a cell on either side of the node.
            let overlap = node.iter().zip(cube.corner).map(|(at, low)| {
                let at = f64::from(*at as u32 * step);
                let half = 0.5 * f64::from(step);
                let (low, high) = (f64::from(low), f64::from(low + cube.edge));
                (high.min(at + half) - low.max(at - half)).max(0.0)
            });
            let volume: f64 = overlap.product();
            share += volume / f64::from(step).powi(3);
            has_small |= volume > 0.0 && cube.edge < step;
        }
        has_small.then_some(share)
    }

    /// A file as SVRaster writes it.
    pub fn checkpoint(&self) -> TorchFile {
        let count = self.cubes.len();
        let mut file = TorchFile::default();
        file.push("active_sh_degree", Item::Int(self.degree));
        file.push("scene_center", Item::Numbers(self.center.to_vec()));
        file.push("inside_extent", Item::Number(self.inside));
        file.push("scene_extent", Item::Number(self.extent));
        file.push("octpath", Item::Longs(vec![count, 1], self.paths.clone()));
        file.push("octlevel", Item::Signed(vec![count, 1], self.levels.clone()));
        file.push("_geo_grid_pts", Item::Floats(vec![self.table.len(), 1], self.table.clone()));
        let rows = self.harmonics.chunks_exact(12);
        let first = rows.clone().flat_map(|row| &row[..3]).copied().collect();
        let rest = rows.flat_map(|row| &row[3..]).copied().collect();
        file.push("_sh0", Item::Floats(vec![count, 3], first));
        file.push("_shs", Item::Floats(vec![count, 3, 3], rest));
        file
    }

    /// The same as svraster-webgl's converter writes it.
    pub fn ply(&self) -> Vec<u8> {
        let mut header = format!(
            "ply\nformat binary_little_endian 1.0\ncomment scene_center {} {} {}\ncomment \
             scene_extent {}\ncomment active_sh_degree {}\nelement vertex {}\n",
            self.center[0],
            self.center[1],
            self.center[2],
            self.extent,
            self.degree,
            self.cubes.len()
        );
        let floats = |names: &mut dyn Iterator<Item = String>| -> String {
            names.map(|name| format!("property float {name}\n")).collect()
        };
        header += &floats(&mut ["x", "y", "z"].map(str::to_owned).into_iter());
        header += "property uint octpath\nproperty uchar octlevel\n";
        header += &floats(&mut (0..3).map(|at| format!("f_dc_{at}")));
        header += &floats(&mut (0..9).map(|at| format!("f_rest_{at}")));
        header += &floats(&mut (0..8).map(|at| format!("grid{at}_value")));
        header += "end_header\n";
        let mut bytes = header.into_bytes();
        let numbers = distinct(&self.cubes);
        for (voxel, cube) in self.cubes.iter().enumerate() {
            let edge = self.extent / f64::from(CELLS);
            for (low, center) in cube.corner.iter().zip(self.center) {
                let middle = f64::from(*low) + 0.5 * f64::from(cube.edge) - 0.5 * f64::from(CELLS);
                bytes.extend(((center + middle * edge) as f32).to_le_bytes());
            }
            bytes.extend((self.paths[voxel] as u32).to_le_bytes());
            bytes.push(self.levels[voxel] as u8);
            let row = &self.harmonics[12 * voxel..12 * voxel + 12];
            let corners = cube.corners().map(|corner| self.table[numbers[&corner]]);
            let corners: Vec<f32> = match self.forgets_corners {
                true => vec![corners.last().expect("a corner"); 8],
                false => corners.collect(),
            };
            let values = row.iter().copied().chain(corners);
            bytes.extend(values.flat_map(f32::to_le_bytes));
        }
        bytes
    }
}

/// The numbers of distinct corners, by x, y and z.
fn distinct(cubes: &[Cube]) -> BTreeMap<[u32; 3], usize> {
    let mut numbers: BTreeMap<[u32; 3], usize> =
        cubes.iter().flat_map(|cube| cube.corners()).map(|corner| (corner, 0)).collect();
    numbers.values_mut().zip(0..).for_each(|(number, at)| *number = at);
    numbers
}

fn grid(side: u32) -> impl Iterator<Item = [u32; 3]> {
    (0..side.pow(3)).map(move |at| [at / side / side, at / side % side, at % side])
}
