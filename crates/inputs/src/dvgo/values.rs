//! A grid of a checkpoint in memory, interpolated.

use crate::base::error::{Place, Result};
use crate::base::limits::Budget;
use crate::checkpoint::StoredGrid;
use crate::factors::{Mixed, Scratch, Tap};
use crate::model::grid::Nodes;

/// A grid in memory.
#[derive(Debug)]
pub(super) enum Values {
    /// All values, the channels of a node side by side.
    Dense {
        values: Vec<f32>,
        channels: usize,
    },
    Factors(Mixed),
}

impl Values {
    /// Reads all values.
    pub(super) fn load(stored: &StoredGrid, budget: &mut Budget) -> Result<Self> {
        if let Some(factors) = stored.factors() {
            return factors.load(budget).map(Self::Factors);
        }
        let grid = stored.clone().into_grid();
        let (Nodes([nx, ny, nz]), channels) = (grid.nodes(), grid.channels());
        let place = Place::Tensor(stored.name.clone());
        let count = nx * ny * nz * channels;
        let mut values: Vec<f32> = budget.zeroed(count, "bytes of a grid", &place)?;
        let mut plane: Vec<f32> = budget.zeroed(ny * nz, "bytes of a grid", &place)?;
        for channel in 0..channels {
            for (x, out) in values.chunks_exact_mut(ny * nz * channels).enumerate() {
                grid.read_plane(channel, x, &mut plane, |_| {})?;
                let out = out.iter_mut().skip(channel).step_by(channels);
                out.zip(&plane).for_each(|(out, value)| *out = *value);
            }
        }
        Ok(Self::Dense { values, channels })
    }

    /// Interpolated values at a position in nodes.
    pub(super) fn at(&self, [nx, ny, nz]: [usize; 3], [x, y, z]: [f64; 3]) -> Vec<f64> {
        let at = [Tap::at(x, nx), Tap::at(y, ny), Tap::at(z, nz)];
        let (values, channels) = match self {
            Self::Factors(factors) => return factors.values(&at, &mut Scratch::default()),
            Self::Dense { values, channels } => (values, *channels),
        };
        let [xs, ys, zs] = at.map(Tap::corners);
        let mut sums = vec![0.0; channels];
        for (x, of_x) in xs {
            for (y, of_y) in ys {
                for (z, of_z) in zs {
                    let weight = of_x * of_y * of_z;
                    let first = ((x * ny + y) * nz + z) * channels;
                    let stored = values.get(first..first + channels).unwrap_or_default();
                    let sums = sums.iter_mut().zip(stored);
                    sums.for_each(|(sum, value)| *sum += weight * f64::from(*value));
                }
            }
        }
        sums
    }
}
