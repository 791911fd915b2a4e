//! A small MERF folder, written from the description of the format alone, and its viewer's rays in
//! float64.

use std::path::Path;

use mipvog::picture;
use serde_json::{Value, json};

use super::snerg::{Layers, layers, network};

/// Voxels of the sparse grid and of the planes, along each axis of contracted space.
const GRID: usize = 32;
const PLANES: usize = 64;
const BLOCK: usize = 8;
/// Blocks of the atlas along its axes.
const ATLAS: [usize; 3] = [4, 4, 3];
const CELLS: [usize; 5] = [128, 64, 32, 16, 8];

/// Codes of a colour, the density and features.
type Texel = [u8; 8];

pub struct SmallMerf {
    /// Of the sparse grid, x fastest.
    grid: Vec<Texel>,
    /// Of each plane, row by row.
    planes: [Vec<Texel>; 3],
    pub layers: Layers,
}

fn code(value: f64, reach: f64) -> u8 {
    (255.0 * (value + reach) / (2.0 * reach)).round().clamp(0.0, 255.0) as u8
}

/// A soft ball in the core, with a wall of smooth colours; and something beyond the core.
pub fn small_merf() -> SmallMerf {
    let middle = |at: usize, count: usize| -2.0 + 4.0 * (at as f64 + 0.5) / count as f64;
    let mut grid = Vec::new();
    for z in 0..GRID {
        for y in 0..GRID {
            for x in 0..GRID {
                let [x, y, z] = [x, y, z].map(|at| middle(at, GRID));
                let away = ((x - 0.1).powi(2) + (y + 0.2).powi(2) + z.powi(2)).sqrt();
                let beyond = ((x - 1.5).powi(2) + y.powi(2) + z.powi(2)).sqrt();
                let density = (8.0 * (0.7 - away)).max(8.0 * (0.3 - beyond));
                let waves = [3.0 * x, 2.0 * y, x + z, 4.0 * z, x - y, 2.0 * z, y + 1.0];
                let value = |i: usize| code(2.0 * f64::sin(waves[i]), 7.0);
                let density = code((2.0 * density).clamp(-6.0, 5.0), 14.0);
                grid.push([
                    value(0),
                    value(1),
                    value(2),
                    density,
                    value(3),
                    value(4),
                    value(5),
                    value(6),
                ]);
            }
        }
    }
    let planes = [0.0, 1.0, 2.0].map(|phase| {
        let texels = (0..PLANES * PLANES).map(|at| {
            let [a, b] = [at % PLANES, at / PLANES].map(|at| middle(at, PLANES));
            let value = |i: f64| f64::sin(3.0 * a + phase + i) + f64::cos(5.0 * b - i);
            let own = |i: u8| code(0.5 * value(f64::from(i)), 7.0);
            [own(0), own(1), own(2), code(0.4 * value(9.0), 14.0), own(3), own(4), own(5), own(6)]
        });
        texels.collect()
    });
    SmallMerf { grid, planes, layers: layers() }
}

impl SmallMerf {
    fn texel(&self, at: [usize; 3]) -> Texel {
        let [x, y, z] = at.map(|at| at.min(GRID - 1));
        self.grid[(z * GRID + y) * GRID + x]
    }

    /// A texel of a block; the last one along an axis is the next block's first.
    fn of_block(&self, block: [usize; 3], local: [usize; 3]) -> Texel {
        self.texel([0, 1, 2].map(|axis| block[axis] * BLOCK + local[axis]))
    }

    /// Blocks that show something.
    fn is_full(&self, block: [usize; 3]) -> bool {
        let edge = BLOCK + 1;
        (0..edge.pow(3)).any(|at| {
            let local = [at % edge, at / edge % edge, at / edge / edge];
            self.of_block(block, local)[3] > code(-5.0, 14.0)
        })
    }

    /// Cells of voxels of the planes that may be occupied.
    fn is_occupied(&self, cell: usize, at: [usize; 3]) -> bool {
        let finest = cell / 8;
        let count = PLANES / 8;
        (0..finest.pow(3)).any(|i| {
            let own = [i % finest, i / finest % finest, i / finest / finest];
            let own = [0, 1, 2].map(|axis| at[axis] * finest + own[axis]);
            // 8 voxels of the planes are 4 of the grid.
            own.iter().all(|at| *at < count)
                && (0..64).any(|i| {
                    let voxel = [0, 1, 2].map(|axis| 4 * own[axis] + (i >> (2 * axis) & 3));
                    self.texel(voxel)[3] > code(-5.5, 14.0)
                })
        })
    }

