//! Models that are recognized but not supported, by the names in their files.
//!
//! Their files are valid, so errors must not call them damaged.

use super::checkpoint::STATE;
use super::tensor::{TensorFile, Value};
use crate::base::error::{Error, Place, Result};

/// Maximum names that are collected from a file.
const MOST_NAMES: usize = 1 << 16;
/// Maximum depth of nested dictionaries.
const DEPTH: usize = 4;

/// A model that is known by the names of its weights.
struct OtherModel {
    /// Parts of names that must all occur.
    parts: &'static [&'static str],
    name: &'static str,
    advice: Advice,
}

#[derive(Clone, Copy)]
enum Advice {
    /// nerfstudio's own code evaluates the model.
    Nerfstudio,
    /// The model's own code evaluates it.
    OwnCode,
    /// There is no density.
    NoField,
}

impl Advice {
    const fn text(self) -> &'static str {
        match self {
            Self::Nerfstudio => {
                "bake the run by nerfstudio's own code, with the Python module: python -m \
                 mipvog_bake.nerfstudio RUN/config.yml -o scene.mipvog"
            }
            Self::OwnCode => {
                "bake it by its own code, with the Python module: mipvog_bake.from_model takes \
                 functions of density and colour"
            }
            Self::NoField => {
                "splats and surfaces have no density to bake: train one of the models of \
                 docs/models.md on the same pictures"
            }
        }
    }
}

/// The first match counts.
const MODELS: [OtherModel; 22] = [
    OtherModel {
        parts: &["_model.gauss_params."],
        name: "Gaussian splats of nerfstudio (splatfacto)",
        advice: Advice::NoField,
    },
    OtherModel {
        parts: &["_model.means", "_model.quats"],
        name: "Gaussian splats of nerfstudio (splatfacto)",
        advice: Advice::NoField,
    },
    OtherModel {
        parts: &["_model.field.grids."],
        name: "K-Planes of nerfstudio",
        advice: Advice::Nerfstudio,
    },
    OtherModel {
        parts: &["_model.proposal_networks.", "_model.field."],
        name: "a variant or version of nerfacto that is not supported",
        advice: Advice::Nerfstudio,
    },
    OtherModel {
        parts: &["_model.field_coarse.", "_model.field_fine."],
        name: "a vanilla NeRF or Mip-NeRF of nerfstudio",
        advice: Advice::Nerfstudio,
    },
    OtherModel {
        parts: &["_model.occupancy_grid.", "_model.field."],
        name: "Instant-NGP of nerfstudio",
        advice: Advice::Nerfstudio,
    },
    OtherModel {
        parts: &["_model.field.mlp_base.", "_model.field.mlp_head."],
        name: "a variant of nerfacto without proposal networks",
        advice: Advice::Nerfstudio,
    },
    OtherModel { parts: &["_model."], name: "a model of nerfstudio", advice: Advice::Nerfstudio },
    OtherModel { parts: &["field.grids.0"], name: "K-Planes", advice: Advice::OwnCode },
    OtherModel { parts: &["xyz_encoder.params"], name: "ngp_pl", advice: Advice::OwnCode },
    OtherModel { parts: &["tensorfs.0."], name: "LocalRF", advice: Advice::OwnCode },
    OtherModel { parts: &["U_vec_density"], name: "CCNeRF", advice: Advice::OwnCode },
    OtherModel {
        parts: &["aabb_train", "aabb_infer"],
        name: "a network of torch-ngp other than its hash grid",
        advice: Advice::OwnCode,
    },
    OtherModel {
        parts: &["sdf_network"],
        name: "a surface as a signed distance (NeuS or the like)",
        advice: Advice::NoField,
    },
    OtherModel {
        parts: &["pts_linears."],
        name: "a vanilla NeRF (one network of positions)",
        advice: Advice::OwnCode,
    },
    OtherModel {
        parts: &["network_fn_state_dict."],
        name: "a vanilla NeRF (one network of positions)",
        advice: Advice::OwnCode,
    },
    OtherModel {
        parts: &["nerf_mlp."],
        name: "Mip-NeRF 360, Zip-NeRF or the like",
        advice: Advice::OwnCode,
    },
    OtherModel { parts: &["nerf_coarse."], name: "a NeRF of one network", advice: Advice::OwnCode },
    OtherModel {
        parts: &["splats.means", "splats.quats"],
        name: "Gaussian splats (gsplat)",
        advice: Advice::NoField,
    },
    OtherModel {
        parts: &["means", "quats", "opacities"],
        name: "Gaussian splats",
        advice: Advice::NoField,
    },
    OtherModel {
        parts: &["_xyz", "_rotation", "_features_dc"],
        name: "Gaussian splats",
        advice: Advice::NoField,
    },
    OtherModel {
        parts: &["xyz", "rotation", "features_dc"],
        name: "Gaussian splats",
        advice: Advice::NoField,
    },
];

