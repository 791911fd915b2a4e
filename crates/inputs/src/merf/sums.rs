//! Values of a folder: sums of the sparse grid and the planes.

use std::sync::Arc;

use super::occupancy::{self, Occupancy};
use super::parameters::{LOW, Parameters, SPAN, Sparse};
use super::planes::{self, Planes};
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::folder::{Atlas, Folder, OPACITY, Places};
use crate::lazy::Lazy;
use crate::source::SideFile;
use crate::sparse::whole;

/// A folder, ready to be loaded.
#[derive(Debug)]
pub(super) struct Assets {
    pub(super) parameters: Parameters,
    folder: Folder,
    places: Option<Places>,
    limits: Limits,
    loaded: Lazy<Sums>,
}

impl Assets {
    /// Checks all pictures. Returns them with a digest of each.
    pub(super) fn find(
        folder: Folder,
        parameters: Parameters,
        limits: &Limits,
    ) -> Result<(Self, Vec<SideFile>)> {
        let mut found = occupancy::look(&folder, parameters.resolution())?;
        let layout = parameters.sparse.map(|sparse| sparse.layout(parameters.names));
        let looked = layout.map(|layout| Places::find(&folder, layout, limits)).transpose()?;
        let (places, pictures) = looked.unzip();
        found.extend(pictures.unwrap_or_default());
        if let Some(edge) = parameters.planes {
            found.extend(planes::look(&folder, edge)?);
        }
        let (limits, loaded) = (limits.clone(), Lazy::default());
        Ok((Self { parameters, folder, places, limits, loaded }, found))
    }

    /// The values, read on first use.
    pub(super) fn sums(&self) -> Result<Arc<Sums>> {
        let Self { parameters, folder, places, limits, .. } = self;
        self.loaded.get(|| {
            let mut budget = Budget::new(limits);
            let planes = parameters.planes;
            let planes = planes.map(|edge| Planes::read(folder, edge, &mut budget, limits));
            let planes = planes.transpose()?;
            let atlas = places.as_ref().map(|places| places.load(folder, &mut budget, limits));
            Ok(Sums {
                parameters: parameters.clone(),
                planes,
                atlas: atlas.transpose()?,
                occupancy: Occupancy::read(folder, parameters.resolution(), limits)?,
            })
        })
    }

    /// Bytes of the values in memory, at most.
    pub(super) fn bytes(&self) -> u64 {
        let atlas = self.places.as_ref().map_or(0, Places::memory_bytes);
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
    /// Sums at a position of contracted space: logits of a colour, the density's sum, logits of
    /// features. None if the sparse grid has no block within `reach`.
    pub(super) fn at(&self, position: [f64; 3], reach: f64) -> Option<[f64; 8]> {
        let voxels = |resolution: usize| {
            let per_unit = resolution as f64 / SPAN;
            position.map(|at| (at - LOW) * per_unit)
        };
        let (mut codes, mut parts) = ([0.0; 8], 0.0);
        if let (Some(atlas), Some(sparse)) = (&self.atlas, &self.parameters.sparse) {
            // Values lie in the middle of voxels.
            let at = voxels(sparse.resolution).map(|at| at - 0.5);
            let reach = reach * sparse.resolution as f64 / SPAN;
            codes = in_atlas(atlas, sparse, at, reach)?;
            parts += 1.0;
        }
        if let (Some(planes), Some(edge)) = (&self.planes, self.parameters.planes) {
            planes.add(voxels(edge), &mut codes);
            parts += 3.0;
        }
        let mut sums = [0.0; 8];
        for (at, (sum, code)) in sums.iter_mut().zip(codes).enumerate() {
            let Parameters { densities, features, .. } = &self.parameters;
            let [low, high] = if at == OPACITY { *densities } else { *features };
            *sum = parts * low + code / 255.0 * (high - low);
        }
        Some(sums)
    }
}

/// The codes at a position in voxels, 0 being the middle of the first one. Positions without a
/// block are clamped to the nearest block within `reach`; none if there is no such block.
fn in_atlas(atlas: &Atlas, sparse: &Sparse, at: [f64; 3], reach: f64) -> Option<[f64; 8]> {
    let edge = sparse.block as f64;
    let number = |at: f64| whole((at / edge).floor());
    let [xs, ys, zs] = at.map(|at| number(at - reach)..=number(at + reach));
    let near = xs.flat_map(|x| {
        let (ys, zs) = (ys.clone(), zs.clone());
        ys.flat_map(move |y| zs.clone().map(move |z| [x, y, z]))
    });
    let (number, block) = std::iter::once(at.map(number))
        .chain(near.filter(|_| reach > 0.0))
        .find_map(|number| Some((number, atlas.block(number)?)))?;
    let mut local = at;
    let axes = local.iter_mut().zip(number);
    axes.for_each(|(at, block)| *at = (*at - block as f64 * edge).clamp(0.0, edge));
    Some(block.interpolate(local))
}

/// The density of its sum, per world unit.
pub(super) fn density(sum: f64) -> f64 {
    libm::exp(sum - 1.0)
}
