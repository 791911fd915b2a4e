//! Sums of products of planes and lines.

use super::parts::{Part, Terms};
use crate::base::error::Result;
use crate::base::limits::Budget;

/// A position along an axis, between two nodes or on one.
#[derive(Debug, Clone, Copy)]
pub struct Tap {
    low: usize,
    high: usize,
    /// The share of `high`, 0 to 1.
    share: f64,
}

impl Tap {
    /// On a node.
    pub const fn on(node: usize) -> Self {
        Self { low: node, high: node, share: 0.0 }
    }

    /// At a position in nodes, clamped to the first and last of `count`.
    #[expect(clippy::cast_possible_truncation, reason = "the position is within the nodes")]
    pub fn at(position: f64, count: usize) -> Self {
        let position = position.clamp(0.0, (count - 1) as f64);
        let low = position.floor();
        let share = position - low;
        let low = low as usize;
        Self { low, high: (low + 1).min(count - 1), share }
    }

    /// The node at or before it.
    pub const fn node(self) -> usize {
        self.low
    }

    /// The two nodes around it, with their shares.
    pub fn corners(self) -> [(usize, f64); 2] {
        [(self.low, 1.0 - self.share), (self.high, self.share)]
    }
}

/// Factors in memory.
#[derive(Debug)]
pub struct Factors {
    terms: Vec<Term>,
}

#[derive(Debug)]
struct Term {
    tables: Vec<Table>,
    width: usize,
}

/// A plane or a line, components fastest.
#[derive(Debug)]
struct Table {
    values: Vec<f32>,
    columns: usize,
    width: usize,
    axes: (usize, Option<usize>),
}

impl Table {
    fn load(part: &Part, nodes: [usize; 3], budget: &mut Budget) -> Result<Self> {
        let width = part.components(nodes)?;
        let stored = part.read(budget)?;
        let mut values = budget.zeroed(stored.len(), "bytes of factors", &part.tensor.place())?;
        let places = stored.len() / width;
        for (component, of_component) in stored.chunks_exact(places).enumerate() {
            let out = values.iter_mut().skip(component).step_by(width);
            out.zip(of_component).for_each(|(out, value)| *out = *value);
        }
        let columns = part.axes.1.map_or(1, |axis| nodes.into_iter().nth(axis).unwrap_or(1));
        Ok(Self { values, columns, width, axes: part.axes })
    }

    /// Multiplies `product` by the components at a position.
    fn multiply(&self, at: &[Tap; 3], scratch: &mut Vec<f64>, product: &mut [f64]) {
        let place = |axis: usize| at.iter().copied().nth(axis).unwrap_or(Tap::on(0));
        let (rows, columns) = (place(self.axes.0), self.axes.1.map_or(Tap::on(0), place));
        scratch.clear();
        scratch.resize(self.width, 0.0);
        for (row, share) in rows.corners() {
            for (column, of_row) in columns.corners() {
                let weight = share * of_row;
                if weight == 0.0 {
                    continue;
                }
                let start = (row * self.columns + column) * self.width;
                let stored = self.values.get(start..start + self.width).unwrap_or_default();
                let sums = scratch.iter_mut().zip(stored);
                sums.for_each(|(sum, value)| *sum += weight * f64::from(*value));
            }
        }
        product.iter_mut().zip(scratch.iter()).for_each(|(product, value)| *product *= value);
    }
}

impl Factors {
    /// Reads all factors.
    ///
    /// # Errors
    /// Errors of reading, and NaN values.
    pub fn load(terms: &Terms, nodes: [usize; 3], budget: &mut Budget) -> Result<Self> {
        let load = |parts: &Vec<Part>, budget: &mut Budget| -> Result<Term> {
            let tables = parts.iter().map(|part| Table::load(part, nodes, budget));
            let tables: Vec<Table> = tables.collect::<Result<_>>()?;
            let width = tables.first().map_or(0, |table| table.width);
            Ok(Term { tables, width })
        };
        let terms = terms.iter().map(|parts| load(parts, budget)).collect::<Result<_>>()?;
        Ok(Self { terms })
    }

    /// The products of all components at a position, term by term.
    pub fn products(&self, at: &[Tap; 3], scratch: &mut Vec<f64>, out: &mut Vec<f64>) {
        out.clear();
        for term in &self.terms {
            let first = out.len();
            out.resize(first + term.width, 1.0);
            let product = out.get_mut(first..).unwrap_or_default();
            term.tables.iter().for_each(|table| table.multiply(at, scratch, product));
        }
    }
}
