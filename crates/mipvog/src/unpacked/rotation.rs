//! Rotations by multiples of 90 degrees, which map a grid's nodes to nodes.

use crate::model::baked::Group;
use crate::model::grid::Bounds;
use crate::model::harmonics::basis_f64;

/// A rotation by multiples of 90 degrees: of a point `p` it makes `p'` with
/// `p'[a] = ±p[axes[a]]`, negative where `flips[a]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rotation {
    /// The axis that each axis of the result was before.
    pub axes: [usize; 3],
    /// True for the axes of the result that run the other way.
    pub flips: [bool; 3],
}

impl Rotation {
    /// No rotation.
    pub const NONE: Self = Self { axes: [0, 1, 2], flips: [false; 3] };

    /// Quarter turns about x, y and z, counterclockwise as seen against the axis.
    const QUARTERS: [Self; 3] = [
        Self { axes: [0, 2, 1], flips: [false, true, false] },
        Self { axes: [2, 1, 0], flips: [false, false, true] },
        Self { axes: [1, 0, 2], flips: [true, false, false] },
    ];

    /// This many quarter turns about the x axis, then about y, then about z. The axes do not turn.
    pub fn of_quarter_turns(turns: [i32; 3]) -> Self {
        let mut all = Self::NONE;
        for (turns, quarter) in turns.into_iter().zip(Self::QUARTERS) {
            for _ in 0..turns.rem_euclid(4) {
                all = all.then(quarter);
            }
        }
        all
    }

    /// This rotation, followed by another one.
    pub fn then(self, next: Self) -> Self {
        Self {
            axes: next.axes.map(|axis| self.axes[axis]),
            flips: [0, 1, 2].map(|axis| next.flips[axis] != self.flips[next.axes[axis]]),
        }
    }

    /// Lengths along the axes, after the rotation.
    pub fn lengths<T: Copy>(self, lengths: [T; 3]) -> [T; 3] {
        self.axes.map(|axis| lengths[axis])
    }

