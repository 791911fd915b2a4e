//! A small model of Instant-NGP and of torch-ngp, written from the description of the formats alone,
//! and its rules in float64.

use half::f16;

use super::Random;
use super::msgpack::Pack;

/// A level: scale, nodes along an axis, entries.
#[derive(Clone, Copy, Debug)]
pub struct Level {
    scale: f64,
    size: u64,
    entries: u64,
}

pub const LEVELS: usize = 4;
pub const FEATURES: usize = 4;
/// Cells along an edge.
pub const CELLS: usize = 16;

/// A model.
#[derive(Clone)]
pub struct SmallNgp {
    pub levels: Vec<Level>,
    /// Entries by level, features of an entry side by side.
    pub table: Vec<f32>,
    /// `[outputs][inputs]`, layer by layer.
    pub density: Vec<Vec<Vec<f32>>>,
    pub color: Vec<Vec<Vec<f32>>>,
    pub occupied: Vec<bool>,
    /// Cells of the cubes around the first one.
    pub around: Vec<Vec<bool>>,
    /// The table spans so many unit cubes along an edge.
    pub bound: f64,
    /// Of torch-ngp: nodes along an axis more, other inputs, another unit.
    pub is_torch: bool,
}

/// Cells in Morton order: bits of x, y, z from the lowest one on.
fn morton(cell: [usize; 3]) -> usize {
    (0..8)
        .map(|bit| {
            let of = |axis: usize| (cell[axis] >> bit & 1) << (3 * bit + axis);
            of(0) + of(1) + of(2)
        })
        .sum()
}

/// A model whose levels grow by a ratio, with a ball of occupied cells, `cells` along an edge.
pub fn small_ngp(ratio: f64, is_torch: bool, cells: usize, seed: u64) -> SmallNgp {
    let more = u64::from(is_torch);
    let base: f32 = if is_torch { 16.0 } else { 4.0 };
    let levels: Vec<Level> = (0..LEVELS)
        .map(|level| {
            // Both programs compute scales in float32.
            let log2 = if is_torch { ratio.log2() as f32 } else { libm::log2f(ratio as f32) };
            let scale = f64::from(libm::exp2f(level as f32 * log2) * base - 1.0);
            let size = scale.ceil() as u64 + 1 + more;
            let most = if is_torch { 8192 } else { 256 };
            Level { scale, size, entries: size.pow(3).next_multiple_of(8).min(most) }
        })
        .collect();
    let entries: u64 = levels.iter().map(|level| level.entries).sum();
    let mut random = Random::new(seed);
    let table = (0..entries as usize * FEATURES).map(|_| random.between(-0.4, 0.4)).collect();
    let mut matrix = |outputs: usize, inputs: usize| -> Vec<Vec<f32>> {
        let mut row = || (0..inputs).map(|_| random.between(-0.35, 0.35)).collect();
        (0..outputs).map(|_| row()).collect()
    };
    let width = LEVELS * FEATURES;
    let mut density = vec![matrix(32, width), matrix(16, 32)];
    // Denser than a random network is.
    density[1][0].iter_mut().for_each(|weight| *weight = 2.0 * weight.abs() + 0.5);
    let color = match is_torch {
        true => vec![matrix(32, 31), matrix(32, 32), matrix(3, 32)],
        false => vec![matrix(32, 32), matrix(32, 32), matrix(16, 32)],
    };
    let mut occupied = vec![false; cells.pow(3)];
    for cell in 0..cells.pow(3) {
        let at = [cell % cells, cell / cells % cells, cell / cells / cells];
        let away = |axis: usize| (at[axis] as f64 + 0.5) / cells as f64 - [0.4, 0.5, 0.65][axis];
        let far = (0..3).map(|axis| away(axis).powi(2)).sum::<f64>().sqrt();
        occupied[morton(at)] = far < 0.27;
    }
    SmallNgp { levels, table, density, color, occupied, around: Vec::new(), bound: 1.0, is_torch }
}

