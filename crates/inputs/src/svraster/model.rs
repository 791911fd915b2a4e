//! Voxels by SVRaster's own rules.
//!
//! ```text
//! sample i of K  in the middle of part i of the chord's K even parts
//! opacity        1 - exp(-sum of depths), at most 0.99999; left out below 0.00001
//! colour         of the direction from the camera to the voxel's middle
//! ```
//!
//! A ray visits the cubes of the octree, full or empty, in order: each next one through the face
//! where it leaves. Places are integers, so no step is lost in rounding.

use std::sync::Arc;

use super::density::density;
use super::loaded::{VoxelFile, Voxels};
use super::octree::{Cube, SIDE, unit};
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::model::camera::Ray;
use crate::model::harmonics::{self, Harmonics};
use crate::model::ray_march::{
    Composite, SampleBudget, ZeroGuard, crossing, point_at, unit_direction,
};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};

/// The highest opacity of a voxel.
const MOST_OPACITY: f64 = 0.99999;
/// Voxels of a lower opacity are skipped.
const LEAST_OPACITY: f64 = 0.00001;
/// Rays end behind the voxel at which the transmittance falls below this.
const OPAQUE: f64 = 0.0001;
/// Voxels whose middle is closer to the camera than this are skipped.
pub(super) const NEAR: f32 = 0.02;
/// Replaces 0 in a direction.
const NEARLY_ZERO: f64 = 1e-300;

/// A file and its rendering settings, ready to be loaded.
#[derive(Debug)]
pub(super) struct ModelFile {
    pub(super) file: Arc<VoxelFile>,
    pub(super) harmonics: Harmonics,
}

impl LoadModel for ModelFile {
    fn load(&self, _: &Limits) -> Result<Box<dyn TrainedModel>> {
        let (file, harmonics) = (Arc::clone(&self.file), self.harmonics);
        Ok(Box::new(SvRaster { voxels: file.load()?, file, harmonics }))
    }
}

#[derive(Debug)]
struct SvRaster {
    file: Arc<VoxelFile>,
    voxels: Arc<Voxels>,
    harmonics: Harmonics,
}

impl SvRaster {
    /// World units of an edge of the smallest voxels.
    fn unit(&self) -> f64 {
        unit(self.file.settings.extent)
    }

    /// A position of the world in edges of the smallest voxels.
    fn place(&self, world: [f64; 3]) -> [f64; 3] {
        let mut at = world;
        for (at, center) in at.iter_mut().zip(self.file.settings.center) {
            *at = (*at - center) / self.unit() + 0.5 * f64::from(SIDE);
        }
        at
    }

    /// The colour of a voxel seen along a direction, which need not have unit length.
    fn color(&self, voxel: u32, direction: [f64; 3]) -> [f64; 3] {
        let basis = harmonics::basis_f64(direction);
        let rows = self.voxels.harmonics(voxel).as_chunks::<3>().0;
        let mut color = [f64::from(self.harmonics.offset); 3];
        for (function, row) in basis.iter().zip(rows) {
            let terms = color.iter_mut().zip(row);
            terms.for_each(|(sum, value)| *sum += function * f64::from(*value));
        }
        color.map(|value| value.max(0.0))
    }

    /// The voxel at a position, and the position in it.
    fn at(&self, world: [f64; 3]) -> Option<(u32, [f64; 3])> {
        let place = self.place(world);
        if !place.iter().all(|at| (0.0..f64::from(SIDE)).contains(at)) {
            return None;
        }
        let (voxel, cube) = self.voxels.tree.find(place.map(whole));
        Some((voxel?, shares(place, cube)))
    }
}

/// Rounds a place within the octree down.
#[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
fn whole(at: f64) -> u32 {
    (at.max(0.0) as u32).min(SIDE - 1)
}

/// A place as shares of a cube's edges, 0 to 1.
fn shares(place: [f64; 3], cube: Cube) -> [f64; 3] {
    let mut shares = place;
    for (share, low) in shares.iter_mut().zip(cube.corner) {
        *share = ((*share - f64::from(low)) / f64::from(cube.edge)).clamp(0.0, 1.0);
    }
    shares
}

