//! The rules of SNeRG's viewer. Its own space is voxels, 0 being the lowest corner.

use std::sync::Arc;

use super::assets::Assets;
use super::parameters::Parameters;
use crate::base::error::Result;
use crate::folder::{Atlas, Block, Corners, Light, OPACITY, Samples, Viewed, ViewerRules};
use crate::model::trained_model::RayRules;
use crate::snerg::layout::{APRON, CLEAR, FAINT};
use crate::sparse::whole;

/// The largest opacity that is converted to a density.
const DENSEST: f64 = 254.5 / 255.0;

impl Viewed for Assets {
    type Rules = Rules;

    fn rules(&self) -> Result<Rules> {
        Ok(Rules { parameters: self.parameters.clone(), atlas: self.atlas()? })
    }
}

#[derive(Debug)]
pub(super) struct Rules {
    parameters: Parameters,
    atlas: Arc<Atlas>,
}

impl Rules {
    /// The number of the block around a position.
    fn number(&self, position: [f64; 3]) -> [usize; 3] {
        let mut number = self.parameters.blocks();
        for (number, at) in number.iter_mut().zip(position) {
            *number = (whole(at) / self.parameters.block).min(*number - 1);
        }
        number
    }

    /// A position in voxels from the lowest corner of its block.
    fn local(&self, number: [usize; 3], position: [f64; 3]) -> [f64; 3] {
        let edge = self.parameters.block as f64;
        let mut local = position;
        let axes = local.iter_mut().zip(number);
        axes.for_each(|(at, block)| *at = (*at - block as f64 * edge).clamp(0.0, edge));
        local
    }

    /// Interpolated values at a position in a block, 0 to 1.
    fn values(&self, block: &Block, local: [f64; 3]) -> [f64; 8] {
        // Values lie in the middle of texels.
        block.interpolate(local.map(|at| at + APRON as f64 - 0.5)).map(|sum| sum / 255.0)
    }

    /// Values at a position of the world; zeros in empty space.
    fn at(&self, world: [f64; 3]) -> [f64; 8] {
        let position = self.position(world);
        let inside = |(at, count): (f64, usize)| (0.0..=count as f64).contains(&at);
        if !position.into_iter().zip(self.parameters.grid.0).all(inside) {
            return [0.0; 8];
        }
        let number = self.number(position);
        let block = self.atlas.block(number);
        block.map_or([0.0; 8], |block| self.values(block, self.local(number, position)))
    }
}

impl ViewerRules for Rules {
    const CLEAR: f64 = CLEAR;

    fn position(&self, world: [f64; 3]) -> [f64; 3] {
        self.parameters.to_voxels(world)
    }

    fn direction(&self, world: [f64; 3]) -> [f64; 3] {
        self.parameters.axes.within(world)
    }

    fn space(&self) -> Corners {
        [[0.0; 3], self.parameters.grid.0.map(|count| count as f64)]
    }

    fn samples(&self, [enters, leaves]: [f64; 2], rules: &RayRules) -> Samples {
        let voxel = self.parameters.voxel_size;
        let [near, far] = [f64::from(rules.near), rules.farthest()].map(|at| at / voxel);
        let [_, grid] = self.space();
        Samples {
            start: enters.max(near).min(far).max(0.0) + 0.5,
            end: leaves,
            step: 1.0,
            most: grid.iter().map(|count| count * count).sum::<f64>().sqrt().ceil(),
        }
    }

    fn visit(&self, at: [f64; 3], [t, _]: [f64; 2], light: &mut Light) -> Option<Corners> {
        let number = self.number(at);
        let Some(block) = self.atlas.block(number) else {
            let low = number.map(|at| (at * self.parameters.block) as f64);
            return Some([low, low.map(|at| at + self.parameters.block as f64)]);
        };
        let local = self.local(number, at);
        if block.shows(local.map(|at| whole(at) + APRON)) {
            let [red, green, blue, opacity, a, b, c, d] = self.values(block, local);
            if opacity > FAINT {
                let values = [red, green, blue, a, b, c, d];
                light.add_premultiplied(opacity, t * self.parameters.voxel_size, values);
            }
        }
        None
    }

    fn density(&self, world: [f64; 3]) -> f64 {
        let opacity = self.at(world).get(OPACITY).copied().unwrap_or(0.0).min(DENSEST);
        -libm::log1p(-opacity) / self.parameters.voxel_size
    }

    fn values(&self, world: [f64; 3]) -> ([f64; 3], [f64; 4]) {
        let [red, green, blue, opacity, features @ ..] = self.at(world);
        let own = |value: f64| if opacity > 0.0 { value / opacity } else { 0.0 };
        ([red, green, blue].map(own), features.map(own))
    }
}
