//! Values of a folder: sums of the sparse grid and the planes.

use std::sync::Arc;

use super::atlas::{self, Atlas};
use super::occupancy::{self, Occupancy};
use super::parameters::{LOW, Parameters, SPAN};
use super::planes::{self, Planes};
use super::texel::DENSITY;
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::folder::Folder;
use crate::lazy::Lazy;
use crate::source::SideFile;

/// A folder, ready to be loaded.
#[derive(Debug)]
pub(super) struct Assets {
    pub(super) parameters: Parameters,
    folder: Folder,
    limits: Limits,
    loaded: Lazy<Sums>,
}

impl Assets {
    /// Looks at all pictures. Returns them with a digest of each.
    pub(super) fn find(
        folder: Folder,
        parameters: Parameters,
        limits: &Limits,
    ) -> Result<(Self, Vec<SideFile>)> {
        let mut found = occupancy::look(&folder, parameters.resolution())?;
        if let Some(sparse) = &parameters.sparse {
            found.extend(atlas::look(&folder, parameters.names, sparse)?);
        }
        if let Some(edge) = parameters.planes {
            found.extend(planes::look(&folder, edge)?);
        }
        let (limits, loaded) = (limits.clone(), Lazy::default());
        Ok((Self { parameters, folder, limits, loaded }, found))
    }

    /// The values, read when they are first asked for.
    pub(super) fn sums(&self) -> Result<Arc<Sums>> {
        let Self { parameters, folder, limits, .. } = self;
        self.loaded.get(|| {
            let mut budget = Budget::new(limits);
            let planes = parameters.planes;
            let planes = planes.map(|edge| Planes::read(folder, edge, &mut budget, limits));
            let sparse = parameters.sparse;
            let names = parameters.names;
            let atlas = sparse.map(|of| Atlas::read(folder, names, of, &mut budget, limits));
            Ok(Sums {
                parameters: parameters.clone(),
                planes: planes.transpose()?,
                atlas: atlas.transpose()?,
                occupancy: Occupancy::read(folder, parameters.resolution(), limits)?,
            })
        })
    }

    /// Bytes of the values in memory, at most.
    pub(super) fn memory_bytes(&self) -> u64 {
        let atlas = self.parameters.sparse.as_ref().map_or(0, atlas::memory_bytes);
        atlas + self.parameters.planes.map_or(0, planes::memory_bytes)
    }
}

/// The values of a folder in memory.
#[derive(Debug)]
pub(super) struct Sums {
    pub(super) parameters: Parameters,
    planes: Option<Planes>,
    atlas: Option<Atlas>,
    pub(super) occupancy: Occupancy,
}

impl Sums {
    /// Sums at a position of contracted space: logits of a colour, the density's, logits of
    /// features. None where the sparse grid has no block up to `reach` away.
    pub(super) fn at(&self, position: [f64; 3], reach: f64) -> Option<[f64; 8]> {
        let voxels = |resolution: usize| {
            let per_unit = resolution as f64 / SPAN;
            position.map(|at| (at - LOW) * per_unit)
        };
        let (mut codes, mut parts) = ([0.0; 8], 0.0);
        if let (Some(atlas), Some(sparse)) = (&self.atlas, &self.parameters.sparse) {
            let at = voxels(sparse.resolution).map(|at| at - 0.5);
            let reach = reach * sparse.resolution as f64 / SPAN;
            if !atlas.add(at, reach, &mut codes) {
                return None;
            }
            parts += 1.0;
        }
        if let (Some(planes), Some(edge)) = (&self.planes, self.parameters.planes) {
            planes.add(voxels(edge), &mut codes);
            parts += 3.0;
        }
        let mut sums = [0.0; 8];
        for (at, (sum, code)) in sums.iter_mut().zip(codes).enumerate() {
            let Parameters { densities, features, .. } = &self.parameters;
            let [low, high] = if at == DENSITY { *densities } else { *features };
            *sum = parts * low + code / 255.0 * (high - low);
        }
        Some(sums)
    }
}

/// The density of its sum, per world unit.
pub(super) fn density(sum: f64) -> f64 {
    libm::exp(sum - 1.0)
}
