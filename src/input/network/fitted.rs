//! Harmonics at nodes, fitted to a network along the directions from which each is seen.
//!
//! Directions are those of the node's cell of [`Seen`]: the middle of the cell stands for all of
//! its nodes, so that the fit and the first layer of the network are prepared once for all of
//! them. The network is asked along these very directions, so no error comes of that.

use std::sync::Arc;

use super::batch::{Batch, BatchNetwork, Scratch};
use super::fit::Fit;
use super::planes::{PlaneCache, visit};
use super::run::{Network, NetworkFile};
use super::seen::Seen;
use super::views::Views;
use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::input::lazy::Lazy;
use crate::model::field::{Grid, NodeValues, RadianceField};
use crate::model::grid::Nodes;
use crate::model::harmonics::{BAND_0, FUNCTIONS, Harmonics};

/// Directions of a fit, at most: of functions up to degree 2, and of more.
const MOST: [usize; 2] = [32, 48];
/// Planes that threads fill at once, at most.
const AT_ONCE: u64 = 8;
/// A cell that fewer views see is hidden, and its colour hardly matters.
const LEAST: usize = 6;
/// Directions, all around, of a hidden cell.
const HIDDEN: usize = 16;

/// The colours to fit.
#[derive(Debug)]
pub struct FittedColors {
    /// The inputs of the network.
    features: Grid,
    network: NetworkFile,
    /// The rules of the harmonics.
    harmonics: Harmonics,
    /// True for band 0 alone, as colours.
    is_plain: bool,
    /// What hides a node from a view.
    matter: RadianceField,
    views: Views,
    limits: Limits,
    prepared: Lazy<Prepared>,
    planes: PlaneCache,
}

/// All that nodes have in common.
#[derive(Debug)]
struct Prepared {
    network: Network,
    batches: BatchNetwork,
    seen: Seen,
}

/// All that the nodes of a cell have in common.
struct Cell {
    at: [usize; 3],
    fit: Fit,
    batch: Batch,
}

impl FittedColors {
    /// Harmonics for a network that is seen from `cameras`, or from all around if they are few.
    /// `matter` is the field without its colours.
    pub fn new(
        features: Grid,
        network: NetworkFile,
        harmonics: Harmonics,
        matter: RadianceField,
        cameras: &[[f64; 3]],
        limits: &Limits,
    ) -> Self {
        let (views, limits) = (Views::new(cameras), limits.clone());
        let (prepared, planes) = (Lazy::default(), PlaneCache::with_archive());
        let is_plain = false;
        Self { features, network, harmonics, is_plain, matter, views, limits, prepared, planes }
    }

    /// The same as colours that do not depend on the view.
    #[must_use]
    pub fn plain(self) -> Self {
        Self { harmonics: Harmonics { degree: 0, ..self.harmonics }, is_plain: true, ..self }
    }

    /// Directions of a fit, at most.
    const fn most(&self) -> usize {
        if self.harmonics.degree > 2 { MOST[1] } else { MOST[0] }
    }

    fn prepared(&self) -> Result<Arc<Prepared>> {
        self.prepared.get(|| {
            let network = self.network.load(&mut Budget::new(&self.limits))?;
            let batches = BatchNetwork::new(&network);
            let seen = Seen::find(&self.matter, &self.views, &self.limits)?;
            Ok(Prepared { network, batches, seen })
        })
    }

    /// The fit of a cell's nodes.
    fn cell(&self, prepared: &Prepared, at: [usize; 3]) -> Cell {
        let mut views = prepared.seen.views(at);
        let mut most = self.most();
        if views.len() < LEAST {
            (views, most) = ((0..self.views.count()).collect(), HIDDEN);
        }
        let count = views.len().min(most);
        let middle = prepared.seen.middle(at);
        let chosen = (0..count).filter_map(|number| views.get(number * views.len() / count));
        let directions: Vec<[f64; 3]> = chosen.map(|&view| self.views.at(view, middle).0).collect();
        let fit = Fit::new(&directions, self.harmonics.functions());
        let batch = prepared.batches.batch(&prepared.network, &directions);
        Cell { at, fit, batch }
    }

