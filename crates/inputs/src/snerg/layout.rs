//! The layout of SNeRG's asset folders, which reading and writing share.
//!
//! A folder holds a sparse grid of cubic voxels, with values in the middle of voxels. Its non-empty
//! blocks are in an *atlas*, each with an apron of one voxel. PNGs hold [`PLANES`] planes of the
//! atlas each, of constant z, one below the other. Its axes are those of OpenGL, y up;
//! [`WORLD_OF_GL`] maps them to the world.

/// The file that describes a folder.
pub const PARAMETERS: &str = "scene_params.json";
/// The picture of the places of blocks in the atlas.
pub const INDICES: &str = "atlas_indices.png";
/// Planes of the atlas in a picture.
pub const PLANES: usize = 4;
/// Apron: voxels that a block repeats from its neighbours on each side.
pub const APRON: usize = 1;
/// The index of an empty block.
pub const EMPTY: u8 = 255;
/// Edge of the atlas cubes that rays skip if their mean opacity is nearly 0. A block with its apron
/// consists of whole cubes.
pub const SKIPPED_CUBE: usize = 4;
/// Opacity up to which a sample, or a cube's mean, counts as empty.
pub const FAINT: f64 = 0.5 / 255.0;
/// Transmittance at which rays end.
pub const OPAQUE: f64 = 1.0 / 255.0;
/// Transmittance above which the network does not run.
pub const CLEAR: f64 = 254.0 / 255.0;
/// The network treats magnitudes below this as 0.
pub const NEARLY_ZERO: f32 = 0.1 / 255.0;
/// Specular features.
pub const FEATURES: usize = 4;
/// Octaves of the network's embedding of directions.
pub const OCTAVES: usize = 4;

/// Axes of OpenGL to those of the world, row by row.
pub const WORLD_OF_GL: [[f64; 4]; 4] =
    [[-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

/// The picture of diffuse colours and opacities of slice `slice`.
pub fn rgba_name(slice: usize) -> String {
    format!("rgba_{slice:03}.png")
}

/// The picture of features of slice `slice`.
pub fn feature_name(slice: usize) -> String {
    format!("feature_{slice:03}.png")
}

/// The place in a folder's first layer of input `input` of a
/// [`ViewMlp`](crate::model::view_mlp::ViewMlp). Folders order the waves of a direction by octave,
/// then by axis; networks here by axis, then by octave.
pub const fn folder_input(input: usize) -> usize {
    let waves = 3 * OCTAVES;
    if input < 3 || input >= 3 + 2 * waves {
        return input;
    }
    let wave = (input - 3) % waves;
    input - wave + 3 * (wave % OCTAVES) + wave / OCTAVES
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waves_change_places_and_nothing_else_does() {
        let places: Vec<usize> = (0..34).map(folder_input).collect();
        let (x, y) = ([3, 6, 9, 12], [4, 7, 10, 13]);
        assert_eq!(places[..3], [0, 1, 2]);
        assert_eq!((&places[3..7], &places[7..11]), (&x[..], &y[..]));
        assert_eq!((places[15], places[16], places[19], places[26]), (15, 18, 16, 26));
        assert_eq!(places[27..], [27, 28, 29, 30, 31, 32, 33]);
    }
}