    /// The parameters, by the names of the release or of the demonstration.
    pub fn parameters(&self, release: bool) -> Value {
        let atlas = ATLAS.map(|count| count * (BLOCK + 1));
        let mut text = json!({
            "atlas_width": atlas[0], "atlas_height": atlas[1], "atlas_depth": atlas[2],
            "num_slices": atlas[2], "slice_depth": 1,
        });
        let own = match release {
            true => json!({
                "triplane_resolution": PLANES, "triplane_voxel_size": 4.0 / PLANES as f64,
                "sparse_grid_resolution": GRID, "sparse_grid_voxel_size": 4.0 / GRID as f64,
                "data_block_size": BLOCK, "range_features": [-7, 7], "range_density": [-14, 14],
            }),
            false => json!({
                "voxel_size": 4.0 / GRID as f64, "block_size": BLOCK,
                "grid_width": GRID, "grid_height": GRID, "grid_depth": GRID,
                "voxel_size_triplane": 4.0 / PLANES as f64,
                "plane_width_0": PLANES, "plane_height_0": PLANES,
                "min_x": -2, "min_y": -2, "min_z": -2, "ndc": false, "format": "png",
                "worldspace_T_opengl": [[-1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]],
            }),
        };
        for (key, value) in own.as_object().expect("an object") {
            text[key] = value.clone();
        }
        for (number, (weights, bias)) in self.layers.iter().enumerate() {
            text[format!("{number}_weights")] = json!(weights);
            text[format!("{number}_bias")] = json!(bias);
        }
        text
    }

    /// Writes the folder.
    pub fn write(&self, folder: &Path, release: bool) {
        let put = |name: &str, bytes: &[u8]| {
            std::fs::write(folder.join(name), bytes).expect("writable");
        };
        let png =
            |size: [usize; 2], bytes: &[u8]| picture::png(size[0], size[1], bytes).expect("a PNG");
        put("scene_params.json", self.parameters(release).to_string().as_bytes());
        let halves = |texels: &[Texel]| -> [Vec<u8>; 2] {
            [0, 4].map(|from| texels.iter().flat_map(|t| t[from..from + 4].to_vec()).collect())
        };
        for (number, texels) in self.planes.iter().enumerate() {
            let [colors, features] = halves(texels);
            put(&format!("plane_rgb_and_density_{number}.png"), &png([PLANES; 2], &colors));
            put(&format!("plane_features_{number}.png"), &png([PLANES; 2], &features));
        }
        for cell in CELLS {
            let count = PLANES.div_ceil(cell);
            let full = (0..count.pow(3)).flat_map(|at| {
                let at = [at % count, at / count % count, at / count / count];
                [255 * u8::from(self.is_occupied(cell, at)); 4]
            });
            let bytes: Vec<u8> = full.collect();
            put(&format!("occupancy_grid_{cell}.png"), &png([count, count * count], &bytes));
        }
        let (edge, count) = (BLOCK + 1, GRID / BLOCK);
        let [width, height, depth] = ATLAS.map(|count| count * edge);
        let mut atlas = vec![[0u8; 8]; width * height * depth];
        let (mut indices, mut full) = (Vec::new(), 0);
        for at in 0..count.pow(3) {
            let block = [at % count, at / count % count, at / count / count];
            if !self.is_full(block) {
                indices.extend([255; 3]);
                continue;
            }
            let place = [full % ATLAS[0], full / ATLAS[0] % ATLAS[1], full / ATLAS[0] / ATLAS[1]];
            full += 1;
            indices.extend(place.map(|at| at as u8));
            for local in 0..edge.pow(3) {
                let local = [local % edge, local / edge % edge, local / edge / edge];
                let [x, y, z] = [0, 1, 2].map(|axis| place[axis] * edge + local[axis]);
                atlas[(z * height + y) * width + x] = self.of_block(block, local);
            }
        }
        assert!(full > 8 && full <= 48, "{full} blocks of {}", count.pow(3));
        let name = if release { "sparse_grid_block_indices.png" } else { "atlas_indices.png" };
        put(name, &png([count, count * count], &indices));
        let names = match release {
            true => ["sparse_grid_rgb_and_density", "sparse_grid_features"],
            false => ["rgba", "feature"],
        };
        for (z, plane) in atlas.chunks_exact(width * height).enumerate() {
            for (name, bytes) in names.into_iter().zip(halves(plane)) {
                put(&format!("{name}_{z:03}.png"), &png([width, height], &bytes));
            }
        }
    }

