//! Planes and lines in their file, and the rules of their products.

use std::ops::Range;

use crate::base::error::{Error, Result};
use crate::base::limits::{self, Budget};
use crate::tensor::Tensor;

/// The shape of a plane or a line in its file, and the axes it runs along.
#[derive(Debug, Clone)]
pub struct Part {
    pub tensor: Tensor,
    /// The axis of rows, and that of columns; a line has one column.
    pub axes: (usize, Option<usize>),
}

impl Part {
    /// One of several parts of an array `[parts, components, rows, columns]`, with some of its
    /// components.
    ///
    /// # Errors
    /// `Malformed` if the array does not have them.
    pub fn of(
        array: &Tensor,
        number: u64,
        components: Range<u64>,
        axes: (usize, Option<usize>),
    ) -> Result<Self> {
        Ok(Self { tensor: array.part(number, components)?, axes })
    }

    /// Its values, component by component.
    pub(super) fn read(&self, budget: &mut Budget) -> Result<Vec<f32>> {
        let (tensor, place) = (&self.tensor, self.tensor.place());
        // A part of an array has no checksum, so the whole array is verified here.
        let storage = tensor.storage(budget)?;
        let length = |count| limits::product(&[count], "bytes of factors", &place);
        let mut bytes: Vec<u8> =
            budget.zeroed(length(tensor.bytes())?, "bytes of factors", &place)?;
        storage.read_into(0, &mut bytes)?;
        let mut values = budget.zeroed(length(tensor.count())?, "bytes of factors", &place)?;
        tensor.element().decode(&bytes, &mut values);
        match values.iter().find(|value| !value.is_finite()) {
            None => Ok(values),
            Some(value) => {
                let found = format!("the value {value}");
                Err(Error::malformed(place, found, "finite numbers"))
            }
        }
    }

    /// Refuses shapes other than `[1, components, rows, columns]`; returns the components.
    pub(super) fn components(&self, nodes: [usize; 3]) -> Result<usize> {
        let count = |axis: usize| nodes.into_iter().nth(axis).unwrap_or(1) as u64;
        let (rows, columns) = (count(self.axes.0), self.axes.1.map_or(1, count));
        match self.tensor.shape() {
            &[1, components @ 1..=4096, r, c] if (r, c) == (rows, columns) => {
                Ok(usize::try_from(components).unwrap_or(0))
            }
            shape => {
                let expected = format!("[1, components, {rows}, {columns}]");
                let found = format!("shape {shape:?}");
                Err(Error::malformed(self.tensor.place(), found, expected))
            }
        }
    }
}

/// The parts whose product is a term; a model has one or three terms.
pub type Terms = Vec<Vec<Part>>;

/// The components of all terms.
///
/// # Errors
/// `Malformed` if shapes are not those of the nodes, or parts of a term differ.
pub fn components(terms: &Terms, nodes: [usize; 3]) -> Result<usize> {
    let mut sum = 0;
    for term in terms {
        let mut width = None;
        for part in term {
            let found = part.components(nodes)?;
            if *width.get_or_insert(found) != found {
                let found = format!("{found} components");
                let expected = "the same number in each factor of a product";
                return Err(Error::malformed(part.tensor.place(), found, expected));
            }
        }
        sum += width.unwrap_or(0);
    }
    Ok(sum)
}
