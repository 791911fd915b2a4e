//! Harmonics at nodes, fitted to a network along the directions from which each is seen.
//!
//! Directions are those of the node's cell of [`Seen`]: the middle of the cell stands for all of
//! its nodes, so that the fit and the first layer of the network are prepared once for all of
//! them. The network is asked along these very directions, so no error comes of that.

use std::sync::{Arc, Mutex};

use super::batch::{Batch, BatchNetwork, Scratch};
use super::fit::Fit;
use super::planes::{PlaneCache, lock};
use super::run::{Network, NetworkFile};
use super::seen::Seen;
use super::views::Views;
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::model::field::{NodeValues, RadianceField};
use crate::model::grid::Nodes;
use crate::model::harmonics::{BAND_0, FUNCTIONS, Harmonics};

/// Directions of a fit, at most: of functions up to degree 2, and of more.
const MOST: [usize; 2] = [32, 48];
/// Cells of a row, for each of some threads.
const CELLS_AT_ONCE: u64 = 64 * 8;
/// A cell that fewer views see is hidden, and its colour hardly matters.
const LEAST: usize = 6;
/// Directions, all around, of a hidden cell.
const HIDDEN: usize = 16;

/// The inputs of a network at the nodes of a grid.
pub trait NodeFeatures: std::fmt::Debug + Send + Sync {
    /// Nodes along each axis.
    fn nodes(&self) -> Nodes;

    /// Bytes that are in memory while planes are read, at most.
    fn memory_bytes(&self) -> u64;

    /// Feeds a digest with samples of the bytes that stand for all values.
    ///
    /// # Errors
    /// Those of reading.
    fn digest(&self, see: &mut dyn FnMut(&[u8])) -> Result<()>;

    /// Shows the features of each node `(y, z)` of plane `x` in a region (rows of bits along z),
    /// row by row.
    ///
    /// # Errors
    /// Those of reading.
    fn visit(
        &self,
        x: usize,
        region: &[u64],
        see: &mut dyn FnMut([usize; 2], &[f64]),
    ) -> Result<()>;
}

/// The colours to fit.
#[derive(Debug)]
pub struct FittedColors {
    features: Arc<dyn NodeFeatures>,
    network: NetworkFile,
    /// The rules of the harmonics.
    harmonics: Harmonics,
    /// True for band 0 alone, as colours.
    is_plain: bool,
    /// What hides a node from a view.
    matter: RadianceField,
    views: Views,
    limits: Limits,
    prepared: Mutex<Option<Arc<Prepared>>>,
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
        features: Arc<dyn NodeFeatures>,
        network: NetworkFile,
        harmonics: Harmonics,
        matter: RadianceField,
        cameras: &[[f64; 3]],
        limits: &Limits,
    ) -> Self {
        let (views, limits) = (Views::new(cameras), limits.clone());
        let (prepared, planes) = (Mutex::default(), PlaneCache::default());
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
        let mut kept = lock(&self.prepared);
        if let Some(prepared) = &*kept {
            return Ok(Arc::clone(prepared));
        }
        let network = self.network.load(&mut Budget::new(&self.limits))?;
        let batches = BatchNetwork::new(&network);
        let seen = Seen::find(&self.matter, &self.views, &self.limits)?;
        let prepared = Arc::new(Prepared { network, batches, seen });
        *kept = Some(Arc::clone(&prepared));
        Ok(prepared)
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
        self.features.visit(x, region, &mut |[y, z], features| {
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
            batches.colors(network, &cell.batch, features, position, &mut scratch, &mut colors);
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
        })
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
        let planes = PlaneCache::bytes(self.nodes(), self.channels());
        let cells = Batch::bytes(self.most(), self.network.hidden_width()) * CELLS_AT_ONCE;
        planes + self.features.memory_bytes() + Seen::memory_bytes(&self.views) + cells
    }

    fn digest(&self, see: &mut dyn FnMut(&[u8])) -> Result<()> {
        if let Views::Cameras(places) = &self.views {
            places.iter().flatten().for_each(|value| see(&value.to_le_bytes()));
        }
        self.features.digest(see)
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let channels = [channel, self.channels()];
        self.planes.read(self.nodes(), x, channels, region, out, |missing, values| {
            self.fill(x, missing, values)
        })?;
        Ok(0)
    }
}