/// A model of torch-ngp in a box from -`bound` to `bound`, of at most 4, with patches of occupied
/// cells in all of its cubes.
pub fn large_torch_ngp(bound: f64, seed: u64) -> SmallNgp {
    let mut model = small_ngp((2048.0 * bound / 16.0).powf(1.0 / 3.0), true, 128, seed);
    let cubes = if bound > 2.0 { 2 } else { 1 };
    for cube in 0..=cubes {
        let is_full = |cell: usize| {
            let at = [cell % 128, cell / 128 % 128, cell / 128 / 128];
            (at[0] / 16 + at[1] / 16 + at[2] / 16 + cube).is_multiple_of(3)
        };
        let mut cells = vec![false; 128usize.pow(3)];
        for cell in 0..cells.len() {
            cells[morton([cell % 128, cell / 128 % 128, cell / 128 / 128])] = is_full(cell);
        }
        match cube {
            0 => model.occupied = cells,
            _ => model.around.push(cells),
        }
    }
    // Thin, so that rays come far.
    model.density[1][0].iter_mut().for_each(|weight| *weight *= 0.1);
    SmallNgp { bound, ..model }
}

impl Level {
    pub fn entries(&self) -> u64 {
        self.entries
    }
}

impl SmallNgp {
    fn side(&self) -> usize {
        (self.occupied.len() as f64).cbrt().round() as usize
    }

    /// All parameters in the order of a snapshot.
    pub fn parameters(&self) -> Vec<f32> {
        let matrices = self.density.iter().chain(&self.color).flatten().flatten();
        matrices.chain(&self.table).copied().collect()
    }

    /// Rounds all parameters to float16.
    pub fn halved(mut self) -> Self {
        let round = |value: &mut f32| *value = f16::from_f32(*value).to_f32();
        self.table.iter_mut().for_each(round);
        let matrices = self.density.iter_mut().chain(&mut self.color).flatten().flatten();
        matrices.for_each(round);
        self
    }

    /// A snapshot of Instant-NGP; the ratio is stated unless it follows from the configuration.
    pub fn snapshot(&self, ratio: Option<f64>, half: bool) -> Pack {
        use Pack::{Bool, Bytes, Float, Int, List, Map, Text};
        let parameters = self.parameters();
        let bytes: Vec<u8> = match half {
            true => parameters.iter().flat_map(|v| f16::from_f32(*v).to_le_bytes()).collect(),
            false => parameters.iter().flat_map(|v| v.to_le_bytes()).collect(),
        };
        let grid = self
            .occupied
            .iter()
            .flat_map(|&full| f16::from_f32(if full { 3.0 } else { 0.001 }).to_le_bytes());
        let network = |hidden: i64| {
            Map(vec![
                ("otype", Text("FullyFusedMLP")),
                ("activation", Text("ReLU")),
                ("output_activation", Text("None")),
                ("n_neurons", Int(32)),
                ("n_hidden_layers", Int(hidden)),
            ])
        };
        let mut encoding = vec![
            ("otype", Text("HashGrid")),
            ("n_levels", Int(LEVELS as i64)),
            ("n_features_per_level", Int(FEATURES as i64)),
            ("log2_hashmap_size", Int(8)),
            ("base_resolution", Int(4)),
        ];
        encoding.extend(ratio.map(|ratio| ("per_level_scale", Float(ratio))));
        let harmonics = Map(vec![
            ("n_dims_to_encode", Int(3)),
            ("otype", Text("SphericalHarmonics")),
            ("degree", Int(4)),
        ]);
        let identity = Map(vec![("otype", Text("Identity"))]);
        let dataset = Map(vec![
            ("scale", Float(0.33)),
            ("offset", List(vec![Float(0.5), Float(0.45), Float(0.55)])),
            ("from_mitsuba", Bool(false)),
            ("is_hdr", Bool(false)),
            ("n_extra_learnable_dims", Int(0)),
            ("xforms", List(vec![List(vec![Int(1); 4]); 3])),
        ]);
        let snapshot = Map(vec![
            ("version", Int(1)),
            ("mode", Text("nerf")),
            ("n_params", Int(parameters.len() as i64)),
            ("params_type", Text(if half { "__half" } else { "float" })),
            ("params_binary", Bytes(bytes)),
            ("density_grid_size", Int(self.side() as i64)),
            ("density_grid_binary", Bytes(grid.collect())),
            ("nerf", Map(vec![("aabb_scale", Int(1)), ("dataset", dataset)])),
        ]);
        Map(vec![
            ("encoding", Map(encoding)),
            ("network", network(1)),
            ("rgb_network", network(2)),
            ("dir_encoding", Map(vec![("nested", List(vec![harmonics, identity]))])),
            ("snapshot", snapshot),
        ])
    }

