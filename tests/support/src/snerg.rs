//! A small SNeRG folder, written from the description of the format alone, and its viewer's rays in
//! float64.

use std::path::Path;

use mipvog::picture;
use serde_json::{Value, json};

use super::Random;

/// Voxels of a block, and texels with the apron.
const BLOCK: usize = 6;
const EDGE: usize = 8;
/// Blocks of the atlas along its axes.
const ATLAS: [usize; 3] = [3, 2, 2];

/// A dense scene: for each voxel, x fastest, the bytes of a texel.
pub struct SmallSnerg {
    pub grid: [usize; 3],
    pub min: [f64; 3],
    pub voxel_size: f64,
    pub texels: Vec<[u8; 8]>,
    pub layers: Layers,
}

/// Weights `[inputs][outputs]`, and biases, of each layer.
pub type Layers = Vec<(Vec<Vec<f64>>, Vec<f64>)>;

/// Random layers of a folder's network.
pub fn layers() -> Layers {
    let mut random = Random::new(77);
    let mut layer = |inputs: usize, outputs: usize| {
        let mut number = || f64::from(random.between(-0.6, 0.6));
        let weights = (0..inputs).map(|_| (0..outputs).map(|_| number()).collect()).collect();
        (weights, (0..outputs).map(|_| number()).collect())
    };
    vec![layer(34, 16), layer(16, 16), layer(16, 3)]
}

/// The network, with waves of the direction in the folder's order, and with the values before the
/// direction or behind it.
pub fn network(
    layers: &Layers,
    direction: [f64; 3],
    values: &[f64],
    values_first: bool,
) -> [f64; 3] {
    let mut inputs = direction.to_vec();
    for wave in [f64::sin, f64::cos] {
        for octave in [1.0, 2.0, 4.0, 8.0] {
            inputs.extend(direction.map(|value| wave(octave * value)));
        }
    }
    let values = values.iter().map(|v| if v.abs() < 0.1 / 255.0 { 0.0 } else { *v });
    match values_first {
        true => drop(inputs.splice(0..0, values)),
        false => inputs.extend(values),
    }
    for (number, (weights, bias)) in layers.iter().enumerate() {
        let sum = |output: usize| {
            let terms = inputs.iter().zip(weights).map(|(value, row)| value * row[output]);
            terms.sum::<f64>() + bias[output]
        };
        let activate = |v: f64| if number == 2 { 1.0 / (1.0 + (-v).exp()) } else { v.max(0.0) };
        inputs = (0..bias.len()).map(|output| activate(sum(output))).collect();
    }
    [inputs[0], inputs[1], inputs[2]]
}

/// A ball with a soft surface and smooth colours.
pub fn small_snerg() -> SmallSnerg {
    let grid = [13, 10, 8];
    let mut texels = Vec::new();
    for z in 0..grid[2] {
        for y in 0..grid[1] {
            for x in 0..grid[0] {
                let at = [x, y, z].map(|at| at as f64);
                let away = (at[0] - 4.2).powi(2) + (at[1] - 5.1).powi(2) + (at[2] - 3.4).powi(2);
                let alpha = (3.4 - away.sqrt()).clamp(0.0, 0.9);
                let alpha = if alpha < 0.01 { 0.0 } else { alpha };
                let values = [0.1, 0.5, 0.9, 0.2, 0.4, 0.6, 0.8];
                let value = |i: usize| values[i] * (0.6 + 0.4 * (0.5 * at[i % 3]).sin());
                let byte = |value: f64| (255.0 * value).round() as u8;
                texels.push([
                    byte(alpha * value(0)),
                    byte(alpha * value(1)),
                    byte(alpha * value(2)),
                    byte(alpha),
                    byte(alpha * value(3)),
                    byte(alpha * value(4)),
                    byte(alpha * value(5)),
                    byte(alpha * value(6)),
                ]);
            }
        }
    }
    SmallSnerg { grid, min: [-0.7, 0.2, -0.4], voxel_size: 0.11, texels, layers: layers() }
}

