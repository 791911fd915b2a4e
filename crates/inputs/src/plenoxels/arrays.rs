//! The arrays of a model.

use std::sync::Arc;

use crate::base::error::{Error, Place, Result};
use crate::sparse::{CellBox, Index, RowArray};

/// Numbers of coefficients of harmonics of degree 0 to 3.
const FUNCTIONS: [usize; 4] = [1, 4, 9, 16];
/// The arrays of a model.
#[derive(Debug, Clone)]
pub(super) struct Arrays {
    pub(super) index: Arc<Index>,
    pub(super) density: Arc<RowArray>,
    pub(super) color: Arc<RowArray>,
    /// The column of density in its array, and the first one of colour.
    pub(super) columns: [usize; 2],
    /// Coefficients of a colour.
    pub(super) functions: usize,
    pub(super) cells: CellBox,
}

impl Arrays {
    /// Refuses rows of colour that do not match those of density or are not harmonics.
    pub(super) fn checked(self, place: &Place) -> Result<Self> {
        if self.density.rows() != self.color.rows() {
            let found = format!("{} rows", self.color.rows());
            let expected = format!("{}, as density has", self.density.rows());
            return Err(Error::malformed(place.clone(), found, expected));
        }
        let colors = self.color.width() - self.columns[1];
        if colors.is_multiple_of(3) && FUNCTIONS.contains(&self.functions) {
            return Ok(self);
        }
        let found = format!("{colors} coefficients a row");
        let expected = "three times 1, 4, 9 or 16: harmonics of degree 0 to 3";
        Err(Error::unsupported(place.clone(), found, expected))
    }
}
