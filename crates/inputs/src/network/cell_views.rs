//! The directions that colours of a cell's nodes are fitted along, or held out along.

use super::cell_visibility::CellVisibility;
use super::fit::Fit;
use super::views::{Views, held_out_eyes, held_out_within};
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::model::field::RadianceField;
use crate::model::grid::Bounds;

/// Directions of a fit, at most: of functions up to degree 2, and of more.
const MOST: [usize; 2] = [32, 48];
/// A cell with fewer views is hidden, and its colour hardly matters.
const LEAST: usize = 6;
/// Directions, all around, of a hidden cell.
const HIDDEN: usize = 16;
/// Directions of a cell around the space of cameras that none of them sees.
const OUT_OF_SIGHT: usize = 2;

/// Directions of a fit of a degree, at most.
pub const fn most(degree: usize) -> usize {
    if degree > 2 { MOST[1] } else { MOST[0] }
}

/// The directions along which each cell of a field is seen.
#[derive(Debug)]
pub struct CellViews {
    seen: CellVisibility,
    views: Views,
    /// The space that contains the views.
    inner: Option<Bounds>,
    /// Directions of a cell, at most.
    most: usize,
}

impl CellViews {
    /// For views from within a box to its surroundings; cells inside the box are seen from all
    /// around.
    pub(super) fn looking_out_of(self, inner: Bounds) -> Self {
        Self { inner: Some(inner), ..self }
    }

    /// For the cameras of a fit of a degree. If there are few, views from all around, or from
    /// places in `inner` if `geometry` surrounds that box. Colours of `geometry` are ignored.
    ///
    /// # Errors
    /// Errors of reading density, and a request to stop.
    pub fn of_fit(
        geometry: &RadianceField,
        degree: usize,
        cameras: &[[f64; 3]],
        inner: Option<Bounds>,
        limits: &Limits,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let views = Views::new(cameras);
        let views = inner.map_or_else(|| views.clone(), |inner| views.within(&inner));
        let found = Self::find(geometry, views, degree, limits, progress)?;
        Ok(Self { inner, ..found })
    }

    /// For the held-out eyes of a fit to these cameras.
    ///
    /// # Errors
    /// Errors of reading density, and a request to stop.
    pub fn of_held_out(
        geometry: &RadianceField,
        cameras: &[[f64; 3]],
        inner: Option<Bounds>,
        limits: &Limits,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let eyes = match inner {
            Some(inner) => held_out_within(cameras, &inner),
            None => Views::Cameras(held_out_eyes(cameras, &geometry.scene.bounds)),
        };
        let found = Self::find(geometry, eyes, 0, limits, progress)?;
        Ok(Self { inner, ..found })
    }

    /// For all views that see a cell, up to the limit of a fit of a degree.
    ///
    /// # Errors
    /// Errors of reading density, and a request to stop.
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
            inner: None,
            most: most(degree),
        })
    }

    /// Maximum bytes during its computation.
    pub(super) fn memory_bytes(views: &Views) -> u64 {
        CellVisibility::memory_bytes(views)
    }

    /// The cell of a node.
    pub fn cell(&self, node: [usize; 3]) -> [usize; 3] {
        self.seen.cell(node)
    }

    /// True for a cell that hardly any view sees.
    pub(super) fn is_hidden(&self, cell: [usize; 3]) -> bool {
        self.inner.is_none() && self.seen.views(cell).len() < LEAST
    }

    /// Unit directions into the scene along which the middle of a cell is seen.
    pub fn directions(&self, cell: [usize; 3]) -> Vec<[f64; 3]> {
        let (middle, mut seen, mut most) =
            (self.seen.middle(cell), self.seen.views(cell), self.most);
        if let Some(inner) = &self.inner {
            if contains(inner, middle) {
                let around = Views::around();
                return chosen(&around, &(0..around.count()).collect::<Vec<_>>(), HIDDEN, middle);
            }
            if seen.is_empty() {
                let all: Vec<usize> = (0..self.views.count()).collect();
                return chosen(&self.views, &all, OUT_OF_SIGHT, middle);
            }
        } else if seen.len() < LEAST {
            (seen, most) = ((0..self.views.count()).collect(), HIDDEN);
        }
        chosen(&self.views, &seen, most, middle)
    }

    /// The fit of this many functions to the colours along a cell's directions.
    pub fn fit(&self, cell: [usize; 3], functions: usize) -> Fit {
        Fit::new(&self.directions(cell), functions)
    }
}

/// Unit directions of some views to a position, `most` at most.
fn chosen(views: &Views, seen: &[usize], most: usize, position: [f64; 3]) -> Vec<[f64; 3]> {
    let count = seen.len().min(most);
    let chosen = (0..count).filter_map(|number| seen.get(number * seen.len() / count));
    chosen.map(|&view| views.at(view, position).0).collect()
}

fn contains(bounds: &Bounds, position: [f64; 3]) -> bool {
    let corners = bounds.min.into_iter().zip(bounds.max);
    let within =
        |(at, (min, max)): (f64, (f32, f32))| (f64::from(min)..=f64::from(max)).contains(&at);
    position.into_iter().zip(corners).all(within)
}
