//! Sizes and the network, as the viewer reads them.

use serde_json::{Map, Value, json};

use super::grid::VoxelGrid;
use super::layout::Layout;
use crate::model::view_mlp::{ViewInput, ViewMlp};
use mipvog_inputs::snerg::layout::{FEATURES, OCTAVES, PLANES, WORLD_OF_GL, folder_input};

/// Widths of the only network that the viewer runs: an embedded direction, three colours and the
/// features; two hidden layers; a colour.
const WIDTHS: [usize; 4] = [3 + 6 * OCTAVES + 3 + FEATURES, 16, 16, 3];

/// True for a network that the viewer can run.
pub(super) fn runs(network: &ViewMlp) -> bool {
    network.widths() == WIDTHS
        && network.frequencies == OCTAVES
        && network.input == ViewInput::DiffuseAndFeatures
}

/// The text of `scene_params.json`.
pub(super) fn text(grid: &VoxelGrid, layout: &Layout, network: Option<&ViewMlp>) -> String {
    let [width, height, depth] = layout.texels();
    let sizes = json!({
        "format": "png",
        "ndc": false,
        "voxel_size": grid.voxel,
        "block_size": grid.block,
        "grid_width": grid.counts[0],
        "grid_height": grid.counts[1],
        "grid_depth": grid.counts[2],
        "atlas_width": width,
        "atlas_height": height,
        "atlas_depth": depth,
        "atlas_blocks_x": layout.blocks[0],
        "atlas_blocks_y": layout.blocks[1],
        "atlas_blocks_z": layout.blocks[2],
        "num_slices": depth / PLANES,
        "min_x": grid.min[0],
        "min_y": grid.min[1],
        "min_z": grid.min[2],
        "worldspace_T_opengl": WORLD_OF_GL,
    });
    let mut parameters: Map<String, Value> = sizes.as_object().cloned().unwrap_or_default();
    for (number, layer) in network.into_iter().flat_map(|network| &network.layers).enumerate() {
        // Input by input, with sines and cosines of a direction by octave.
        let mut rows = vec![Vec::new(); layer.inputs];
        for input in 0..layer.inputs {
            let row = if number == 0 { folder_input(input) } else { input };
            let of = |output: usize| layer.weights[output * layer.inputs + input];
            rows[row] = (0..layer.outputs).map(of).collect::<Vec<f32>>();
        }
        parameters.insert(format!("{number}_weights"), json!(rows));
        parameters.insert(format!("{number}_bias"), json!(layer.bias));
    }
    Value::Object(parameters).to_string() + "\n"
}