impl SmallSnerg {
    fn texel(&self, at: [i64; 3]) -> [u8; 8] {
        let [x, y, z] = self.grid.map(|size| size as i64);
        let inside = (0..x).contains(&at[0]) && (0..y).contains(&at[1]) && (0..z).contains(&at[2]);
        let at = (at[2] * y + at[1]) * x + at[0];
        if inside { self.texels[at as usize] } else { [0; 8] }
    }

    fn blocks(&self) -> [usize; 3] {
        self.grid.map(|size| size.div_ceil(BLOCK))
    }

    /// A texel of a block with its apron.
    fn of_block(&self, block: [usize; 3], local: [usize; 3]) -> [u8; 8] {
        self.texel([0, 1, 2].map(|a| (block[a] * BLOCK + local[a]) as i64 - 1))
    }

    fn is_full(&self, block: [usize; 3]) -> bool {
        (0..EDGE.pow(3))
            .any(|at| self.of_block(block, [at % EDGE, at / EDGE % EDGE, at / EDGE / EDGE])[3] > 0)
    }

    /// The parameters, as the exporter writes them.
    pub fn parameters(&self) -> Value {
        let atlas = ATLAS.map(|count| count * EDGE);
        let mut text = json!({
            "voxel_size": self.voxel_size, "block_size": BLOCK,
            "grid_width": self.grid[0], "grid_height": self.grid[1], "grid_depth": self.grid[2],
            "atlas_width": atlas[0], "atlas_height": atlas[1], "atlas_depth": atlas[2],
            "num_slices": atlas[2] / 4,
            "min_x": self.min[0], "min_y": self.min[1], "min_z": self.min[2],
            "atlas_blocks_x": ATLAS[0], "atlas_blocks_y": ATLAS[1], "atlas_blocks_z": ATLAS[2],
            "worldspace_T_opengl": [[-1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]],
            "ndc": false, "format": "png",
        });
        for (number, (weights, bias)) in self.layers.iter().enumerate() {
            text[format!("{number}_weights")] = json!(weights);
            text[format!("{number}_bias")] = json!(bias);
        }
        text
    }

    /// Writes the folder.
    pub fn write(&self, folder: &Path) {
        let put = |name: &str, bytes: &[u8]| {
            std::fs::write(folder.join(name), bytes).expect("writable");
        };
        put("scene_params.json", self.parameters().to_string().as_bytes());
        let [bx, by, bz] = self.blocks();
        let [width, height, depth] = ATLAS.map(|count| count * EDGE);
        let mut atlas = vec![[0u8; 8]; width * height * depth];
        let (mut indices, mut count) = (Vec::new(), 0);
        for at in 0..bx * by * bz {
            let block = [at % bx, at / bx % by, at / bx / by];
            if !self.is_full(block) {
                indices.extend([255; 3]);
                continue;
            }
            let place =
                [count % ATLAS[0], count / ATLAS[0] % ATLAS[1], count / ATLAS[0] / ATLAS[1]];
            count += 1;
            indices.extend(place.map(|at| at as u8));
            for local in 0..EDGE.pow(3) {
                let local = [local % EDGE, local / EDGE % EDGE, local / EDGE / EDGE];
                let [x, y, z] = [0, 1, 2].map(|axis| place[axis] * EDGE + local[axis]);
                atlas[(z * height + y) * width + x] = self.of_block(block, local);
            }
        }
        assert!(count > 4 && count < bx * by * bz && count <= 12, "{count} blocks");
        put("atlas_indices.png", &picture::png(bx, by * bz, &indices).expect("a PNG"));
        for (slice, planes) in atlas.chunks_exact(4 * width * height).enumerate() {
            for (kind, from) in [("rgba", 0), ("feature", 4)] {
                let bytes: Vec<u8> =
                    planes.iter().flat_map(|t| t[from..from + 4].to_vec()).collect();
                let bytes = picture::png(width, 4 * height, &bytes).expect("a PNG");
                put(&format!("{kind}_{slice:03}.png"), &bytes);
            }
        }
    }

