//! The directions that colours of a cell's nodes are fitted along, or held out along.

use super::cell_visibility::CellVisibility;
use super::fit::Fit;
use super::views::{Views, held_out_eyes};
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::model::field::RadianceField;

/// Directions of a fit, at most: of functions up to degree 2, and of more.
const MOST: [usize; 2] = [32, 48];
/// A cell that fewer views see is hidden, and its colour hardly matters.
const LEAST: usize = 6;
/// Directions, all around, of a hidden cell.
const HIDDEN: usize = 16;

/// Directions of a fit of a degree, at most.
pub const fn most(degree: usize) -> usize {
    if degree > 2 { MOST[1] } else { MOST[0] }
}

/// The directions along which each cell of a field is seen.
#[derive(Debug)]
pub struct CellViews {
    seen: CellVisibility,
    views: Views,
    /// Directions of a cell, at most.
    most: usize,
}

impl CellViews {
    /// Of the cameras that a fit of a degree uses; from all around if they are few. `geometry` is
    /// the field, whose colours do not count.
    ///
    /// # Errors
    /// Those of reading density, and a request to stop.
    pub fn of_fit(
        geometry: &RadianceField,
        degree: usize,
        cameras: &[[f64; 3]],
        limits: &Limits,
        progress: &dyn Progress,
    ) -> Result<Self> {
        Self::find(geometry, Views::new(cameras), degree, limits, progress)
    }

    /// Of the eyes held out of a fit to these cameras.
    ///
    /// # Errors
    /// Those of reading density, and a request to stop.
    pub fn of_held_out(
        geometry: &RadianceField,
        cameras: &[[f64; 3]],
        limits: &Limits,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let eyes = held_out_eyes(cameras, &geometry.scene.bounds);
        Self::find(geometry, Views::Cameras(eyes), 0, limits, progress)
    }

    /// Of all views that see a cell, as many as a fit of a degree takes.
    ///
    /// # Errors
    /// Those of reading density, and a request to stop.
    pub(super) fn find(
        geometry: &RadianceField,
        views: Views,
        degree: usize,
        limits: &Limits,
        progress: &dyn Progress,
    ) -> Result<Self> {
        Ok(Self {
            seen: CellVisibility::find(geometry, &views, limits, progress)?,
            views,
            most: most(degree),
        })
    }

    /// Bytes that it takes while it is found, at most.
    pub(super) fn memory_bytes(views: &Views) -> u64 {
        CellVisibility::memory_bytes(views)
    }

    /// The cell of a node.
    pub fn cell(&self, node: [usize; 3]) -> [usize; 3] {
        self.seen.cell(node)
    }

    /// Unit directions into the scene along which the middle of a cell is seen.
    pub fn directions(&self, cell: [usize; 3]) -> Vec<[f64; 3]> {
        let (mut views, mut most) = (self.seen.views(cell), self.most);
        if views.len() < LEAST {
            (views, most) = ((0..self.views.count()).collect(), HIDDEN);
        }
        let count = views.len().min(most);
        let middle = self.seen.middle(cell);
        let chosen = (0..count).filter_map(|number| views.get(number * views.len() / count));
        chosen.map(|&view| self.views.at(view, middle).0).collect()
    }

    /// The fit of so many functions to the colours along a cell's directions.
    pub fn fit(&self, cell: [usize; 3], functions: usize) -> Fit {
        Fit::new(&self.directions(cell), functions)
    }
}