    /// All channels of the nodes of plane `x` in a region, channel by channel.
    #[expect(clippy::cast_possible_truncation, reason = "coefficients are float32")]
    fn fill(&self, x: usize, region: &[u64], values: &mut [f32]) -> Result<()> {
        let prepared = self.prepared()?;
        let Nodes([nx, ny, nz]) = self.nodes();
        let offset = f64::from(self.harmonics.offset);
        // Nodes come row by row: the cells of one row are in use at a time.
        let mut cells: Vec<Cell> = Vec::new();
        let (mut scratch, mut colors) = (Scratch::default(), [(); 3].map(|()| Vec::new()));
        let place = |at: usize, count: usize| 2.0 * at as f64 / (count - 1) as f64 - 1.0;
        let stored = self.stored(x, region)?;
        let mut features = Vec::new();
        visit(self.nodes(), region, |[y, z]| {
            let own = stored.iter().skip(y * nz + z).step_by(ny * nz);
            features.clear();
            features.extend(own.map(|value| f64::from(*value)));
            let at = prepared.seen.cell([x, y, z]);
            if cells.first().is_some_and(|cell| cell.at[1] != at[1]) {
                cells.clear();
            }
            let known = cells.iter().position(|cell| cell.at == at);
            let known = known.unwrap_or_else(|| {
                cells.push(self.cell(&prepared, at));
                cells.len() - 1
            });
            let Some(cell) = cells.get(known) else { return };
            let position = [place(x, nx), place(y, ny), place(z, nz)];
            let Prepared { network, batches, .. } = &*prepared;
            batches.colors(network, &cell.batch, &features, position, &mut scratch, &mut colors);
            colors.iter_mut().flatten().for_each(|value| *value -= offset);
            let out = values.iter_mut().skip(y * nz + z).step_by(ny * nz);
            let found = cell.fit.coefficients(&colors).map(|value| value as f32);
            if self.is_plain {
                let mut band_0 = [0.0; 3];
                band_0.iter_mut().zip(found).for_each(|(value, found)| *value = found);
                let color = self.harmonics.color(&[BAND_0; FUNCTIONS], &band_0);
                out.zip(color).for_each(|(out, value)| *out = value);
            } else {
                out.zip(found).for_each(|(out, value)| *out = value);
            }
        });
        Ok(())
    }

    /// The features of a plane, channel by channel.
    fn stored(&self, x: usize, region: &[u64]) -> Result<Vec<f32>> {
        let Nodes([_, ny, nz]) = self.nodes();
        let mut budget = Budget::new(&self.limits);
        let place = Place::Key("features".to_owned());
        let count = ny * nz * self.features.channels();
        let mut stored: Vec<f32> = budget.zeroed(count, "bytes of a plane", &place)?;
        for (channel, out) in stored.chunks_exact_mut(ny * nz).enumerate() {
            match &self.features {
                Grid::Array(_) => self.features.read_plane(channel, x, out, |_| {})?,
                Grid::Values(values) => {
                    values.read(channel, x, region, out)?;
                }
            }
        }
        Ok(stored)
    }
}

impl NodeValues for FittedColors {
    fn nodes(&self) -> Nodes {
        self.features.nodes()
    }

    fn channels(&self) -> usize {
        3 * self.harmonics.functions()
    }

    fn memory_bytes(&self) -> u64 {
        let Nodes([_, ny, nz]) = self.nodes();
        let cells = Batch::bytes(self.most(), self.network.hidden_width()) * 64;
        let stored = (4 * ny * nz * self.features.channels()) as u64;
        let planes = self.planes.bytes(self.nodes(), self.channels());
        let features = match &self.features {
            Grid::Array(_) => 0,
            Grid::Values(values) => values.memory_bytes(),
        };
        planes + features + Seen::memory_bytes(&self.views) + AT_ONCE * (stored + cells)
    }

    fn digest(&self, see: &mut dyn FnMut(&[u8])) -> Result<()> {
        if let Views::Cameras(places) = &self.views {
            places.iter().flatten().for_each(|value| see(&value.to_le_bytes()));
        }
        match &self.features {
            Grid::Values(values) => values.digest(see),
            Grid::Array(_) => {
                // The checksums of an archive, if there are any, stand for all values.
                let Nodes([nx, ny, nz]) = self.nodes();
                let mut plane = vec![0.0; ny * nz];
                self.features.read_plane(0, nx / 2, &mut plane, see)
            }
        }
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let channels = [channel, self.channels()];
        self.planes.read(self.nodes(), x, channels, region, out, |missing, values| {
            self.fill(x, missing, values)
        })?;
        Ok(0)
    }
}
