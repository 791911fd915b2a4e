//! Small checkpoints of nerfacto, to be read and broken in one way at a time.

use super::Random;
use super::ngp::harmonics;
use super::torch::{Item, TorchFile};

/// Binary logarithm of the entries of a level.
const LOG2: i64 = 6;
/// Neurons of a layer.
const WIDTH: usize = 16;
/// Pictures, and the width of their appearances.
pub const APPEARANCES: [usize; 2] = [3, 4];

fn key(name: &str) -> String {
    format!("pipeline/_model.{name}")
}

fn floats(random: &mut Random, shape: &[usize], scale: f32) -> Item {
    let values = (0..shape.iter().product()).map(|_| random.between(-scale, scale));
    Item::Floats(shape.to_vec(), values.collect())
}

/// The layers of PyTorch from one width to the next.
fn layers(file: &mut TorchFile, random: &mut Random, name: &str, widths: &[usize]) {
    for (number, pair) in widths.windows(2).enumerate() {
        let name = |part: &str| key(&format!("{name}.layers.{number}.{part}"));
        file.push(name("weight"), floats(random, &[pair[1], pair[0]], 0.5));
        file.push(name("bias"), floats(random, &[pair[1]], 0.3));
    }
}

/// A flat array of tiny-cuda-nn.
fn flat(file: &mut TorchFile, random: &mut Random, name: &str, count: usize) {
    file.push(key(name), floats(random, &[count], 0.4));
}

fn sizes(file: &mut TorchFile, owner: &str, levels: i64, finest: i64) {
    let corners = vec![-1.0, -1.0, -1.0, 1.0, 1.0, 1.0];
    file.push(key(&format!("{owner}.aabb")), Item::Floats(vec![2, 3], corners));
    file.push(key(&format!("{owner}.num_levels")), Item::Int(levels));
    file.push(key(&format!("{owner}.max_res")), Item::Int(finest));
    file.push(key(&format!("{owner}.log2_hashmap_size")), Item::Int(LOG2));
}

/// A model of two levels, with two networks of proposals of one level each; by tiny-cuda-nn's layout
/// or by PyTorch's.
pub fn nerfacto(by_tcnn: bool) -> TorchFile {
    let (mut file, mut random) = (TorchFile::default(), Random::new(41));
    file.push("step", Item::Int(9));
    sizes(&mut file, "field", 2, 32);
    let appearances = floats(&mut random, &APPEARANCES, 1.0);
    file.push(key("field.embedding_appearance.embedding.weight"), appearances);
    let entries = 1 << LOG2;
    let colors = 16 + 15 + APPEARANCES[1];
    if by_tcnn {
        let network = WIDTH * (16 + 16);
        flat(&mut file, &mut random, "field.mlp_base.model.params", network + 4 * entries);
        let filled = colors.next_multiple_of(16);
        let count = WIDTH * (filled + WIDTH + 16);
        flat(&mut file, &mut random, "field.mlp_head.tcnn_encoding.params", count);
    } else {
        let table = floats(&mut random, &[2 * entries, 2], 1.0);
        file.push(key("field.mlp_base.model.0.hash_table"), table);
        layers(&mut file, &mut random, "field.mlp_base.model.1", &[4, WIDTH, 16]);
        layers(&mut file, &mut random, "field.mlp_head", &[colors, WIDTH, WIDTH, 3]);
    }
    for number in 0..2 {
        let owner = format!("proposal_networks.{number}");
        sizes(&mut file, &owner, 1, 16);
        if by_tcnn {
            let name = |part: &str| format!("{owner}.{part}.tcnn_encoding.params");
            flat(&mut file, &mut random, &name("encoding"), 2 * entries);
            flat(&mut file, &mut random, &name("mlp_base.1"), WIDTH * (16 + 16));
        } else {
            let table = floats(&mut random, &[entries, 2], 1.0);
            file.push(key(&format!("{owner}.encoding.hash_table")), table);
            layers(&mut file, &mut random, &format!("{owner}.mlp_base.1"), &[2, WIDTH, 1]);
        }
    }
    file
}

/// Factors of the coordinates in a hash.
const PRIMES: [u64; 3] = [1, 2_654_435_761, 805_459_861];

fn values(file: &TorchFile, name: &str) -> Vec<f64> {
    file.floats(&key(name)).1.iter().map(|value| f64::from(*value)).collect()
}

/// The features of two levels of 16 and 32 nodes, both hashed.
fn features(table: &[f64], by_tcnn: bool, at: [f64; 3]) -> Vec<f64> {
    let mut found = Vec::new();
    for (level, nodes) in [16.0, 32.0].into_iter().enumerate() {
        let (scale, shift) = if by_tcnn { (nodes - 1.0, 0.5) } else { (nodes, 0.0) };
        let mut sums = [0.0; 2];
        for corner in 0..8u64 {
            let (mut weight, mut hash) = (1.0, 0);
            for axis in 0..3 {
                let (place, up) = (at[axis] * scale + shift, corner >> axis & 1);
                let share = place - place.floor();
                weight *= if up == 1 { share } else { 1.0 - share };
                hash ^= (place.floor() as u64 + up).wrapping_mul(PRIMES[axis]);
            }
            let entry = (hash % (1 << LOG2)) as usize + (level << LOG2);
            sums[0] += weight * table[2 * entry];
            sums[1] += weight * table[2 * entry + 1];
        }
        found.extend(sums);
    }
    found
}