fn corners(cube: Cube) -> [[f64; 3]; 2] {
    let low = cube.corner.map(f64::from);
    [low, low.map(|low| low + f64::from(cube.edge))]
}

/// A cube of the finest level behind the face through which a ray leaves a cube, and none if the
/// octree ends.
fn behind(cube: Cube, origin: [f64; 3], direction: [f64; 3], exit: f64) -> Option<[u32; 3]> {
    let [low, high] = corners(cube);
    // The axis of the first face on the way.
    let leaves = |axis: usize| {
        let by = direction.get(axis).copied().unwrap_or(0.0);
        let face = if by > 0.0 { high } else { low };
        let length = face.get(axis)? - origin.get(axis)?;
        (by != 0.0).then(|| length / by)
    };
    let ends = (0..3).filter_map(|axis| leaves(axis).map(|end| (axis, end)));
    let (axis, _) = ends.min_by(|(_, a), (_, b)| a.total_cmp(b))?;
    let mut next = cube.corner;
    let axes = next.iter_mut().zip(point_at(origin, direction, exit)).zip(direction).enumerate();
    for (number, ((next, at), by)) in axes {
        let (low, high) = (*next, *next + cube.edge - 1);
        *next = match number == axis {
            false => whole(at).clamp(low, high),
            true if by > 0.0 => (high + 1 < SIDE).then_some(high + 1)?,
            true => low.checked_sub(1)?,
        };
    }
    Some(next)
}

impl TrainedModel for SvRaster {
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor {
        let unit = unit_direction(ray);
        let from = ray.origin.to_array();
        let (origin, direction) = (self.place(from), unit.map(|by| by / self.unit()));
        let whole_tree = [[0.0; 3], [f64::from(SIDE); 3]];
        let guard = ZeroGuard::Replace(NEARLY_ZERO);
        let [enter, leave] = crossing(origin, direction, whole_tree, guard);
        let mut light = Composite::<3>::default();
        let start = enter.max(0.0);
        if !(start <= leave && start <= rules.farthest() && start.is_finite()) {
            return light.over_background(rules);
        }
        let near = f64::from(rules.near.max(NEAR));
        let mut next = Some(point_at(origin, direction, start).map(whole));
        let mut left = SampleBudget::new(0.0, 1.0, progress);
        while let Some(at) = next.filter(|_| left.take()) {
            let (voxel, cube) = self.voxels.tree.find(at);
            let [enter, exit] = crossing(origin, direction, corners(cube), guard);
            next = behind(cube, origin, direction, exit.max(start));
            let Some(voxel) = voxel.filter(|_| exit > enter.max(0.0)) else { continue };
            let mut to_middle = cube.corner.map(|low| f64::from(low) + 0.5 * f64::from(cube.edge));
            let axes = to_middle.iter_mut().zip(origin);
            axes.for_each(|(to, from)| *to = (*to - from) * self.unit());
            let away = to_middle.iter().map(|by| by * by).sum::<f64>().sqrt();
            if away < near {
                continue;
            }
            let part = (exit - enter) / f64::from(self.file.samples);
            let depths = (0..self.file.samples).map(|sample| {
                let t = enter + (f64::from(sample) + 0.5) * part;
                density(self.voxels.raw(voxel, shares(point_at(origin, direction, t), cube)))
            });
            let opacity = (-libm::expm1(-depths.sum::<f64>() * part)).min(MOST_OPACITY);
            if opacity < LEAST_OPACITY {
                continue;
            }
            let color = self.color(voxel, to_middle.map(|by| by / away));
            light.add(opacity, 0.5 * (enter + exit), |_| Some(color));
            if light.transmittance < OPAQUE {
                break;
            }
        }
        light.over_background(rules)
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        self.at(position)
            .map_or(0.0, |(voxel, shares)| density(self.voxels.raw(voxel, shares)) as f32)
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let Some((voxel, _)) = self.at(position) else { return vec![[0.0; 3]; directions.len()] };
        let seen = directions.iter().map(|direction| self.color(voxel, *direction));
        seen.map(|color| color.map(|value| value as f32)).collect()
    }
}
