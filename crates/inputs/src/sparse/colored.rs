//! Rows in memory as density and colour at any position.

use super::loaded::{Cell, LoadedRows};
use super::path::Lattice;
use crate::model::activate;
use crate::model::harmonics::{Clamp, Harmonics, basis_f64};

/// Rows, their places, and the meaning of their colours.
#[derive(Debug)]
pub struct ColoredRows {
    /// The rows.
    pub rows: LoadedRows,
    /// The world in nodes of the rows.
    pub lattice: Lattice,
    /// Coefficients of a colour in a row.
    pub stored: usize,
    /// None for plain colours.
    pub harmonics: Option<Harmonics>,
}

impl ColoredRows {
    /// The colour in a cell along a direction with known function values.
    pub fn color(&self, cell: &Cell, functions: &[f64]) -> [f64; 3] {
        let sums = self.rows.color(cell, functions, self.stored);
        let Some(rules) = &self.harmonics else { return sums };
        let sums = sums.map(|sum| sum + f64::from(rules.offset));
        match rules.clamp {
            Clamp::Zero => sums.map(|sum| sum.max(0.0)),
            Clamp::None => sums,
            Clamp::Sigmoid => sums.map(activate::sigmoid),
        }
    }

    /// The values of the used functions in a unit direction; for plain colours, the colour itself.
    pub fn functions(&self, direction: [f64; 3]) -> Vec<f64> {
        match &self.harmonics {
            Some(rules) => basis_f64(direction).into_iter().take(rules.functions()).collect(),
            None => vec![1.0],
        }
    }

    /// Density at a position of the world; 0 outside.
    pub fn density(&self, position: [f64; 3]) -> f64 {
        let at = self.lattice.to_nodes(position);
        match self.lattice.contains(at) {
            true => self.rows.density(&self.rows.cell(self.rows.clamped(at))),
            false => 0.0,
        }
    }

    /// The colours at a position, seen along unit directions.
    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    pub fn colors(&self, position: [f64; 3], directions: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let cell = self.rows.cell(self.rows.clamped(self.lattice.to_nodes(position)));
        let colors = directions.iter().map(|&direction| {
            self.color(&cell, &self.functions(direction)).map(|value| value as f32)
        });
        colors.collect()
    }
}