/// Refuses a file without density that belongs to a known other model, and one with unread weights.
///
/// # Errors
/// `Unsupported`, with the model's name.
pub(super) fn refuse(file: &TensorFile) -> Result<()> {
    let has_density = |name: &str| ["density", "density.grid", "density.xy_plane"].contains(&name);
    let mut names = Vec::new();
    gather(&file.root, String::new(), DEPTH, &mut names);
    let state = format!("{STATE}.");
    if names.iter().any(|name| has_density(name.strip_prefix(&state).unwrap_or(name))) {
        return Ok(());
    }
    for (value, place) in
        [(Some(&file.root), Place::File), (file.root.get(STATE), Place::Key(STATE.to_owned()))]
    {
        if let Some(error) = value.and_then(|value| value.unread_error(place)) {
            return Err(error);
        }
    }
    if let Some(mode) = other_snapshot(file) {
        let place = Place::Key("snapshot.mode".to_owned());
        let error = Error::unsupported(place, mode, "a radiance field (nerf)");
        return Err(error.advise("save a snapshot of a radiance field in Instant-NGP"));
    }
    let occurs = |part: &&str| {
        names.iter().any(|name| name.starts_with(part) || name.contains(&format!(".{part}")))
    };
    let known = MODELS.iter().find(|model| model.parts.iter().all(occurs));
    let (name, advice) = match known {
        Some(model) => (model.name, model.advice),
        None if is_capture(&file.root) => ("Gaussian splats", Advice::NoField),
        None => return Ok(()),
    };
    Err(Error::unsupported(Place::File, name, "a model of docs/models.md").advise(advice.text()))
}

/// Names of the file's values, with dots between the keys that lead to them.
fn gather(value: &Value, path: String, depth: usize, names: &mut Vec<String>) {
    if names.len() >= MOST_NAMES {
        return;
    }
    match (value, depth.checked_sub(1)) {
        (Value::Dict(entries), Some(depth)) => {
            for (key, value) in entries {
                let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                gather(value, path, depth, names);
            }
        }
        _ => names.push(path),
    }
}

/// The kind of an Instant-NGP snapshot that is not a radiance field.
fn other_snapshot(file: &TensorFile) -> Option<String> {
    file.root.at(&["snapshot", "params_binary"])?;
    Some(match file.root.at(&["snapshot", "mode"]) {
        Some(Value::Text(mode)) if mode != "nerf" => format!("a snapshot of mode {mode}"),
        _ => "a snapshot without a density grid".to_owned(),
    })
}

/// True for files of the original Gaussian splatting code: a tuple of the optimizer's step and
/// arrays of positions, colours, scales and rotations.
fn is_capture(root: &Value) -> bool {
    let Value::List(outer) = root else { return false };
    let Some(Value::List(parts)) = outer.first() else { return false };
    let widths: Vec<Option<u64>> = parts
        .iter()
        .filter_map(Value::tensor)
        .map(|tensor| tensor.shape().last().copied().filter(|_| tensor.shape().len() == 2))
        .collect();
    widths.contains(&Some(3)) && widths.contains(&Some(4)) && widths.contains(&Some(1))
}
