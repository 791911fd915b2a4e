//! The values of [`factored`](super::factored) models in float64, from the descriptions of the
//! systems alone.

use super::factored::{AXES, SIDE};
use super::torch::TorchFile;

/// The share of a node in a value at a position, both counted in nodes.
fn hat(at: f64, node: usize) -> f64 {
    (1.0 - (at - node as f64).abs()).max(0.0)
}

/// All components of a factor at a position: of one of the arrays that are stacked along its first
/// axis.
pub fn factor(file: &TorchFile, key: &str, number: usize, [row, column]: [f64; 2]) -> Vec<f64> {
    let (shape, values) = file.floats(key);
    let &[_, components, rows, columns] = shape else { panic!("{shape:?}") };
    (0..components)
        .map(|component| {
            let mut sum = 0.0;
            for r in 0..rows {
                for c in 0..columns {
                    let value =
                        values[((number * components + component) * rows + r) * columns + c];
                    sum += hat(row, r) * hat(column, c) * f64::from(value);
                }
            }
            sum
        })
        .collect()
}

fn times(a: Vec<f64>, b: &[f64]) -> Vec<f64> {
    a.into_iter().zip(b).map(|(a, b)| a * b).collect()
}

/// Products of planes and lines named `PLANE.0` to `.2`, or of one stacked array of each.
pub fn products(file: &TorchFile, [plane, line]: [&str; 2], at: [f64; 3]) -> Vec<f64> {
    let stacked = file.items.iter().any(|item| item.0 == line);
    let key = |name: &str, number: usize| match stacked {
        true => (name.to_owned(), number),
        false => (format!("{name}.{number}"), 0),
    };
    let has_planes = file.items.iter().any(|item| item.0.starts_with(plane));
    let lines = AXES.into_iter().enumerate().map(|(number, (_, axis))| {
        let (key, number) = key(line, number);
        factor(file, &key, number, [at[axis], 0.0])
    });
    let lines: Vec<Vec<f64>> = lines.collect();
    if !has_planes {
        return times(times(lines[0].clone(), &lines[1]), &lines[2]);
    }
    let planes = AXES.into_iter().enumerate().map(|(number, ([column, row], _))| {
        let (key, part) = key(plane, number);
        times(factor(file, &key, part, [at[row], at[column]]), &lines[number])
    });
    planes.flatten().collect()
}

/// `[rows, columns]` times a vector.
pub fn matrix(file: &TorchFile, key: &str, vector: &[f64]) -> Vec<f64> {
    let (_, values) = file.floats(key);
    let rows = values.chunks_exact(vector.len());
    rows.map(|row| row.iter().zip(vector).map(|(a, b)| f64::from(*a) * b).sum()).collect()
}

/// Sines of all values by frequency, then cosines.
pub fn waves(values: &[f64], frequencies: &[f64]) -> Vec<f64> {
    let phases: Vec<f64> =
        values.iter().flat_map(|value| frequencies.iter().map(move |by| value * by)).collect();
    phases.iter().map(|phase| phase.sin()).chain(phases.iter().map(|phase| phase.cos())).collect()
}

/// A network of three layers.
pub fn network(file: &TorchFile, names: [&str; 3], inputs: Vec<f64>) -> [f64; 3] {
    let mut values = inputs;
    for (number, name) in names.into_iter().enumerate() {
        let (_, biases) = file.floats(&format!("{name}.bias"));
        let sums = matrix(file, &format!("{name}.weight"), &values);
        let sums = sums.into_iter().zip(biases).map(|(sum, bias)| sum + f64::from(*bias));
        values = match number {
            2 => sums.map(|sum| 1.0 / (1.0 + (-sum).exp())).collect(),
            _ => sums.map(|sum| sum.max(0.0)).collect(),
        };
    }
    [values[0], values[1], values[2]]
}

pub fn softplus(x: f64) -> f64 {
    (1.0 + x.exp()).ln()
}

/// The first nine spherical harmonics.
pub fn harmonics([x, y, z]: [f64; 3]) -> [f64; 9] {
    let (c1, c2) = (0.4886025119029199, 1.0925484305920792);
    [
        0.28209479177387814,
        -c1 * y,
        c1 * z,
        -c1 * x,
        c2 * x * y,
        -c2 * y * z,
        0.31539156525252005 * (2.0 * z * z - x * x - y * y),
        -c2 * x * z,
        0.5462742152960396 * (x * x - y * y),
    ]
}

