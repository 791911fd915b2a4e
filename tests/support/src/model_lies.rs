//! Lies in checkpoints of TensoRF, nerfstudio and DirectVoxGO, with the exit codes that they end in.

use super::factored::{
    contracted, dvgo, first_tensorf, nerfstudio, nerfstudio_cp, tensorf, tensorf_cp,
};
use super::torch::{Item, TorchFile};

/// A model, the lie's name, the exit code, and the lie.
pub type LieCase = (fn() -> TorchFile, &'static str, i32, fn(&mut TorchFile));

fn reshape(file: &mut TorchFile, key: &str, wanted: &[usize]) {
    let count = wanted.iter().product();
    *file.item(key) = Item::Floats(wanted.to_vec(), vec![0.5; count]);
}

fn spoil(file: &mut TorchFile, key: &str, value: f32) {
    match file.item(key) {
        Item::Floats(_, values) => values[1] = value,
        other => panic!("{key}: {other:?}"),
    }
}

fn drop(file: &mut TorchFile, key: &str) {
    assert!(file.items.iter().any(|item| item.0 == key), "{key}");
    file.items.retain(|item| item.0 != key);
}

const FIELD: &str = "pipeline/_model.field.";

/// All of them.
pub const LIES: [LieCase; 38] = [
    (
        || dvgo(false, false),
        "a layer without a bias",
        3,
        |file| {
            drop(file, "model_state_dict/rgbnet.2.0.bias");
        },
    ),
    (
        || dvgo(false, false),
        "a layer without a number",
        4,
        |file| {
            file.push("model_state_dict/rgbnet.last.weight", Item::Floats(vec![1], vec![1.0]));
        },
    ),
    // Ranks and counts of factors.
    (
        || tensorf("SH"),
        "a plane of three axes",
        3,
        |file| {
            reshape(file, "state_dict/density_plane.0", &[2, 4, 5]);
        },
    ),
    (
        || tensorf("SH"),
        "a plane on its side",
        3,
        |file| {
            reshape(file, "state_dict/app_plane.1", &[1, 3, 5, 3]);
        },
    ),
    (
        || tensorf("SH"),
        "a line of another rank",
        3,
        |file| {
            reshape(file, "state_dict/density_line.1", &[1, 3, 4, 1]);
        },
    ),
    (
        || tensorf("SH"),
        "no components",
        3,
        |file| {
            reshape(file, "state_dict/density_line.1", &[1, 0, 4, 1]);
        },
    ),
    (
        || tensorf("SH"),
        "a basis of other components",
        3,
        |file| {
            reshape(file, "state_dict/basis_mat.weight", &[27, 8]);
        },
    ),
    (
        || tensorf("SH"),
        "features of another shading",
        3,
        |file| {
            reshape(file, "state_dict/basis_mat.weight", &[26, 9]);
        },
    ),
    (tensorf_cp, "a line longer than the grid", 3, |file| {
        reshape(file, "state_dict/app_line.2", &[1, 5, 6, 1]);
    }),
    (tensorf_cp, "more nodes than a number counts", 3, |file| {
        *file.item("kwargs/gridSize") = Item::Numbers(vec![1_099_511_627_776.0; 3]);
    }),
    (tensorf_cp, "more nodes than a machine holds", 6, |file| {
        *file.item("kwargs/gridSize") = Item::Numbers(vec![100_000.0; 3]);
    }),
    (first_tensorf, "fewer components than it states", 3, |file| {
        *file.item("kwargs/density_n_comp") = Item::Int(3);
    }),
    (first_tensorf, "no number of components", 3, |file| {
        *file.item("kwargs/appearance_n_comp") = Item::Number(f64::NAN);
    }),
    (first_tensorf, "two lines", 3, |file| {
        reshape(file, "state_dict/line_coef", &[2, 5, 4, 1]);
    }),
    (first_tensorf, "a line without axes", 3, |file| {
        reshape(file, "state_dict/line_coef", &[60]);
    }),
    // Values that are no numbers.
    (
        || tensorf("MLP"),
        "a factor that is no number",
        3,
        |file| {
            spoil(file, "state_dict/density_plane.2", f32::NAN);
        },
    ),
    (
        || tensorf("MLP"),
        "a weight without bounds",
        3,
        |file| {
            spoil(file, "state_dict/renderModule.mlp.2.weight", f32::INFINITY);
        },
    ),
    (
        || tensorf("MLP"),
        "a basis that is no number",
        3,
        |file| {
            spoil(file, "state_dict/basis_mat.weight", f32::NAN);
        },
    ),
    (
        || dvgo(true, true),
        "a factor of features that is no number",
        3,
        |file| {
            spoil(file, "model_state_dict/k0.yz_plane", f32::NAN);
        },
    ),
    // Networks.
    (
        || tensorf("MLP_Fea"),
        "a network for other inputs",
        3,
        |file| {
            reshape(file, "state_dict/renderModule.mlp.0.weight", &[6, 34]);
        },
    ),
    (
        || tensorf("MLP_PE"),
        "layers that do not follow each other",
        3,
        |file| {
            reshape(file, "state_dict/renderModule.mlp.2.weight", &[6, 7]);
        },
    ),
    (
        || tensorf("MLP_PE"),
        "a network of four colours",
        3,
        |file| {
            reshape(file, "state_dict/renderModule.mlp.4.weight", &[4, 6]);
            reshape(file, "state_dict/renderModule.mlp.4.bias", &[4]);
        },
    ),
    (
        || tensorf("MLP_PE"),
        "more octaves than numbers have",
        3,
        |file| {
            *file.item("kwargs/pos_pe") = Item::Int(1 << 40);
        },
    ),
    (
        || dvgo(false, true),
        "a network for other features",
        3,
        |file| {
            reshape(file, "model_state_dict/rgbnet.0.weight", &[6, 19]);
        },
    ),
    (nerfstudio, "a network for features of its own", 3, |file| {
        reshape(file, "pipeline/_model.field.mlp_head.layers.0.weight", &[6, 5]);
    }),
    // Masks.
    (
        || tensorf("RGB"),
        "a mask larger than its bits",
        3,
        |file| {
            *file.item("alphaMask.shape") = Item::Numbers(vec![1.0, 1.0, 3.0, 3.0, 5.0]);
        },
    ),
    (
        || tensorf("RGB"),
        "a mask of more nodes than a machine holds",
        6,
        |file| {
            *file.item("alphaMask.shape") = Item::Numbers(vec![1.0, 1.0, 1e5, 1e5, 1e5]);
        },
    ),
    (
        || tensorf("RGB"),
        "a mask of no extent",
        3,
        |file| {
            *file.item("alphaMask.aabb") = Item::Floats(vec![2, 3], vec![0.0; 6]);
        },
    ),
    // DirectVoxGO's factors.
    (
        || dvgo(true, true),
        "a plane of another grid",
        3,
        |file| {
            reshape(file, "model_state_dict/density.xz_plane", &[1, 2, 5, 4]);
        },
    ),
    (|| dvgo(true, true), "no line", 3, |file| drop(file, "model_state_dict/k0.y_vec")),
    (
        || dvgo(true, true),
        "a line without rows",
        3,
        |file| {
            reshape(file, "model_state_dict/k0.y_vec", &[1, 2]);
        },
    ),
    (
        || dvgo(true, true),
        "channels of fewer factors",
        3,
        |file| {
            reshape(file, "model_state_dict/k0.f_vec", &[6, 5]);
        },
    ),
    (
        || dvgo(false, true),
        "factors of other nodes than density",
        3,
        |file| {
            reshape(file, "model_state_dict/k0.x_vec", &[1, 2, 6, 1]);
            reshape(file, "model_state_dict/k0.xy_plane", &[1, 3, 6, 4]);
            reshape(file, "model_state_dict/k0.xz_plane", &[1, 2, 6, 3]);
        },
    ),
    // What cannot be read.
    (|| contracted("l1"), "a norm that nobody has", 4, |_| {}),
    (nerfstudio, "planes without lines", 4, |file| {
        drop(file, &format!("{FIELD}density_encoding.line_coef"));
    }),
    (nerfstudio, "a network of another program", 4, |file| {
        file.push(
            format!("{FIELD}mlp_head.tcnn_encoding.params"),
            Item::Floats(vec![1], vec![0.0]),
        );
    }),
    (nerfstudio_cp, "no mixing of products", 3, |file| drop(file, &format!("{FIELD}B.weight"))),
    (nerfstudio_cp, "no box", 3, |file| drop(file, &format!("{FIELD}aabb"))),
];
