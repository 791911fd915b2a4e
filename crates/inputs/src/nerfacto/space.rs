//! The space of a model.
//!
//! ```text
//! m = largest component of a position
//! c = position                          where m <= 1
//! c = (2 - 1/m) position / m            beyond
//! place in the tables = (c + 2) / 4,    or the place in the box where space is not contracted
//! ```
//!
//! Space is empty outside the tables and on their faces.

/// From the world to the cube of the tables.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Space {
    /// All of space.
    Contracted,
    /// A box.
    Box([[f64; 3]; 2]),
}

impl Space {
    /// A position in the cube from 0 to 1; none outside of it.
    pub(super) fn in_cube(&self, position: [f64; 3]) -> Option<[f64; 3]> {
        let mut at = position;
        match self {
            Self::Contracted => {
                let most = norm(position);
                let scale = if most > 1.0 { (2.0 - 1.0 / most) / most } else { 1.0 };
                at.iter_mut().for_each(|at| *at = (*at * scale + 2.0) / 4.0);
            }
            Self::Box([low, high]) => {
                let axes = at.iter_mut().zip(low.iter().zip(high));
                axes.for_each(|(at, (low, high))| *at = (*at - low) / (high - low));
            }
        }
        at.iter().all(|at| *at > 0.0 && *at < 1.0).then_some(at)
    }

    /// The position in the middle of the cube.
    pub(super) fn middle(&self) -> [f64; 3] {
        let Self::Box([low, high]) = self else { return [0.0; 3] };
        let mut middle = *low;
        middle.iter_mut().zip(high).for_each(|(at, high)| *at = 0.5 * (*at + high));
        middle
    }

    /// World units across one unit of the tables' cube.
    pub(super) fn stretch(&self, position: [f64; 3]) -> f64 {
        match self {
            Self::Contracted => {
                let most = norm(position).max(1.0);
                4.0 * most / (2.0 - 1.0 / most)
            }
            Self::Box([low, high]) => {
                low.iter().zip(high).map(|(low, high)| high - low).fold(0.0, f64::max)
            }
        }
    }
}

fn norm(position: [f64; 3]) -> f64 {
    position.iter().fold(0.0, |most: f64, at| most.max(at.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_of_space_is_in_the_cube() {
        for (position, place) in [
            ([0.5, -1.0, 0.0], Some([0.625, 0.25, 0.5])),
            ([2.0, -1.0, 0.0], Some([0.875, 0.3125, 0.5])),
            ([f64::INFINITY, 0.0, 0.0], None),
            ([f64::NAN; 3], None),
        ] {
            assert_eq!(Space::Contracted.in_cube(position), place, "{position:?}");
        }
        assert!(Space::Contracted.in_cube([1e6, 3.0, -1e6]).is_some());
        let own = Space::Box([[-1.0, 0.0, 0.0], [1.0, 2.0, 4.0]]);
        assert_eq!(own.in_cube([0.0, 1.0, 1.0]), Some([0.5, 0.5, 0.25]));
        assert_eq!(own.in_cube([0.0, 1.0, 4.0]), None);
    }
}
