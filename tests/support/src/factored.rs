//! Small models of TensoRF, nerfstudio and DirectVoxGO as checkpoints, to be read, evaluated in
//! float64 and broken in one way at a time.

use super::Random;
use super::torch::{Item, TorchFile};

/// Nodes of TensoRF's and DirectVoxGO's models.
pub const NODES: [usize; 3] = [5, 4, 3];
/// Nodes along each axis of models that are cubes.
pub const SIDE: usize = 4;
/// The box of TensoRF's models.
pub const AABB: [f32; 6] = [-1.0, -0.8, -0.6, 1.0, 0.9, 0.7];
/// The axes of the columns and rows of a plane, and the axis of its line.
pub const AXES: [([usize; 2], usize); 3] = [([0, 1], 2), ([0, 2], 1), ([1, 2], 0)];
/// Width of networks.
const WIDTH: usize = 6;

/// One of each kind.
pub const SMALL_MODELS: [fn() -> TorchFile; 9] = [
    || tensorf("MLP_Fea"),
    || tensorf("SH"),
    tensorf_cp,
    first_tensorf,
    nerfstudio,
    nerfstudio_cp,
    || dvgo(false, false),
    || dvgo(true, true),
    || contracted("inf"),
];

fn floats(random: &mut Random, shape: &[usize], scale: f32) -> Item {
    let values = (0..shape.iter().product()).map(|_| random.between(-scale, scale));
    Item::Floats(shape.to_vec(), values.collect())
}

/// Weights and biases of three layers.
fn network(file: &mut TorchFile, random: &mut Random, names: [String; 3], inputs: usize) {
    let widths = [inputs, WIDTH, WIDTH, 3];
    for (layer, name) in names.into_iter().enumerate() {
        let (rows, columns) = (widths[layer + 1], widths[layer]);
        file.push(format!("{name}.weight"), floats(random, &[rows, columns], 0.6));
        file.push(format!("{name}.bias"), floats(random, &[rows], 0.3));
    }
}

fn settings(file: &mut TorchFile, shading: &'static str, nodes: [usize; 3]) {
    let box_ = Item::Floats(vec![2, 3], AABB.to_vec());
    file.push("kwargs/aabb", box_);
    file.push("kwargs/gridSize", Item::Numbers(nodes.map(|count| count as f64).to_vec()));
    file.push("kwargs/fea2denseAct", Item::Text("softplus"));
    file.push("kwargs/density_shift", Item::Number(-1.0));
    file.push("kwargs/near_far", Item::Numbers(vec![0.5, 9.0]));
    file.push("kwargs/rayMarch_weight_thres", Item::Number(1e-4));
    file.push("kwargs/distance_scale", Item::Number(25.0));
    file.push("kwargs/step_ratio", Item::Number(0.5));
    file.push("kwargs/shadingMode", Item::Text(shading));
    for octaves in ["pos_pe", "view_pe", "fea_pe"] {
        file.push(format!("kwargs/{octaves}"), Item::Int(2));
    }
}

/// Basis and network of a model of so many components; the number of its features.
fn shading(file: &mut TorchFile, random: &mut Random, shading: &str, components: usize) -> usize {
    let features = match shading {
        "SH" => 27,
        "RGB" => 3,
        _ => 4,
    };
    let basis = floats(random, &[features, components], 0.8);
    file.push("state_dict/basis_mat.weight", basis);
    let extra = match shading {
        "MLP_Fea" => 2 * 2 * features + 12,
        "MLP_PE" => 12 + 12,
        "MLP" => 12,
        _ => return features,
    };
    let names = [0, 2, 4].map(|layer| format!("state_dict/renderModule.mlp.{layer}"));
    network(file, random, names, features + 3 + extra);
    features
}

/// Vector-matrix factors, 2 components of density and 3 of colours in each term.
pub fn tensorf(kind: &'static str) -> TorchFile {
    let (mut file, mut random) = (TorchFile::default(), Random::new(21));
    settings(&mut file, kind, NODES);
    for (of, components) in [("density", 2), ("app", 3)] {
        for (number, ([column, row], line)) in AXES.into_iter().enumerate() {
            let plane = [1, components, NODES[row], NODES[column]];
            let key = format!("state_dict/{of}_plane.{number}");
            file.push(key, floats(&mut random, &plane, 1.5));
            let line = [1, components, NODES[line], 1];
            file.push(format!("state_dict/{of}_line.{number}"), floats(&mut random, &line, 1.5));
        }
    }
    shading(&mut file, &mut random, kind, 9);
    // 4 x 3 x 3 nodes, of which the first two along x are free.
    file.push("alphaMask.shape", Item::Numbers(vec![1.0, 1.0, 3.0, 3.0, 4.0]));
    file.push("alphaMask.mask", Item::Bytes(vec![5], vec![0x33, 0x33, 0x33, 0x33, 0x30]));
    file.push("alphaMask.aabb", Item::Floats(vec![2, 3], AABB.map(|at| 1.25 * at).to_vec()));
    file
}

/// Lines alone.
pub fn tensorf_cp() -> TorchFile {
    let (mut file, mut random) = (TorchFile::default(), Random::new(22));
    settings(&mut file, "MLP", NODES);
    for (of, components) in [("density", 3), ("app", 5)] {
        for (number, (_, axis)) in AXES.into_iter().enumerate() {
            let line = [1, components, NODES[axis], 1];
            file.push(format!("state_dict/{of}_line.{number}"), floats(&mut random, &line, 1.5));
        }
    }
    shading(&mut file, &mut random, "MLP", 5);
    file
}

