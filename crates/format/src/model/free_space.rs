//! The free-space mask: training dropped every sample outside it.

use crate::base::error::{Error, Place, Result};
use crate::model::grid::Nodes;

/// A coarse grid with its own nodes, and the affine map from world positions to its indices.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeSpace {
    /// Nodes of the mask.
    pub nodes: Nodes,
    /// A world position `p` lies at `p * scale + shift` in the mask's index space.
    pub scale: [f64; 3],
    /// See `scale`.
    pub shift: [f64; 3],
    /// Lookup of positions between nodes.
    pub lookup: Lookup,
}

/// Lookup of a position between the mask's nodes. Positions outside the mask's nodes are outside
/// the mask.
#[derive(Debug, Clone, PartialEq)]
pub enum Lookup {
    /// The value of the nearest node (DirectVoxGO's boolean mask). Halves round to even.
    Nearest(Vec<bool>),
    /// Trilinear interpolation of `values`, inside where it is at least `threshold` (Mip-VoG's
    /// coarse raw density).
    Trilinear {
        /// Raw coarse density, z fastest.
        values: Vec<f32>,
        /// Raw coarse density at which opacity reaches the mask's threshold.
        threshold: f32,
    },
}

impl FreeSpace {
    /// Refuses a mask whose number of values differs from its number of nodes, or with fewer than 2
    /// nodes along an axis.
    ///
    /// # Errors
    /// `Malformed`.
    pub fn check(&self) -> Result<()> {
        let values = match &self.lookup {
            Lookup::Nearest(inside) => inside.len(),
            Lookup::Trilinear { values, .. } => values.len(),
        };
        if self.nodes.0.iter().all(|&size| size >= 2) && values == self.nodes.count() {
            return Ok(());
        }
        let found = format!("{values} values on {:?} nodes", self.nodes.0);
        let place = Place::Key("free-space mask".to_owned());
        Err(Error::malformed(place, found, "one for each, at least 2 nodes along each axis"))
    }

    /// True if training kept samples at this world position.
    pub fn contains(&self, world: [f64; 3]) -> bool {
        let at: [f64; 3] =
            std::array::from_fn(|axis| world[axis] * self.scale[axis] + self.shift[axis]);
        match &self.lookup {
            Lookup::Nearest(inside) => {
                let nearest = at.map(libm::rint);
                let within = (0..3)
                    .all(|axis| nearest[axis] >= 0.0 && nearest[axis] < self.nodes.0[axis] as f64);
                within && inside[self.index(nearest.map(|at| at as usize))]
            }
            Lookup::Trilinear { values, threshold } => {
                let within = (0..3)
                    .all(|axis| at[axis] >= 0.0 && at[axis] <= (self.nodes.0[axis] - 1) as f64);
                within && self.interpolate(values, at) >= f64::from(*threshold)
            }
        }
    }

    fn interpolate(&self, values: &[f32], at: [f64; 3]) -> f64 {
        let low: [usize; 3] =
            std::array::from_fn(|axis| (at[axis] as usize).min(self.nodes.0[axis] - 2));
        let mut sum = 0.0;
        for corner in 0..8usize {
            let high = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let weight: f64 = (0..3)
                .map(|axis| {
                    let fraction = at[axis] - low[axis] as f64;
                    if high[axis] == 1 { fraction } else { 1.0 - fraction }
                })
                .product();
            let node = std::array::from_fn(|axis| low[axis] + high[axis]);
            sum += weight * f64::from(values[self.index(node)]);
        }
        sum
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (x * self.nodes.0[1] + y) * self.nodes.0[2] + z
    }
}
