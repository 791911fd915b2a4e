//! The voxels of a file in memory.

use std::sync::Arc;

use super::corners::corners;
use super::density::between;
use super::keys::{Settings, Stored};
use super::octree::{Cube, MOST_VOXELS, Octree};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, Budget, Limits};
use crate::lazy::Lazy;

/// The places of voxels.
#[derive(Debug)]
pub(super) struct Places {
    pub(super) paths: Vec<u64>,
    pub(super) levels: Vec<u8>,
}

impl Places {
    /// Their cubes, in the order of the file.
    pub(super) fn cubes(&self) -> Vec<Cube> {
        let voxels = self.paths.iter().zip(&self.levels);
        voxels.map(|(path, level)| Cube::of_path(*path, *level)).collect()
    }
}

/// A file, ready to be loaded.
#[derive(Debug)]
pub(super) struct VoxelFile {
    pub(super) stored: Stored,
    pub(super) settings: Settings,
    pub(super) places: Places,
    /// Numbers of a voxel's harmonics that are used.
    pub(super) width: usize,
    pub(super) limits: Limits,
    pub(super) loaded: Lazy<Voxels>,
}

/// Voxels in memory, numbered as in the file.
#[derive(Debug)]
pub(super) struct Voxels {
    pub(super) tree: Octree,
    /// Raw densities at their corners, x slowest.
    corners: Vec<[f32; 8]>,
    /// Harmonics, function by function, each red, green and blue.
    harmonics: Vec<f32>,
    width: usize,
}

impl VoxelFile {
    /// Bytes of the voxels in memory, at most.
    pub(super) fn memory_bytes(&self) -> u64 {
        let voxel = 4 * self.width + size_of::<[f32; 8]>() + size_of::<Cube>() + 32 + 24;
        self.places.paths.len() as u64 * voxel as u64
    }

    pub(super) fn load(&self) -> Result<Arc<Voxels>> {
        self.loaded.get(|| {
            let mut budget = Budget::new(&self.limits);
            let Places { paths, levels } = &self.places;
            let tree = Octree::new(paths, levels, &mut budget)?;
            let corners = match &self.stored {
                Stored::Ply(rows) => rows.voxels(&self.settings, &mut budget)?.corners,
                Stored::Checkpoint(arrays) => {
                    let mut table = Vec::new();
                    let place = Place::Tensor("_geo_grid_pts".to_owned());
                    let mut spent = Ok(());
                    arrays.corners.for_each_piece(|piece| {
                        if spent.is_ok() {
                            spent =
                                budget.spend(size_of_val(piece) as u64, "bytes of corners", &place);
                        }
                        if spent.is_ok() {
                            table.extend_from_slice(piece);
                        }
                    })?;
                    spent?;
                    corners(&self.places.cubes(), &table, &mut budget)?
                }
            };
            let place = Place::Tensor("_shs".to_owned());
            let sizes = [paths.len() as u64, self.width as u64];
            let count = limits::product(&sizes, "harmonics", &place)?;
            let mut harmonics = budget.zeroed(count, "bytes of harmonics", &place)?;
            self.stored.harmonics(self.width, &mut harmonics)?;
            let voxels = Voxels { tree, corners, harmonics, width: self.width };
            voxels.check()?;
            Ok(voxels)
        })
    }
}

/// Refuses more voxels than their numbers can count, and none.
pub(super) fn check_count(voxels: usize) -> Result<()> {
    let place = Place::Tensor("octpath".to_owned());
    if voxels == 0 {
        return Err(Error::malformed(place, "no voxel", "one or more"));
    }
    limits::check_fixed("voxels", voxels as u64, MOST_VOXELS, &place)
}

impl Voxels {
    /// Refuses values that are not finite.
    fn check(&self) -> Result<()> {
        let odd = |values: &[f32]| values.iter().position(|value| !value.is_finite());
        let refuse = |voxel: usize, what: &str, name: &str| {
            let found = format!("{what} of voxel {voxel} that is not finite");
            let error = Error::malformed(Place::Tensor(name.to_owned()), found, "finite numbers");
            Err(error.advise("retrain: these values are part of the scene"))
        };
        if let Some(voxel) = self.corners.iter().position(|corners| odd(corners).is_some()) {
            return refuse(voxel, "a density", "_geo_grid_pts");
        }
        match odd(&self.harmonics) {
            Some(at) => refuse(at / self.width.max(1), "a color", "_shs"),
            None => Ok(()),
        }
    }

    /// The raw densities at a voxel's corners.
    #[inline]
    pub(super) fn corners(&self, voxel: u32) -> &[f32; 8] {
        self.corners.get(voxel as usize).unwrap_or(&[f32::NEG_INFINITY; 8])
    }

    /// A voxel's raw density at shares of its edges.
    #[inline]
    pub(super) fn raw(&self, voxel: u32, shares: [f64; 3]) -> f64 {
        between(self.corners(voxel), shares)
    }

    /// A voxel's harmonics.
    #[inline]
    pub(super) fn harmonics(&self, voxel: u32) -> &[f32] {
        let first = voxel as usize * self.width;
        self.harmonics.get(first..first + self.width).unwrap_or_default()
    }

    pub(super) fn width(&self) -> usize {
        self.width
    }
}
