//! A folder by the rules of its own viewer.

use std::sync::Arc;

use super::atlas::Atlas;
use super::block::{Block, OPACITY};
use super::parameters::Parameters;
use super::values::Folder;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::folder::{added_light, whole};
use crate::model::camera::Ray;
use crate::model::ray_march::{
    Composite, SampleBudget, ZeroGuard, crossing, over_background, point_at, ray_color,
    unit_direction,
};
use crate::model::trained_model::{LoadModel, RayColor, RayRules, TrainedModel};
use crate::model::view_mlp::ViewMlp;
use crate::snerg::layout::{APRON, CLEAR, FAINT, OPAQUE};

/// The largest opacity of which a density is stated.
const DENSEST: f64 = 254.5 / 255.0;

/// Against divisions by 0.
const GUARD: ZeroGuard = ZeroGuard::Replace(f64::MIN_POSITIVE);

/// A folder and its network, ready to be loaded.
#[derive(Debug)]
pub(super) struct FolderModel {
    pub(super) folder: Arc<Folder>,
    pub(super) network: Option<ViewMlp>,
}

impl LoadModel for FolderModel {
    fn load(&self, _: &Limits) -> Result<Box<dyn TrainedModel>> {
        let parameters = self.folder.parameters.clone();
        let (atlas, network) = (self.folder.atlas()?, self.network.clone());
        Ok(Box::new(Snerg { parameters, atlas, network }))
    }
}

#[derive(Debug)]
struct Snerg {
    parameters: Parameters,
    atlas: Arc<Atlas>,
    network: Option<ViewMlp>,
}

/// Interpolated values of a texel, 0 to 1.
type Values = [f64; 8];

impl Snerg {
    /// Values at a position in voxels within a block.
    fn values(&self, block: &Block, number: [usize; 3], position: [f64; 3]) -> Values {
        let edge = self.parameters.edge();
        let mut corners = [[(0, 0.0); 2]; 3];
        let axes = corners.iter_mut().zip(position).zip(number);
        for ((corners, at), block) in axes {
            let local = at - (block * self.atlas.block_size()) as f64;
            let local = local.clamp(0.0, self.atlas.block_size() as f64);
            // Values lie in the middle of texels.
            let at = local + APRON as f64 - 0.5;
            let low = whole(at.floor()).min(edge - 2);
            *corners = [(low, 1.0 - (at - low as f64)), (low + 1, at - low as f64)];
        }
        let [xs, ys, zs] = corners;
        let mut sums = [0.0; 8];
        for (x, of_x) in xs {
            for (y, of_y) in ys {
                for (z, of_z) in zs {
                    let weight = of_x * of_y * of_z / 255.0;
                    let texel = block.texel([x, y, z]);
                    let terms = sums.iter_mut().zip(texel);
                    terms.for_each(|(sum, value)| *sum += weight * f64::from(value));
                }
            }
        }
        sums
    }

    /// True if the viewer looks at the texel of a position.
    fn shows(&self, block: &Block, number: [usize; 3], position: [f64; 3]) -> bool {
        let mut texel = [0; 3];
        for ((texel, at), block) in texel.iter_mut().zip(position).zip(number) {
            let local = at - (block * self.atlas.block_size()) as f64;
            *texel = whole(local).min(self.atlas.block_size()) + APRON;
        }
        block.shows(texel)
    }

    fn number(&self, position: [f64; 3]) -> [usize; 3] {
        let mut number = self.parameters.blocks();
        for (number, at) in number.iter_mut().zip(position) {
            *number = (whole(at) / self.atlas.block_size()).min(*number - 1);
        }
        number
    }

    /// Values at a position of the world.
    fn at(&self, world: [f64; 3]) -> Option<Values> {
        let position = self.parameters.to_voxels(world);
        let inside = |(at, count): (f64, usize)| (0.0..=count as f64).contains(&at);
        if !position.into_iter().zip(self.parameters.grid.0).all(inside) {
            return None;
        }
        let number = self.number(position);
        let block = self.atlas.block(number)?;
        Some(self.values(block, number, position))
    }
}

impl TrainedModel for Snerg {
    fn ray_color(&self, ray: &Ray, rules: &RayRules, progress: &dyn Progress) -> RayColor {
        let voxel = self.parameters.voxel_size;
        let world = unit_direction(ray);
        let origin = self.parameters.to_voxels(ray.origin.to_array());
        let direction = self.parameters.axes.within(world);
        let grid = self.parameters.grid.0.map(|count| count as f64);
        let [enters, leaves] = crossing(origin, direction, [[0.0; 3], grid], GUARD);
        let far = rules.farthest() / voxel;
        let start = enters.max(f64::from(rules.near) / voxel).min(far).max(0.0);
        let mut light = Composite::<7>::default();
        let mut t = start + 0.5;
        let mut left = SampleBudget::new(t, 0.5, progress);
        let most = grid.iter().map(|count| count * count).sum::<f64>().sqrt().ceil();
        let mut steps = 0.0;
        while steps < most && light.transmittance > OPAQUE && t < leaves && left.take() {
            steps += 1.0;
            let position = point_at(origin, direction, t);
            let number = self.number(position);
            let Some(block) = self.atlas.block(number) else {
                let low = number.map(|at| (at * self.atlas.block_size()) as f64);
                let high = low.map(|at| at + self.atlas.block_size() as f64);
                let [_, exit] = crossing(origin, direction, [low, high], GUARD);
                // A ray along an edge may leave where it enters.
                t = exit.max(t) + 0.5;
                continue;
            };
            if self.shows(block, number, position) {
                let [red, green, blue, opacity, a, b, c, d] = self.values(block, number, position);
                if opacity > FAINT {
                    let values = [red, green, blue, a, b, c, d];
                    light.add_premultiplied(opacity, t * voxel, values);
                }
            }
            t += 1.0;
        }
        let Composite { transmittance, sums: [red, green, blue, features @ ..], distance } = light;
        let mut color = over_background([red, green, blue], transmittance, rules);
        if transmittance <= CLEAR {
            let added = added_light(self.network.as_ref(), world, color, &features);
            color.iter_mut().zip(added).for_each(|(sum, added)| *sum += added);
        }
        ray_color(color, transmittance, distance, rules)
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn density(&self, position: [f64; 3]) -> f32 {
        let values = self.at(position).unwrap_or_default();
        let opacity = values.get(OPACITY).copied().unwrap_or(0.0).min(DENSEST);
        (-libm::log1p(-opacity) / self.parameters.voxel_size) as f32
    }

    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let [red, green, blue, opacity, features @ ..] = self.at(position).unwrap_or_default();
        let whole = |value: f64| if opacity > 0.0 { value / opacity } else { 0.0 };
        let (color, features) = ([red, green, blue].map(whole), features.map(whole));
        let seen = directions.iter().map(|&direction| {
            let mut seen = color;
            let added = added_light(self.network.as_ref(), direction, color, &features);
            seen.iter_mut().zip(added).for_each(|(sum, added)| *sum += added);
            seen.map(|value| value as f32)
        });
        seen.collect()
    }
}