    /// Sums at a position of contracted space; none without a block.
    fn sums(&self, at: [f64; 3]) -> Option<[f64; 8]> {
        let decode = |sums: [f64; 8], parts: f64| {
            let mut out = [0.0; 8];
            for i in 0..8 {
                let reach = if i == 3 { 14.0 } else { 7.0 };
                out[i] = -reach * parts + sums[i] / 255.0 * 2.0 * reach;
            }
            out
        };
        let own = at.map(|at| (at + 2.0) * GRID as f64 / 4.0 - 0.5);
        let block = own.map(|at| (at / BLOCK as f64).floor() as usize);
        if !self.is_full(block) {
            return None;
        }
        let mut codes = [0.0; 8];
        for corner in 0..8 {
            let (mut weight, mut voxel) = (1.0, [0; 3]);
            for axis in 0..3 {
                let (low, up) = (own[axis].floor(), corner >> axis & 1);
                weight *= if up == 1 { own[axis] - low } else { 1.0 - (own[axis] - low) };
                voxel[axis] = low as usize + up;
            }
            let texel = self.texel(voxel);
            (0..8).for_each(|i| codes[i] += weight * f64::from(texel[i]));
        }
        for (plane, [a, b]) in self.planes.iter().zip([[1, 2], [0, 2], [0, 1]]) {
            let [a, b] = [a, b].map(|axis| (at[axis] + 2.0) * PLANES as f64 / 4.0 - 0.5);
            for corner in 0..4 {
                let (column, row) =
                    (a.floor() + f64::from(corner & 1), b.floor() + f64::from(corner >> 1));
                let weight = (1.0 - (a - column).abs()) * (1.0 - (b - row).abs());
                let texel = plane[row as usize * PLANES + column as usize];
                (0..8).for_each(|i| codes[i] += weight * f64::from(texel[i]));
            }
        }
        Some(decode(codes, 4.0))
    }

    /// Density per world unit at a position of the world.
    pub fn density(&self, world: [f64; 3]) -> f64 {
        let at = [-world[0], world[2], world[1]];
        let cell = at.map(|at| ((at + 2.0) / (4.0 / PLANES as f64 * 8.0)) as usize);
        match self.is_occupied(8, cell) {
            true => self.sums(at).map_or(0.0, |sums| (sums[3] - 1.0).exp()),
            false => 0.0,
        }
    }

    /// Colour over white and transmittance of a ray of the world through the core.
    pub fn ray(&self, origin: [f64; 3], direction: [f64; 3]) -> ([f64; 3], f64) {
        let gl = |v: [f64; 3]| [-v[0], v[2], v[1]];
        let (o, d) = (gl(origin), gl(direction));
        let span = |low: [f64; 3], high: [f64; 3]| {
            let (mut enters, mut leaves) = (f64::NEG_INFINITY, f64::INFINITY);
            for axis in 0..3 {
                let (a, b) = ((low[axis] - o[axis]) / d[axis], (high[axis] - o[axis]) / d[axis]);
                (enters, leaves) = (enters.max(a.min(b)), leaves.min(a.max(b)));
            }
            (enters, leaves)
        };
        let step = 4.0 / PLANES as f64;
        let (enters, leaves) = span([-1.0; 3], [1.0; 3]);
        let (mut t, mut visible, mut sums) = (enters.max(0.0), 1.0, [0.0; 7]);
        let most = (2f64.sqrt() * PLANES as f64).ceil() as usize;
        'steps: for _ in 0..most {
            if visible <= 1.0 / 255.0 || t > leaves {
                break;
            }
            let at = [0, 1, 2].map(|axis| o[axis] + t * d[axis]);
            for cell in CELLS {
                let edge = step * cell as f64;
                let number = at.map(|at| ((at + 2.0) / edge).floor());
                if !self.is_occupied(cell, number.map(|at| at as usize)) {
                    let low = number.map(|at| at * edge - 2.0);
                    t = span(low, low.map(|at| at + edge)).1.max(t) + 0.5 * step;
                    continue 'steps;
                }
            }
            if let Some(values) = self.sums(at) {
                let alpha = 1.0 - (-(values[3] - 1.0).exp() * step.min(leaves - t)).exp();
                if alpha > 0.5 / 255.0 {
                    for (sum, value) in sums.iter_mut().zip([0, 1, 2, 4, 5, 6, 7]) {
                        *sum += visible * alpha / (1.0 + (-values[value]).exp());
                    }
                    visible *= 1.0 - alpha;
                }
            }
            t += step;
        }
        (0..3).for_each(|channel| sums[channel] += visible);
        let added = network(&self.layers, direction, &sums, true);
        ([0, 1, 2].map(|channel| sums[channel] + added[channel]), visible)
    }
}