    /// A vector, after the rotation.
    pub fn vector(self, vector: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.sign(axis) * vector[self.axes[axis]])
    }

    /// A box, after the rotation.
    pub fn bounds(self, bounds: &Bounds) -> Bounds {
        let corner = |own: [f32; 3], other: [f32; 3]| {
            [0, 1, 2].map(|axis| match self.flips[axis] {
                true => -other[self.axes[axis]],
                false => own[self.axes[axis]],
            })
        };
        Bounds { min: corner(bounds.min, bounds.max), max: corner(bounds.max, bounds.min) }
    }

    /// The place, before the rotation, of a node of the rotated grid, which has `sizes` nodes.
    pub fn source(self, sizes: [usize; 3], node: [usize; 3]) -> [usize; 3] {
        let mut source = [0; 3];
        for axis in 0..3 {
            source[self.axes[axis]] = match self.flips[axis] {
                true => sizes[axis] - 1 - node[axis],
                false => node[axis],
            };
        }
        source
    }

    /// A channel of a group after the rotation as a sum of channels before it: pairs of a channel
    /// and a factor.
    ///
    /// Functions of the view direction `d` turn with the field: with coefficients `c` before the
    /// rotation `R`, they are `sum of c_j Y_j(R^-1 d)` after it.
    pub fn channel(self, group: Group, channel: usize) -> Vec<(usize, f64)> {
        let row = |band, function| self.harmonics(band, function).into_iter().enumerate();
        let pairs: Vec<(usize, f64)> = match group {
            Group::Density | Group::Diffuse | Group::Features => vec![(channel, 1.0)],
            Group::Directional => vec![(self.axes[channel], self.sign(channel))],
            Group::Anisotropy => row(2, channel).collect(),
            Group::Band(band) => {
                row(band, channel / 3).map(|(j, factor)| (3 * j + channel % 3, factor)).collect()
            }
        };
        pairs.into_iter().filter(|&(_, factor)| factor != 0.0).collect()
    }

    /// 1, or -1 for an axis of the result that runs the other way.
    pub fn sign(self, axis: usize) -> f64 {
        if self.flips[axis] { -1.0 } else { 1.0 }
    }

    /// Row `i` of the matrix that a band's coefficients are multiplied with: the integrals of
    /// `Y_i(R d) Y_j(d)` over the sphere.
    ///
    /// The 26 directions are the nodes of V. I. Lebedev's rule of degree 7, which is exact for
    /// products of two functions up to band 3.
    fn harmonics(self, band: usize, i: usize) -> Vec<f64> {
        let first = band * band;
        let mut row = vec![0.0; 2 * band + 1];
        for number in (0..27).filter(|&number| number != 13) {
            let corner = [number / 9, number / 3 % 3, number % 3].map(|at| f64::from(at) - 1.0);
            let squares: f64 = corner.iter().map(|at| at * at).sum();
            let weight = match squares {
                1.0 => 1.0 / 21.0,
                2.0 => 4.0 / 105.0,
                _ => 9.0 / 280.0,
            };
            let direction = corner.map(|at| at / squares.sqrt());
            let (before, after) = (basis_f64(direction), basis_f64(self.vector(direction)));
            for (j, entry) in row.iter_mut().enumerate() {
                *entry +=
                    4.0 * std::f64::consts::PI * weight * after[first + i] * before[first + j];
            }
        }
        // Zero entries come out as rounding errors.
        row.iter_mut().filter(|entry| entry.abs() < 1e-12).for_each(|entry| *entry = 0.0);
        row
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All of them.
    fn rotations() -> impl Iterator<Item = Rotation> {
        (0..64).map(|n| Rotation::of_quarter_turns([n / 16, n / 4 % 4, n % 4]))
    }

    #[test]
    fn quarter_turns_are_counterclockwise_and_follow_each_other() {
        let turned = |turns, point| Rotation::of_quarter_turns(turns).vector(point);
        assert_eq!(turned([1, 0, 0], [1.0, 2.0, 3.0]), [1.0, -3.0, 2.0]);
        assert_eq!(turned([0, 1, 0], [1.0, 2.0, 3.0]), [3.0, 2.0, -1.0]);
        assert_eq!(turned([0, 0, 1], [1.0, 2.0, 3.0]), [-2.0, 1.0, 3.0]);
        assert_eq!(turned([1, 0, 1], [1.0, 2.0, 3.0]), [3.0, 1.0, 2.0]);
        assert_eq!(turned([4, -4, 0], [1.0, 2.0, 3.0]), [1.0, 2.0, 3.0]);
        let mut all: Vec<_> =
            rotations().map(|rotation| rotation.vector([1.0, 2.0, 3.0])).collect();
        all.sort_by(|a, b| a.partial_cmp(b).expect("numbers"));
        all.dedup();
        assert_eq!(all.len(), 24);
    }

    #[test]
    fn nodes_and_boxes_turn_as_points_do() {
        let (nodes, bounds) = ([3, 4, 5], Bounds { min: [-1.0, 0.0, 2.0], max: [1.0, 3.0, 6.0] });
        let world = |bounds: &Bounds, sizes: [usize; 3], node: [usize; 3]| {
            [0, 1, 2].map(|axis| {
                let share = node[axis] as f64 / (sizes[axis] - 1) as f64;
                f64::from(bounds.min[axis]) + share * bounds.extent()[axis]
            })
        };
        for rotation in rotations() {
            let (sizes, turned) = (rotation.lengths(nodes), rotation.bounds(&bounds));
            for node in [[0, 0, 0], [1, 2, 1], [2, 1, 2]] {
                let before = world(&bounds, nodes, rotation.source(sizes, node));
                let (want, got) = (rotation.vector(before), world(&turned, sizes, node));
                assert!((0..3).all(|axis| (want[axis] - got[axis]).abs() < 1e-12), "{rotation:?}");
            }
        }
    }

    #[test]
    fn functions_of_the_direction_turn_with_the_field() {
        let direction = [0.36, -0.48, 0.8];
        for rotation in rotations() {
            let (before, after) = (basis_f64(direction), basis_f64(rotation.vector(direction)));
            for band in 1..=3 {
                let first = band * band;
                let count = 2 * band + 1;
                // A field with one coefficient, seen from the same side before and after the
                // rotation.
                for j in 0..count {
                    let row = |i| rotation.harmonics(band, i)[j];
                    let sum: f64 = (0..count).map(|i| row(i) * after[first + i]).sum();
                    assert!((sum - before[first + j]).abs() < 1e-12, "{rotation:?} {band} {j}");
                }
            }
            let turned = |channel: usize| {
                let [(source, factor)] = *rotation.channel(Group::Directional, channel) else {
                    panic!("one source")
                };
                factor * direction[source]
            };
            assert_eq!([0, 1, 2].map(turned), rotation.vector(direction));
        }
    }
}