/// Layers from weights by rows and biases, relu between them.
fn run(layers: &[(Vec<f64>, Vec<f64>)], inputs: &[f64]) -> Vec<f64> {
    let mut values = inputs.to_vec();
    for (number, (weights, biases)) in layers.iter().enumerate() {
        if number > 0 {
            values.iter_mut().for_each(|value| *value = value.max(0.0));
        }
        let sum = |(row, bias): (&[f64], &f64)| {
            bias + row.iter().zip(&values).map(|(weight, value)| weight * value).sum::<f64>()
        };
        values = weights.chunks_exact(values.len()).zip(biases).map(sum).collect();
    }
    values
}

fn of_torch(file: &TorchFile, name: &str, count: usize) -> Vec<Layer> {
    let part = |number: usize, part: &str| values(file, &format!("{name}.layers.{number}.{part}"));
    (0..count).map(|number| (part(number, "weight"), part(number, "bias"))).collect()
}

/// Weights and biases of a layer.
type Layer = (Vec<f64>, Vec<f64>);

/// Layers between these widths from a flat array, and what is left of it.
fn of_tcnn(flat: &[f64], widths: &[usize]) -> (Vec<Layer>, Vec<f64>) {
    let mut rest = flat;
    let mut layers = Vec::new();
    for pair in widths.windows(2) {
        let (weights, after) = rest.split_at(pair[0] * pair[1]);
        layers.push((weights.to_vec(), vec![0.0; pair[1]]));
        rest = after;
    }
    (layers, rest.to_vec())
}

/// Density and colours of [`nerfacto`] at a position, with the mean appearance and a mean density of
/// 0.01, number by number in float64.
pub fn point(
    file: &TorchFile,
    by_tcnn: bool,
    position: [f64; 3],
    directions: &[[f64; 3]],
) -> (f64, Vec<[f64; 3]>) {
    let most = position.iter().fold(1.0, |most: f64, at| most.max(at.abs()));
    let at = position.map(|at| (at / most * (2.0 - 1.0 / most) + 2.0) / 4.0);
    let (shape, table) = match by_tcnn {
        true => {
            let flat = values(file, "field.mlp_base.model.params");
            of_tcnn(&flat, &[16, WIDTH, 16])
        }
        false => (
            of_torch(file, "field.mlp_base.model.1", 2),
            values(file, "field.mlp_base.model.0.hash_table"),
        ),
    };
    let mut inputs = features(&table, by_tcnn, at);
    if by_tcnn {
        inputs.resize(16, 0.0);
    }
    let found = run(&shape, &inputs);
    let appearances = values(file, "field.embedding_appearance.embedding.weight");
    let [pictures, width] = APPEARANCES;
    let mean = |number: usize| {
        appearances.iter().skip(number).step_by(width).sum::<f64>() / pictures as f64
    };
    let color = match by_tcnn {
        true => {
            let flat = values(file, "field.mlp_head.tcnn_encoding.params");
            of_tcnn(&flat, &[48, WIDTH, WIDTH, 16]).0
        }
        false => of_torch(file, "field.mlp_head", 3),
    };
    let colors = directions.iter().map(|&direction| {
        let mut inputs = match by_tcnn {
            true => harmonics(direction).to_vec(),
            false => positive_harmonics(direction.map(|along| (along + 1.0) / 2.0)).to_vec(),
        };
        inputs.extend(&found[1..]);
        inputs.extend((0..width).map(mean));
        if by_tcnn {
            inputs.resize(48, 1.0);
        }
        let raw = run(&color, &inputs);
        [0, 1, 2].map(|channel| 1.0 / (1.0 + (-raw[channel]).exp()))
    });
    (0.01 * found[0].exp(), colors.collect())
}

/// The harmonics of PyTorch's encoding, after the table in nerfstudio's documentation: each function
/// of [`harmonics`] without its sign, where `x^2 + y^2 + z^2` is not 1.
fn positive_harmonics([x, y, z]: [f64; 3]) -> [f64; 16] {
    let own = harmonics([x, y, z]);
    let rest = 1.0 - x * x - y * y - z * z;
    let mut found = [0.0; 16];
    for (number, (out, value)) in found.iter_mut().zip(own).enumerate() {
        // Functions with an odd order have the other sign.
        let band = number.isqrt();
        let order = number.abs_diff(band * band + band);
        *out = if order % 2 == 1 { -value } else { value };
    }
    // These are written with 1 in the place of the squares' sum.
    found[6] -= 0.315_391_565_252_520_05 * rest;
    found[11] -= 0.457_045_799_464_465_8 * y * rest;
    found[12] -= 3.0 * 0.373_176_332_590_115_4 * z * rest;
    found[13] -= 0.457_045_799_464_465_8 * x * rest;
    found
}