    fn encode(&self, at: [f64; 3]) -> Vec<f64> {
        let (mut features, mut first) = (Vec::new(), 0);
        for level in &self.levels {
            let at = at.map(|at| at * level.scale + 0.5);
            for feature in 0..FEATURES {
                let mut sum = 0.0;
                for corner in 0..8 {
                    let (mut weight, mut node) = (1.0, [0u64; 3]);
                    for axis in 0..3 {
                        let up = corner >> axis & 1;
                        let share = at[axis] - at[axis].floor();
                        weight *= if up == 1 { share } else { 1.0 - share };
                        node[axis] = at[axis].floor() as u64 + up;
                    }
                    let [x, y, z] = node;
                    let entry = if level.size.pow(3) <= level.entries {
                        x + y * level.size + z * level.size.pow(2)
                    } else {
                        let wrap = |v: u64| v & 0xffff_ffff;
                        x ^ wrap(y * 2_654_435_761) ^ wrap(z * 805_459_861)
                    };
                    let entry = (first + entry % level.entries) as usize;
                    sum += weight * f64::from(self.table[entry * FEATURES + feature]);
                }
                features.push(sum);
            }
            first += level.entries;
        }
        features
    }

    /// Optical depth of an edge of the unit cube, and colour, of a position of the cube.
    fn evaluate(&self, at: [f64; 3], direction: [f64; 3]) -> (f64, [f64; 3]) {
        let run = |layers: &[Vec<Vec<f32>>], mut values: Vec<f64>| {
            for (number, matrix) in layers.iter().enumerate() {
                let row = |row: &Vec<f32>| {
                    let sum: f64 = row.iter().zip(&values).map(|(w, v)| f64::from(*w) * v).sum();
                    if number + 1 == layers.len() { sum } else { sum.max(0.0) }
                };
                values = matrix.iter().map(row).collect();
            }
            values
        };
        let geometry = run(&self.density, self.encode(at.map(|at| (at - 0.5) / self.bound + 0.5)));
        let seen = harmonics(direction).to_vec();
        let inputs = match self.is_torch {
            true => [seen, geometry[1..].to_vec()].concat(),
            false => [geometry.clone(), seen].concat(),
        };
        let color = run(&self.color, inputs);
        let sigmoid = |value: f64| 1.0 / (1.0 + (-value).exp());
        let unit = if self.is_torch { 2.0 } else { 1.0 };
        (unit * geometry[0].exp(), [sigmoid(color[0]), sigmoid(color[1]), sigmoid(color[2])])
    }

    /// The cube's scale in the world of the training, and its offset along the world's axes.
    fn frame(&self) -> (f64, [f64; 3]) {
        match self.is_torch {
            true => (0.5 * f64::from(0.33f32), [0.5; 3]),
            false => (0.33, [0.5, 0.45, 0.55]),
        }
    }

    fn to_cube(&self, world: [f64; 3]) -> [f64; 3] {
        let (scale, offset) = self.frame();
        let at = |axis: usize| world[axis] * scale + offset[axis];
        [at(1), at(2), at(0)]
    }

    /// The world's position of one in the cube.
    pub fn to_world(&self, cube: [f64; 3]) -> [f64; 3] {
        let (scale, offset) = self.frame();
        let at = |axis: usize, value: f64| (value - offset[axis]) / scale;
        [at(0, cube[2]), at(1, cube[0]), at(2, cube[1])]
    }

    fn is_occupied(&self, at: [f64; 3]) -> bool {
        let side = self.side();
        at.iter().all(|at| (0.0..1.0).contains(at))
            && self.occupied[morton(at.map(|at| (at * side as f64) as usize))]
    }

    /// Of torch-ngp, in its own units: a position, and the step to the next sample.
    fn is_occupied_by_step(&self, at: [f64; 3], step: f64) -> bool {
        // The exponent that `frexp` gives, from 0 to that of the last cube.
        let last = self.around.len() as i32;
        let exponent = |value: f64| (value.log2().floor() as i32 + 1).clamp(0, last);
        let most = at.iter().fold(0.0f64, |most, at| most.max(at.abs()));
        let cube = exponent(most).max(exponent(step * 64.0));
        let half = 2f64.powi(cube).min(self.bound);
        let cell = at.map(|at| ((0.5 * (at / half + 1.0) * 128.0) as usize).min(127));
        match cube {
            0 => self.occupied[morton(cell)],
            cube => self.around[cube as usize - 1][morton(cell)],
        }
    }

