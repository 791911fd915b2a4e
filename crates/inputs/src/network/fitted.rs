//! Harmonics at nodes, fitted to a network along the directions from which each is seen.
//!
//! Directions are those of the node's cell in [`CellViews`]: the middle of the cell represents all
//! of its nodes, so that the fit and the network's direction inputs are prepared once for all of
//! them. The network is evaluated along the same directions, so this adds no error.

use std::fmt::Debug;
use std::sync::Arc;

use super::cell_views::{CellViews, most};
use super::fit::Fit;
use super::planes::{PlaneCache, visit};
use super::views::Views;
use super::visible_nodes::VisibleNodes;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::{Progress, Silent};
use crate::lazy::Lazy;
use crate::model::field::{NodeValues, RadianceField};
use crate::model::grid::{Bounds, Nodes};
use crate::model::harmonics::{BAND_0, FUNCTIONS, Harmonics};

/// Planes that threads fill at once, at most.
const AT_ONCE: u64 = 8;

/// Red, green and blue along directions.
pub type Colors = [Vec<f64>; 3];

/// Finds the colours of a node or a point along directions.
pub type FindColors<'a, Along> = &'a mut dyn FnMut(&Along, &mut Colors);

/// Visits a node `(y, z)` of a plane.
pub type OnNode<'a, Along> = &'a mut dyn FnMut([usize; 2], FindColors<'_, Along>);

/// Network colours at the nodes of a grid.
pub trait NodeColors: Debug + Send + Sync {
    /// The network in memory.
    type Network: Debug + Send + Sync;
    /// Directions, prepared for the network.
    type Along;

    /// Nodes along each axis.
    fn nodes(&self) -> Nodes;

    /// Maximum bytes of a plane with this many directions, and of everything else.
    fn memory_bytes(&self, directions: usize) -> [u64; 2];

    /// Feeds a digest with samples of the bytes that represent all values.
    ///
    /// # Errors
    /// Errors of reading.
    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()>;

    /// Reads the network, and prepares its inputs.
    ///
    /// # Errors
    /// Errors of reading, and a request to stop.
    fn load(&self, progress: &dyn Progress) -> Result<Arc<Self::Network>>;

    /// Prepares unit directions.
    fn along(&self, network: &Self::Network, directions: &[[f64; 3]]) -> Self::Along;

    /// Visits the nodes `(y, z)` of plane `x` in a region (rows of bits along z), row by row. Empty
    /// nodes may be skipped.
    ///
    /// # Errors
    /// Errors of reading.
    fn visit(
        &self,
        network: &Self::Network,
        x: usize,
        region: &[u64],
        on_node: OnNode<'_, Self::Along>,
    ) -> Result<()>;
}

/// The harmonics of colours.
#[derive(Debug)]
pub struct FittedColors<N: NodeColors> {
    pub(super) colors: N,
    /// The rules of the harmonics.
    harmonics: Harmonics,
    /// True for band 0 alone, as colours.
    is_plain: bool,
    /// The field that hides nodes from views.
    pub(super) geometry: RadianceField,
    views: Views,
    /// The space of cameras, if the field surrounds them.
    inner: Option<Bounds>,
    pub(super) limits: Limits,
    prepared: Lazy<Prepared<N::Network>>,
    pub(super) visible: VisibleNodes,
    pub(super) planes: PlaneCache,
}

/// All that nodes have in common.
#[derive(Debug)]
pub(super) struct Prepared<Network> {
    pub(super) network: Arc<Network>,
    pub(super) cells: CellViews,
}

/// All that the nodes of a cell have in common.
#[derive(Debug)]
pub(super) struct Cell<Along> {
    at: [usize; 3],
    fit: Fit,
    pub(super) along: Along,
}

/// The cells of a row of nodes: nodes come row by row.
#[derive(Debug)]
pub(super) struct RowCells<Along>(Vec<Cell<Along>>);

/// All channels of a node; those beyond its own are 0.
pub(super) type Channels = [f32; 3 * FUNCTIONS];

impl<N: NodeColors> FittedColors<N> {
    /// Harmonics for colours as seen from `cameras`, or from all around if there are few.
    /// `geometry` is the field without its colours.
    pub fn new(
        colors: N,
        harmonics: Harmonics,
        geometry: RadianceField,
        cameras: &[[f64; 3]],
        limits: &Limits,
    ) -> Self {
        let (views, limits) = (Views::new(cameras), limits.clone());
        let (prepared, visible, planes) =
            (Lazy::default(), VisibleNodes::default(), PlaneCache::with_archive());
        Self {
            colors,
            harmonics,
            is_plain: false,
            geometry,
            views,
            inner: None,
            limits,
            prepared,
            visible,
            planes,
        }
    }

    /// The same as colours that do not depend on the view.
    #[must_use]
    pub fn plain(self) -> Self {
        Self { harmonics: Harmonics { degree: 0, ..self.harmonics }, is_plain: true, ..self }
    }

    /// The same for a field around the space of the cameras.
    #[must_use]
    pub fn seen_from(self, inner: Bounds) -> Self {
        let views = self.views.within(&inner);
        Self { views, inner: Some(inner), ..self }
    }

    pub(super) fn prepared(&self, progress: &dyn Progress) -> Result<Arc<Prepared<N::Network>>> {
        self.prepared.get(|| {
            let Self { colors, harmonics, geometry, views, limits, .. } = self;
            let network = colors.load(progress)?;
            let cells =
                CellViews::find(geometry, views.clone(), harmonics.degree, limits, progress)?;
            let cells = match self.inner {
                Some(inner) => cells.looking_out_of(inner),
                None => cells,
            };
            Ok(Prepared { network, cells })
        })
    }

    /// The fit of a cell's nodes.
    pub(super) fn cell(&self, prepared: &Prepared<N::Network>, at: [usize; 3]) -> Cell<N::Along> {
        let directions = prepared.cells.directions(at);
        let fit = Fit::new(&directions, self.harmonics.functions());
        Cell { at, fit, along: self.colors.along(&prepared.network, &directions) }
    }

    /// The channels of a place whose colours are those along the directions of its cell.
    #[expect(clippy::cast_possible_truncation, reason = "coefficients are float32")]
    pub(super) fn channels_of(&self, cell: &Cell<N::Along>, colors: &mut Colors) -> Channels {
        let offset = f64::from(self.harmonics.offset);
        colors.iter_mut().flatten().for_each(|value| *value -= offset);
        let found = cell.fit.coefficients(colors).map(|value| value as f32);
        let mut channels = [0.0; 3 * FUNCTIONS];
        channels.iter_mut().zip(found).for_each(|(value, found)| *value = found);
        if self.is_plain {
            let mut color = [0.0; 3 * FUNCTIONS];
            let found = self.harmonics.color(&[BAND_0; FUNCTIONS], &channels);
            color.iter_mut().zip(found).for_each(|(value, found)| *value = found);
            return color;
        }
        channels
    }

    /// All channels of the nodes of plane `x` in a region, channel by channel.
    pub(super) fn fill(&self, x: usize, region: &[u64], values: &mut [f32]) -> Result<()> {
        let prepared = self.prepared(&Silent)?;
        let Nodes([_, ny, nz]) = self.nodes();
        let visible = self.visible.within(&self.geometry, x, region)?;
        let black = if self.is_plain { 0.0 } else { -self.harmonics.offset / BAND_0 };
        visit(self.nodes(), &without(region, &visible), |[y, z]| {
            let out = values.iter_mut().skip(y * nz + z).step_by(ny * nz);
            out.take(3).for_each(|value| *value = black);
        });
        let mut cells = RowCells::default();
        let mut colors = Colors::default();
        self.colors.visit(&prepared.network, x, &visible, &mut |[y, z], find| {
            let at = prepared.cells.cell([x, y, z]);
            let Some(cell) = cells.at(at, || self.cell(&prepared, at)) else { return };
            find(&cell.along, &mut colors);
            let out = values.iter_mut().skip(y * nz + z).step_by(ny * nz);
            out.zip(self.channels_of(cell, &mut colors)).for_each(|(out, value)| *out = value);
        })
    }
}

impl<Along> Default for RowCells<Along> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<Along> RowCells<Along> {
    /// The cell at a place, which is made once a row.
    pub(super) fn at(
        &mut self,
        at: [usize; 3],
        make: impl FnOnce() -> Cell<Along>,
    ) -> Option<&Cell<Along>> {
        if self.0.first().is_some_and(|cell| cell.at[1] != at[1]) {
            self.0.clear();
        }
        let known = self.0.iter().position(|cell| cell.at == at).unwrap_or_else(|| {
            self.0.push(make());
            self.0.len() - 1
        });
        self.0.get(known)
    }
}

/// The bits of a set that are not in another one.
pub(super) fn without(set: &[u64], other: &[u64]) -> Vec<u64> {
    set.iter().zip(other).map(|(set, other)| set & !other).collect()
}

impl<N: NodeColors> NodeValues for FittedColors<N> {
    fn nodes(&self) -> Nodes {
        self.colors.nodes()
    }

    fn channels(&self) -> usize {
        3 * self.harmonics.functions()
    }

    fn memory_bytes(&self) -> u64 {
        let planes = self.planes.bytes(self.nodes(), self.channels());
        let [plane, all] = self.colors.memory_bytes(most(self.harmonics.degree));
        let cells = CellViews::memory_bytes(&self.views);
        planes + self.visible.memory_bytes(self.nodes()) + cells + AT_ONCE * plane + all
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        if let Views::Cameras(places) = &self.views {
            places.iter().flatten().for_each(|value| hash(&value.to_le_bytes()));
        }
        self.colors.digest(hash)
    }

    fn prepare(&self, progress: &dyn Progress) -> Result<()> {
        self.prepared(progress).map(drop)
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let channels = [channel, self.channels()];
        // Before the plane is locked.
        self.prepare(&Silent)?;
        self.planes.read(self.nodes(), x, channels, region, out, |missing, values| {
            self.fill(x, missing, values)
        })?;
        Ok(0)
    }
}
