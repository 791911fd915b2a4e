//! The voxels of a file in memory.

use std::sync::Arc;

use super::corners::Corners;
use super::density::{EvenDensities, between};
use super::keys::Stored;
use super::octree::{Cube, MOST_VOXELS, Octree};
use super::ply_rows::DAMAGED;
use super::settings::Settings;
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
    /// Samples of a voxel, by its own rules.
    pub(super) samples: u32,
    pub(super) loaded: Lazy<Voxels>,
    /// Edges of the smallest and the largest cell of a box.
    pub(super) cells: [u32; 2],
    pub(super) even: Lazy<EvenDensities>,
}

/// Voxels in memory, numbered as in the file.
#[derive(Debug)]
pub(super) struct Voxels {
    pub(super) tree: Octree,
    /// The numbers of each voxel's corners, x slowest.
    of_voxels: Vec<[u32; 8]>,
    /// Raw densities at distinct corners.
    table: Vec<f32>,
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
            let Corners { of_voxels, count } = Corners::find(&self.places.cubes(), &mut budget)?;
            let table = match &self.stored {
                Stored::Ply(rows) => {
                    let found = rows.voxels(&self.settings, &mut budget)?;
                    table(&found.corners, &of_voxels, count, &mut budget)?
                }
                Stored::Checkpoint(arrays) => arrays.table(count, &mut budget)?,
            };
            let place = Place::Tensor("_shs".to_owned());
            let sizes = [paths.len() as u64, self.width as u64];
            let count = limits::product(&sizes, "harmonics", &place)?;
            let mut harmonics = budget.zeroed(count, "bytes of harmonics", &place)?;
            self.stored.harmonics(self.width, &mut harmonics)?;
            let voxels = Voxels { tree, of_voxels, table, harmonics, width: self.width };
            voxels.check()?;
            Ok(voxels)
        })
    }
}

/// Refuses zero voxels, and more than their numbers can count.
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
        let refuse = |number: usize, what: &str, name: &str| {
            let found = format!("a {what} {number} that is not finite");
            let error = Error::malformed(Place::Tensor(name.to_owned()), found, "finite numbers");
            Err(error.advise("retrain: these values are part of the scene"))
        };
        if let Some(corner) = odd(&self.table) {
            return refuse(corner, "density of corner", "_geo_grid_pts");
        }
        match odd(&self.harmonics) {
            Some(at) => refuse(at / self.width.max(1), "color of voxel", "_shs"),
            None => Ok(()),
        }
    }

    /// Raw densities at distinct corners.
    pub(super) fn table(&self) -> &[f32] {
        &self.table
    }

    /// The numbers of a voxel's corners, x slowest.
    #[inline]
    pub(super) fn numbers(&self, voxel: u32) -> [u32; 8] {
        self.of_voxels.get(voxel as usize).copied().unwrap_or_default()
    }

    /// Values of a table of distinct corners at a voxel's corners, x slowest.
    #[inline]
    pub(super) fn at_corners(&self, table: &[f32], voxel: u32) -> [f32; 8] {
        self.numbers(voxel).map(|corner| table.get(corner as usize).copied().unwrap_or(0.0))
    }

    /// The raw densities at a voxel's corners, x slowest.
    #[inline]
    pub(super) fn corners(&self, voxel: u32) -> [f32; 8] {
        self.at_corners(&self.table, voxel)
    }

    /// A voxel's raw density at shares of its edges.
    #[inline]
    pub(super) fn raw(&self, voxel: u32, shares: [f64; 3]) -> f64 {
        between(&self.corners(voxel), shares)
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

/// Raw densities at distinct corners, from those that each voxel states.
///
/// # Errors
/// `Malformed` if voxels state different densities at a shared corner.
fn table(
    of_voxels: &[[f32; 8]],
    numbers: &[[u32; 8]],
    count: usize,
    budget: &mut Budget,
) -> Result<Vec<f32>> {
    let place = Place::Key("properties.grid0_value".to_owned());
    let mut table: Vec<f32> = budget.zeroed(count, "bytes of corners", &place)?;
    table.fill(f32::NAN);
    for (voxel, (values, numbers)) in of_voxels.iter().zip(numbers).enumerate() {
        for (value, number) in values.iter().zip(numbers) {
            let Some(own) = table.get_mut(*number as usize) else { continue };
            if !own.is_nan() && own.to_bits() != value.to_bits() {
                let found = format!(
                    "{value} at a corner of voxel {voxel}, and {own} at the same corner of another voxel"
                );
                let error = Error::malformed(
                    place,
                    found,
                    "the same density at a corner that voxels share",
                );
                return Err(error.advise(DAMAGED));
            }
            *own = *value;
        }
    }
    Ok(table)
}