    /// Colour over white and transmittance of a ray of torch-ngp's larger scenes.
    pub fn long_ray(&self, origin: [f64; 3], [x, y, z]: [f64; 3]) -> ([f64; 3], f64) {
        let (from, way) = (self.to_cube(origin).map(|at| 2.0 * at - 1.0), [y, z, x]);
        let (mut t, mut end) = (0.2f64, f64::INFINITY);
        for axis in 0..3 {
            let a = (-self.bound - from[axis]) / way[axis];
            let b = (self.bound - from[axis]) / way[axis];
            (t, end) = (t.max(a.min(b)), end.min(a.max(b)));
        }
        let root = 3f64.sqrt();
        let longest = 2.0 * root * 2f64.powi(self.around.len() as i32) / 128.0;
        let (mut passes, mut color) = (1.0, [0.0; 3]);
        while t < end && passes >= 1e-4 {
            let at = [0, 1, 2].map(|axis| from[axis] + t * way[axis]);
            let step = (t / 128.0).clamp(2.0 * root / 1024.0, longest);
            t += step;
            if self.is_occupied_by_step(at, step) {
                let (density, seen) = self.evaluate(at.map(|at| 0.5 * (at + 1.0)), way);
                let alpha = 1.0 - (-density * 0.5 * step).exp();
                (0..3).for_each(|channel| color[channel] += passes * alpha * seen[channel]);
                passes *= 1.0 - alpha;
            }
        }
        (color.map(|value| value + passes), passes)
    }

    /// Optical depth of a world unit, and colours along directions of the world.
    pub fn point(&self, world: [f64; 3], directions: &[[f64; 3]]) -> (f64, Vec<[f64; 3]>) {
        let at = self.to_cube(world);
        let turned = directions.iter().map(|&[x, y, z]| self.evaluate(at, [y, z, x]).1);
        let density = if self.is_occupied(at) { self.evaluate(at, [0.0; 3]).0 } else { 0.0 };
        (density * self.frame().0, turned.collect())
    }

    /// Colour over white and transmittance of a ray.
    pub fn ray(&self, origin: [f64; 3], [x, y, z]: [f64; 3]) -> ([f64; 3], f64) {
        let (from, direction) = (self.to_cube(origin), [y, z, x]);
        let (mut t, mut end) = (0.0f64, f64::INFINITY);
        for axis in 0..3 {
            let a = -from[axis] / direction[axis];
            let b = (1.0 - from[axis]) / direction[axis];
            (t, end) = (t.max(a.min(b)), end.min(a.max(b)));
        }
        let step = 3f64.sqrt() / 1024.0;
        let (mut passes, mut color) = (1.0, [0.0; 3]);
        while t <= end {
            let at = [0, 1, 2].map(|axis| from[axis] + t * direction[axis]);
            t += step;
            if !self.is_occupied(at) {
                continue;
            }
            let (density, seen) = self.evaluate(at, direction);
            let alpha = 1.0 - (-density * step).exp();
            (0..3).for_each(|channel| color[channel] += passes * alpha * seen[channel]);
            passes *= 1.0 - alpha;
            match self.is_torch {
                true if passes < 1e-4 => break,
                false if passes < 0.01 => {
                    color = color.map(|value| value / (1.0 - passes));
                    passes = 0.0;
                    break;
                }
                _ => {}
            }
        }
        (color.map(|value| value + passes), passes)
    }
}

/// The 16 functions of degree 0 to 3.
pub fn harmonics([x, y, z]: [f64; 3]) -> [f64; 16] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        0.282_094_791_773_878_14,
        -0.488_602_511_902_919_9 * y,
        0.488_602_511_902_919_9 * z,
        -0.488_602_511_902_919_9 * x,
        1.092_548_430_592_079_2 * x * y,
        -1.092_548_430_592_079_2 * y * z,
        0.315_391_565_252_520_05 * (2.0 * zz - xx - yy),
        -1.092_548_430_592_079_2 * x * z,
        0.546_274_215_296_039_6 * (xx - yy),
        -0.590_043_589_926_643_5 * y * (3.0 * xx - yy),
        2.890_611_442_640_554 * x * y * z,
        -0.457_045_799_464_465_8 * y * (4.0 * zz - xx - yy),
        0.373_176_332_590_115_4 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -0.457_045_799_464_465_8 * x * (4.0 * zz - xx - yy),
        1.445_305_721_320_277 * z * (xx - yy),
        -0.590_043_589_926_643_5 * x * (xx - 3.0 * yy),
    ]
}