    /// Interpolated values at a position in voxels, 0 to 1.
    fn values(&self, at: [f64; 3]) -> [f64; 8] {
        let mut sums = [0.0; 8];
        for corner in 0..8 {
            let (mut weight, mut voxel) = (1.0 / 255.0, [0; 3]);
            for axis in 0..3 {
                let low = (at[axis] - 0.5).floor();
                let up = corner >> axis & 1;
                let share = at[axis] - 0.5 - low;
                weight *= if up == 1 { share } else { 1.0 - share };
                voxel[axis] = low as i64 + i64::from(up);
            }
            let texel = self.texel(voxel);
            (0..8).for_each(|i| sums[i] += weight * f64::from(texel[i]));
        }
        sums
    }

    /// Colour over white and transmittance of a ray of the world, as the viewer computes them.
    pub fn ray(&self, origin: [f64; 3], direction: [f64; 3]) -> ([f64; 3], f64) {
        let gl = |v: [f64; 3]| [-v[0], v[2], v[1]];
        let from = gl(origin);
        let o = [0, 1, 2].map(|axis| (from[axis] - self.min[axis]) / self.voxel_size);
        let d = gl(direction);
        let span = |low: [f64; 3], high: [f64; 3]| {
            let (mut enters, mut leaves) = (f64::NEG_INFINITY, f64::INFINITY);
            for axis in 0..3 {
                let (a, b) = ((low[axis] - o[axis]) / d[axis], (high[axis] - o[axis]) / d[axis]);
                (enters, leaves) = (enters.max(a.min(b)), leaves.min(a.max(b)));
            }
            (enters, leaves)
        };
        let size = self.grid.map(|count| count as f64);
        let (enters, leaves) = span([0.0; 3], size);
        let (mut t, mut visible, mut sums) = (enters.max(0.0) + 0.5, 1.0, [0.0; 7]);
        let most = size.iter().map(|v| v * v).sum::<f64>().sqrt().ceil() as usize;
        for _ in 0..most {
            if visible <= 1.0 / 255.0 || t >= leaves {
                break;
            }
            let at = [0, 1, 2].map(|axis| o[axis] + t * d[axis]);
            let block = at.map(|v| (v / BLOCK as f64).floor() as usize);
            if !self.is_full(block) {
                let low = block.map(|v| (v * BLOCK) as f64);
                t = span(low, low.map(|v| v + BLOCK as f64)).1 + 0.5;
                continue;
            }
            // The mean of 4 x 4 x 4 texels of the atlas.
            let texel = [0, 1, 2].map(|a| (at[a] - (block[a] * BLOCK) as f64) as usize + 1);
            let sum: u32 = (0..64)
                .map(|i| {
                    let local = [0, 1, 2].map(|axis| texel[axis] / 4 * 4 + (i >> (2 * axis) & 3));
                    u32::from(self.of_block(block, local)[3])
                })
                .sum();
            let [r, g, b, alpha, f0, f1, f2, f3] = self.values(at);
            if sum >= 32 && alpha > 0.5 / 255.0 {
                for (sum, value) in sums.iter_mut().zip([r, g, b, f0, f1, f2, f3]) {
                    *sum += visible * value;
                }
                visible *= 1.0 - alpha;
            }
            t += 1.0;
        }
        (0..3).for_each(|channel| sums[channel] += visible);
        let mut color = [sums[0], sums[1], sums[2]];
        if visible <= 254.0 / 255.0 {
            let added = network(&self.layers, direction, &sums, false);
            (0..3).for_each(|channel| color[channel] += added[channel]);
        }
        (color, visible)
    }

    /// The middle of a voxel in the world.
    pub fn middle(&self, voxel: [usize; 3]) -> [f64; 3] {
        let [x, y, z] = [0, 1, 2].map(|a| self.min[a] + (voxel[a] as f64 + 0.5) * self.voxel_size);
        [-x, z, y]
    }
}
