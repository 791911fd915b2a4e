//! The parameters of a model in their file.

use crate::base::error::{Error, Result};
use crate::base::limits::Budget;
use crate::model::grid::Element;
use crate::tensor::Tensor;

/// Bytes that are read at once.
const PIECE: usize = 1 << 20;

/// A matrix in a file.
#[derive(Debug, Clone)]
pub struct Matrix {
    /// Its numbers, by rows.
    pub values: Values,
    /// Rows.
    pub outputs: usize,
    /// Columns.
    pub inputs: usize,
}

/// Consecutive numbers in a file.
#[derive(Debug, Clone)]
pub struct Values {
    /// Of numbers, or of their bytes.
    pub tensor: Tensor,
    /// The numbers' type.
    pub element: Element,
    /// Numbers before the first one.
    pub first: u64,
    /// Numbers from it on.
    pub count: u64,
}

impl Values {
    /// All numbers of a tensor, one after the other.
    ///
    /// # Errors
    /// `Malformed` for numbers that are not floats of 16 or 32 bits.
    pub fn all(tensor: &Tensor) -> Result<Self> {
        let element = tensor.element();
        if !matches!(element, Element::F16 | Element::BF16 | Element::F32) {
            let found = format!("{} numbers", element.name());
            let expected = "float16, bfloat16 or float32";
            return Err(Error::malformed(tensor.place(), found, expected));
        }
        Ok(Self { tensor: tensor.clone(), element, first: 0, count: tensor.count() })
    }

    /// Some of them.
    #[must_use]
    pub fn part(&self, first: u64, count: u64) -> Self {
        Self { first: self.first + first, count, ..self.clone() }
    }

    /// All numbers, which must be finite.
    ///
    /// # Errors
    /// Errors of reading, and `Malformed` for other numbers.
    pub fn read(&self, budget: &mut Budget) -> Result<Vec<f32>> {
        let place = self.tensor.place();
        let count = usize::try_from(self.count).unwrap_or(usize::MAX);
        let mut values: Vec<f32> = budget.zeroed(count, "bytes of parameters", &place)?;
        let storage = self.tensor.storage(budget)?;
        let size = self.element.size();
        let mut bytes = vec![0; PIECE];
        let mut at = self.first * size as u64;
        for values in values.chunks_mut(PIECE / size) {
            let Some(bytes) = bytes.get_mut(..values.len() * size) else { continue };
            storage.read_into(at, bytes)?;
            self.element.decode(bytes, values);
            at += bytes.len() as u64;
        }
        match values.iter().position(|value| !value.is_finite()) {
            None => Ok(values),
            Some(at) => {
                let found = format!("parameter {}, which is not finite", self.first + at as u64);
                Err(Error::malformed(place, found, "finite numbers"))
            }
        }
    }

    /// Shows the bytes of the numbers.
    ///
    /// # Errors
    /// Errors of reading.
    pub fn digest(&self, budget: &mut Budget, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        let mut bytes = vec![0; PIECE];
        let storage = self.tensor.storage(budget)?;
        let size = self.element.size() as u64;
        let (mut at, end) = (self.first * size, (self.first + self.count) * size);
        while at < end {
            let count = usize::try_from(end - at).unwrap_or(PIECE).min(PIECE);
            let Some(bytes) = bytes.get_mut(..count) else { break };
            storage.read_into(at, bytes)?;
            hash(bytes);
            at += count as u64;
        }
        Ok(())
    }
}
