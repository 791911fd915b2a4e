//! The world's axes and those of a folder.

use crate::base::error::{Error, Place, Result};
use crate::base::limits::Budget;
use crate::tensor::{Tensor, TensorFile, Value};

/// The key of the matrix from the folder's axes to the world's.
const MATRIX: &str = "worldspace_T_opengl";

/// For each axis of the world, the folder's axis and the sign of its direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes([(usize, f64); 3]);

impl Axes {
    /// The axes that a folder states, else the usual ones.
    ///
    /// # Errors
    /// Those of [`Self::of`], and `Malformed` for anything but a matrix.
    pub fn stated(file: &TensorFile, budget: &mut Budget) -> Result<Self> {
        match file.root.get(MATRIX) {
            None | Some(Value::None) => Ok(Self::default()),
            Some(Value::Tensor(matrix)) => Self::of(matrix, budget),
            Some(other) => {
                let place = Place::Key(MATRIX.to_owned());
                Err(Error::malformed(place, other.describe(), "a matrix [4, 4]"))
            }
        }
    }

    /// From a matrix from the folder's directions to the world's.
    ///
    /// # Errors
    /// `Unsupported` unless it swaps and flips axes alone.
    fn of(matrix: &Tensor, budget: &mut Budget) -> Result<Self> {
        let refuse = || {
            let expected = "a matrix [4, 4] that swaps and flips axes";
            Error::unsupported(matrix.place(), "another one", expected)
        };
        if matrix.shape() != [4, 4] {
            return Err(refuse());
        }
        let values = matrix.read_f64(budget)?;
        Self::of_rows(&values).ok_or_else(refuse)
    }

    fn of_rows(values: &[f64]) -> Option<Self> {
        let (mut axes, mut used) = ([(0, 0.0); 3], [false; 3]);
        for (axis, row) in axes.iter_mut().zip(values.chunks_exact(4)) {
            let at = row.iter().take(3).position(|value| value.abs() == 1.0)?;
            let others = row.iter().enumerate().filter(|(column, _)| *column != at);
            let used = used.get_mut(at)?;
            if *used || others.into_iter().any(|(_, value)| *value != 0.0) {
                return None;
            }
            *used = true;
            *axis = (at, row.get(at).copied()?);
        }
        Some(Self(axes))
    }

    /// The folder's axis along an axis of the world, and true if it runs in the opposite direction.
    pub fn of_world(&self, axis: usize) -> (usize, bool) {
        self.0.get(axis).map_or((0, false), |&(of, sign)| (of, sign < 0.0))
    }

    /// Sizes along the world's axes.
    pub fn sizes(&self, own: [usize; 3]) -> [usize; 3] {
        self.0.map(|(axis, _)| own.get(axis).copied().unwrap_or(0))
    }

    /// A direction or position of the folder in the world.
    pub fn to_world(self, own: [f64; 3]) -> [f64; 3] {
        self.0.map(|(axis, sign)| sign * own.get(axis).copied().unwrap_or(0.0))
    }

    /// A direction or position of the world in the folder.
    pub fn within(self, world: [f64; 3]) -> [f64; 3] {
        let mut own = [0.0; 3];
        for ((axis, sign), value) in self.0.into_iter().zip(world) {
            if let Some(own) = own.get_mut(axis) {
                *own = sign * value;
            }
        }
        own
    }
}

impl Default for Axes {
    /// Those of a folder that states none.
    fn default() -> Self {
        Self::of_rows(&crate::snerg::layout::WORLD_OF_GL.concat()).unwrap_or(Self([(0, 1.0); 3]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_turn_there_and_back() {
        let axes = Axes::default();
        assert_eq!(axes.to_world([1.0, 2.0, 3.0]), [-1.0, 3.0, 2.0]);
        assert_eq!(axes.within([-1.0, 3.0, 2.0]), [1.0, 2.0, 3.0]);
        assert_eq!(axes.sizes([5, 6, 7]), [5, 7, 6]);
        assert_eq!((axes.of_world(0), axes.of_world(1)), ((0, true), (2, false)));
        let mut turned = crate::snerg::layout::WORLD_OF_GL.concat();
        turned[0] = 0.5;
        assert_eq!(Axes::of_rows(&turned), None);
        (turned[0], turned[3]) = (-1.0, 0.25);
        assert_eq!(Axes::of_rows(&turned), None);
    }
}