/// TensoRF's colour of features, for any shading.
pub fn tensorf_color(
    file: &TorchFile,
    shading: &str,
    features: &[f64],
    at: [f64; 3],
    direction: [f64; 3],
) -> [f64; 3] {
    let octaves = [1.0, 2.0];
    let own = [features, &direction[..]].concat();
    let encoded = match shading {
        "RGB" => return [features[0], features[1], features[2]],
        "SH" => {
            let functions = harmonics(direction);
            let sum = |channel: usize| {
                let terms = features[9 * channel..].iter().zip(functions);
                (terms.map(|(value, function)| value * function).sum::<f64>() + 0.5).max(0.0)
            };
            return [sum(0), sum(1), sum(2)];
        }
        "MLP_Fea" => waves(features, &octaves),
        "MLP_PE" => waves(&at, &octaves),
        _ => Vec::new(),
    };
    let inputs = [own, encoded, waves(&direction, &octaves)].concat();
    let names = ["0", "2", "4"].map(|layer| format!("state_dict/renderModule.mlp.{layer}"));
    network(file, names.each_ref().map(String::as_str), inputs)
}

/// Density per world unit of nerfstudio's model at shares of its box, and its colour.
pub fn nerfstudio(file: &TorchFile, share: [f64; 3], direction: [f64; 3]) -> (f64, [f64; 3]) {
    let key = |name: &str| format!("pipeline/_model.field.{name}");
    let at = share.map(|share| share * (SIDE - 1) as f64);
    let products = |of: &str| {
        let names = ["plane", "line"].map(|part| key(&format!("{of}_encoding.{part}_coef")));
        products(file, names.each_ref().map(String::as_str), at)
    };
    let density = products("density").iter().sum::<f64>().max(0.0);
    let features = matrix(file, &key("B.weight"), &products("color"));
    let turns = [1.0, 4.0].map(|ratio| ratio * std::f64::consts::TAU);
    let encoded = [waves(&features, &turns), waves(&direction, &turns)].concat();
    let inputs = [features, direction.to_vec(), encoded].concat();
    let names = ["mlp_head.layers.0", "mlp_head.layers.1", "field_output_rgb.net"].map(key);
    (density, network(file, names.each_ref().map(String::as_str), inputs))
}

/// All channels of a grid of DirectVoxGO at a position in nodes.
pub fn dvgo_grid(file: &TorchFile, grid: &str, at: [f64; 3]) -> Vec<f64> {
    let key = |name: &str| format!("model_state_dict/{grid}.{name}");
    if file.items.iter().any(|item| item.0 == key("grid")) {
        let (shape, values) = file.floats(&key("grid"));
        let &[_, channels, nx, ny, nz] = shape else { panic!("{shape:?}") };
        return (0..channels)
            .map(|channel| {
                let mut sum = 0.0;
                for node in 0..nx * ny * nz {
                    let [x, y, z] = [node / (ny * nz), node / nz % ny, node % nz];
                    let share = hat(at[0], x) * hat(at[1], y) * hat(at[2], z);
                    sum += share * f64::from(values[channel * nx * ny * nz + node]);
                }
                sum
            })
            .collect();
    }
    let terms = [
        ("xy_plane", [0, 1], "z_vec", 2),
        ("xz_plane", [0, 2], "y_vec", 1),
        ("yz_plane", [1, 2], "x_vec", 0),
    ];
    let products = terms.into_iter().flat_map(|(plane, [row, column], line, axis)| {
        let plane = factor(file, &key(plane), 0, [at[row], at[column]]);
        times(plane, &factor(file, &key(line), 0, [at[axis], 0.0]))
    });
    let products: Vec<f64> = products.collect();
    if grid == "density" {
        return vec![products.iter().sum()];
    }
    let (shape, weights) = file.floats(&key("f_vec"));
    let channels = shape[1];
    let mixed = |channel: usize| {
        let weights = weights.iter().skip(channel).step_by(channels);
        weights.zip(&products).map(|(weight, product)| f64::from(*weight) * product).sum()
    };
    (0..channels).map(mixed).collect()
}

/// DirectVoxGO's colour of features.
pub fn dvgo_color(file: &TorchFile, features: &[f64], direction: [f64; 3]) -> [f64; 3] {
    let names =
        ["rgbnet.0", "rgbnet.2.0", "rgbnet.3"].map(|name| format!("model_state_dict/{name}"));
    let inputs = [features, &direction[..], &waves(&direction, &[1.0, 2.0])].concat();
    network(file, names.each_ref().map(String::as_str), inputs)
}
