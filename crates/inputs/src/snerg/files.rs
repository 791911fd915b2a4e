//! The pictures of a folder.

use super::parameters::Parameters;
use crate::base::error::Result;
use crate::folder::{Folder, RGB, RGBA};
use crate::snerg::layout::{INDICES, PLANES, feature_name, rgba_name};
use crate::source::SideFile;

/// The pictures of a folder, each looked at.
#[derive(Debug, Clone)]
pub(super) struct Pictures {
    pub(super) folder: Folder,
    /// True if there are features.
    pub(super) features: bool,
}

impl Pictures {
    /// Looks at all pictures. Returns them with a digest of each.
    pub(super) fn find(
        folder: Folder,
        parameters: &Parameters,
        features: bool,
    ) -> Result<(Self, Vec<SideFile>)> {
        let [x, y, z] = parameters.blocks();
        let mut found =
            vec![folder.look("indices", INDICES.to_owned(), [x, y * z], &[RGB, RGBA])?];
        let [width, height, _] = parameters.atlas;
        for slice in 0..parameters.slices {
            let size = [width, PLANES * height];
            found.push(folder.look("colors", rgba_name(slice), size, &[RGBA])?);
            if features {
                found.push(folder.look("features", feature_name(slice), size, &[RGBA])?);
            }
        }
        Ok((Self { folder, features }, found))
    }
}