/// The first TensorVM: 3 components of colours, then 2 of density, in one array.
pub fn first_tensorf() -> TorchFile {
    let (mut file, mut random) = (TorchFile::default(), Random::new(23));
    settings(&mut file, "MLP_PE", [SIDE; 3]);
    file.push("kwargs/density_n_comp", Item::Int(2));
    file.push("kwargs/appearance_n_comp", Item::Int(3));
    file.push("state_dict/plane_coef", floats(&mut random, &[3, 5, SIDE, SIDE], 1.5));
    file.push("state_dict/line_coef", floats(&mut random, &[3, 5, SIDE, 1], 1.5));
    shading(&mut file, &mut random, "MLP_PE", 9);
    file
}

fn nerfstudio_of(planes: bool) -> TorchFile {
    let (mut file, mut random) = (TorchFile::default(), Random::new(24));
    let key = |name: &str| format!("pipeline/_model.field.{name}");
    file.push("step", Item::Int(29999));
    file.push(key("aabb"), Item::Floats(vec![2, 3], AABB.to_vec()));
    for (of, components) in [("density", 2), ("color", 3)] {
        if planes {
            let shape = [3, components, SIDE, SIDE];
            let plane = floats(&mut random, &shape, 2.5);
            file.push(key(&format!("{of}_encoding.plane_coef")), plane);
        }
        let line = floats(&mut random, &[3, components, SIDE, 1], 2.5);
        file.push(key(&format!("{of}_encoding.line_coef")), line);
    }
    let components = if planes { 9 } else { 3 };
    file.push(key("B.weight"), floats(&mut random, &[5, components], 0.5));
    let names = ["mlp_head.layers.0", "mlp_head.layers.1", "field_output_rgb.net"];
    network(&mut file, &mut random, names.map(key), 5 + 3 + 20 + 12);
    file
}

/// nerfstudio's vector-matrix factors.
pub fn nerfstudio() -> TorchFile {
    nerfstudio_of(true)
}

/// nerfstudio's lines alone.
pub fn nerfstudio_cp() -> TorchFile {
    nerfstudio_of(false)
}

/// DirectVoxGO with a network for each sample and 5 features; density and features are arrays, or
/// factors of which those of xy have other numbers of components.
pub fn dvgo(density: bool, features: bool) -> TorchFile {
    dvgo_in(density, features, NODES)
}

fn dvgo_in(density: bool, features: bool, nodes: [usize; 3]) -> TorchFile {
    let (mut file, mut random) = (TorchFile::default(), Random::new(25));
    let state = |name: &str| format!("model_state_dict/{name}");
    let [nx, ny, nz] = nodes;
    for (grid, channels, is_factors) in [("density", 1, density), ("k0", 5, features)] {
        if !is_factors {
            let shape = [1, channels, nx, ny, nz];
            file.push(state(&format!("{grid}.grid")), floats(&mut random, &shape, 4.0));
            continue;
        }
        for (name, shape) in [
            ("xy_plane", [1, 3, nx, ny]),
            ("xz_plane", [1, 2, nx, nz]),
            ("yz_plane", [1, 2, ny, nz]),
            ("x_vec", [1, 2, nx, 1]),
            ("y_vec", [1, 2, ny, 1]),
            ("z_vec", [1, 3, nz, 1]),
        ] {
            file.push(state(&format!("{grid}.{name}")), floats(&mut random, &shape, 1.5));
        }
        if channels > 1 {
            file.push(state("k0.f_vec"), floats(&mut random, &[7, channels], 0.8));
        }
    }
    let names = ["rgbnet.0", "rgbnet.2.0", "rgbnet.3"].map(state);
    network(&mut file, &mut random, names, 5 + 3 + 12);
    file.push(state("viewfreq"), Item::Floats(vec![2], vec![1.0, 2.0]));
    file.push(state("act_shift"), Item::Floats(vec![1], vec![-2.0]));
    file.push(state("xyz_min"), Item::Floats(vec![3], AABB[..3].to_vec()));
    file.push(state("xyz_max"), Item::Floats(vec![3], AABB[3..].to_vec()));
    let count = nx * ny * nz;
    file.push("model_kwargs/num_voxels", Item::Int(count as i64));
    file.push("model_kwargs/num_voxels_base", Item::Int(8 * count as i64));
    file.push("model_kwargs/fast_color_thres", Item::Number(1e-4));
    file.push("model_kwargs/rgbnet_direct", Item::Flag(true));
    file
}

/// The inner box of [`contracted`]: its centre, and half its edge.
pub const INNER: ([f64; 3], f64) = ([0.5, -0.25, 1.0], 2.0);

/// A contracted scene of DirectVoxGO, 9 nodes a side; its mask has a few free nodes.
pub fn contracted(norm: &'static str) -> TorchFile {
    let mut file = dvgo_in(false, false, [9; 3]);
    let corner = |at: f32| Item::Floats(vec![3], vec![at; 3]);
    *file.item("model_state_dict/xyz_min") = corner(-1.25);
    *file.item("model_state_dict/xyz_max") = corner(1.25);
    let center = INNER.0.map(|at| at as f32).to_vec();
    file.push("model_state_dict/scene_center", Item::Floats(vec![3], center));
    file.push("model_state_dict/scene_radius", corner(INNER.1 as f32));
    let inside = (0..343).map(|node| u8::from(node % 11 != 0)).collect();
    file.push("model_state_dict/mask_cache.mask", Item::Bytes(vec![7, 7, 7], inside));
    file.push("model_state_dict/mask_cache.xyz2ijk_scale", corner(2.4));
    file.push("model_state_dict/mask_cache.xyz2ijk_shift", corner(3.0));
    file.items.retain(|item| item.0 != "model_kwargs/rgbnet_direct");
    file.push("model_kwargs/contracted_norm", Item::Text(norm));
    file
}
