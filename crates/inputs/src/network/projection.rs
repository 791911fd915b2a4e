//! Values at nodes whose interpolation comes closest to values at points between them.
//!
//! ```text
//! minimise  sum over points p of v(p) |sum of h_i(p) c_i - t(p)|^2
//!           + RIDGE sum over nodes i of W_i |c_i - m_i|^2
//!
//! h_i(p) = share of node i in the interpolation at p      v(p) = weight of the point
//! W_i    = sum of v(p) h_i(p)                             m_i  = sum of v(p) h_i(p) t(p) / W_i
//! ```
//!
//! The matrix has 27 columns a node, the same for all channels. A few steps of conjugate gradients,
//! preconditioned by `W`, lead from the means `m` to nearly all of the gain.

use super::node_set::NodeSet;
use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::parallel;
use crate::model::grid::Nodes;

/// Nodes around a node, and itself.
const AROUND: usize = 27;
/// Weight of the way to the mean of a node's points.
const RIDGE: f64 = 1e-2;
/// Steps of conjugate gradients.
const STEPS: usize = 6;
/// Marks neighbours that are not in the set.
const NONE: u32 = u32::MAX;

/// Sums over the points of the cells between two planes, for the nodes of both.
#[derive(Debug)]
pub(super) struct Slab {
    /// The number of the first node.
    start: usize,
    matrix: Vec<[f32; AROUND]>,
    /// All channels of a node, then those of the next one.
    sums: Vec<f32>,
    channels: usize,
}

impl Slab {
    /// Of the cells between planes `x` and `x + 1`, without points.
    pub(super) fn new(set: &NodeSet, x: usize, channels: usize) -> Self {
        let (start, end) = (set.start(x), set.start(x + 2));
        let matrix = vec![[0.0; AROUND]; end - start];
        Self { start, sums: vec![0.0; (end - start) * channels], matrix, channels }
    }

    /// Adds a point of a cell: the numbers of the corners, their shares, its weight and its values.
    pub(super) fn add(
        &mut self,
        corners: &[usize; 8],
        shares: &[f32; 8],
        weight: f32,
        values: impl Iterator<Item = f32> + Clone,
    ) {
        for ((number, share), corner) in corners.iter().zip(shares).zip(0..8usize) {
            let by = weight * share;
            let at = number - self.start;
            let Some(row) = self.matrix.get_mut(at) else { continue };
            for (other, of_other) in shares.iter().enumerate() {
                if let Some(sum) = row.get_mut(column(corner, other)) {
                    *sum += by * of_other;
                }
            }
            let sums = self.sums.iter_mut().skip(at * self.channels).take(self.channels);
            sums.zip(values.clone()).for_each(|(sum, value)| *sum += by * value);
        }
    }
}

/// The column of corner `other` of a cell in the row of corner `own`: x, y and z of a corner are its
/// bits, from the highest one.
fn column(own: usize, other: usize) -> usize {
    (0..3).fold(0, |column, axis| {
        let bit = |corner: usize| corner >> (2 - axis) & 1;
        3 * column + 1 + bit(other) - bit(own)
    })
}

/// The equations of all nodes of a set.
#[derive(Debug)]
pub(super) struct Equations {
    matrix: Vec<[f32; AROUND]>,
    neighbours: Vec<[u32; AROUND]>,
    /// Channel by channel.
    sums: Vec<f32>,
    channels: usize,
}

impl Equations {
    /// Bytes for a node at most, with the vectors of a channel on each of a few threads.
    pub(super) const fn bytes_of_node(channels: usize) -> u64 {
        (8 * AROUND + 4 * channels + 5 * 8 * 2) as u64
    }

    /// The equations of a set, without points.
    ///
    /// # Errors
    /// More memory than the limits allow.
    pub(super) fn new(
        set: &NodeSet,
        nodes: Nodes,
        channels: usize,
        limits: &Limits,
    ) -> Result<Self> {
        let mut budget = Budget::new(limits);
        let (what, place) = ("bytes of a fit between nodes", Place::Key("colours".to_owned()));
        let count = set.count();
        let mut neighbours: Vec<[u32; AROUND]> = budget.zeroed(count, what, &place)?;
        let Nodes([nx, _, _]) = nodes;
        for x in 0..nx {
            let mut own = neighbours.iter_mut().skip(set.start(x));
            set.visit(x, |[y, z]| {
                let Some(own) = own.next() else { return };
                for (column, neighbour) in own.iter_mut().enumerate() {
                    let moved = |at: usize, by: usize| (at + by % 3).checked_sub(1);
                    let at = (moved(x, column / 9), moved(y, column / 3), moved(z, column));
                    let number = match at {
                        (Some(x), Some(y), Some(z)) => set.number([x, y, z]),
                        _ => None,
                    };
                    *neighbour = number.and_then(|at| u32::try_from(at).ok()).unwrap_or(NONE);
                }
            });
        }
        Ok(Self {
            matrix: budget.zeroed(count, what, &place)?,
            neighbours,
            sums: budget.zeroed(count * channels, what, &place)?,
            channels,
        })
    }

    /// Adds the sums of a slab.
    pub(super) fn add(&mut self, slab: &Slab) {
        let rows = self.matrix.iter_mut().skip(slab.start).zip(&slab.matrix);
        rows.for_each(|(row, own)| row.iter_mut().zip(own).for_each(|(sum, own)| *sum += own));
        let count = self.matrix.len();
        for (channel, sums) in self.sums.chunks_exact_mut(count.max(1)).enumerate() {
            let own = slab.sums.iter().skip(channel).step_by(slab.channels);
            sums.iter_mut().skip(slab.start).zip(own).for_each(|(sum, own)| *sum += own);
        }
    }

    /// The values of each channel, nodes in order; and whether a node has points, without which its
    /// values are 0.
    ///
    /// # Errors
    /// None of its own.
    pub(super) fn solve(mut self) -> Result<(Vec<f32>, Vec<bool>)> {
        let weights: Vec<f64> =
            self.matrix.iter().map(|row| row.iter().copied().map(f64::from).sum()).collect();
        let count = weights.len();
        let mut sums = std::mem::take(&mut self.sums);
        let mut channels: Vec<&mut [f32]> = sums.chunks_exact_mut(count.max(1)).collect();
        parallel::map_mut(&mut channels, |_, values| {
            self.solve_channel(&weights, values);
            Ok(())
        })?;
        debug_assert_eq!(sums.len(), count * self.channels);
        Ok((sums, weights.iter().map(|weight| *weight > 0.0).collect()))
    }

    /// Puts the values of a channel in place of its sums.
    #[expect(clippy::cast_possible_truncation, reason = "values are float32")]
    fn solve_channel(&self, weights: &[f64], values: &mut [f32]) {
        let divided = |by: f64, weight: f64| if weight > 0.0 { by / weight } else { 0.0 };
        let pairs = values.iter().zip(weights);
        let mut found: Vec<f64> =
            pairs.map(|(&sum, &weight)| divided(sum.into(), weight)).collect();
        let mut product = vec![0.0; found.len()];
        self.multiply(weights, &found, &mut product);
        // The ridge pulls towards the means, where the search begins.
        let mut rest: Vec<f64> = (values.iter().zip(weights).zip(&found).zip(&product))
            .map(|(((&sum, weight), mean), product)| {
                f64::from(sum) + RIDGE * weight * mean - product
            })
            .collect();
        let scaled = |rest: &[f64]| -> Vec<f64> {
            rest.iter().zip(weights).map(|(&rest, &weight)| divided(rest, weight)).collect()
        };
        let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        let mut along = scaled(&rest);
        let mut length = dot(&rest, &along);
        for _ in 0..STEPS {
            self.multiply(weights, &along, &mut product);
            let curvature = dot(&along, &product);
            if curvature.is_nan() || curvature <= 0.0 || length <= 0.0 {
                break;
            }
            let by = length / curvature;
            found.iter_mut().zip(&along).for_each(|(found, along)| *found += by * along);
            rest.iter_mut().zip(&product).for_each(|(rest, product)| *rest -= by * product);
            let next = scaled(&rest);
            let (before, now) = (length, dot(&rest, &next));
            let kept = now / before;
            along.iter_mut().zip(next).for_each(|(along, next)| *along = next + kept * *along);
            length = now;
        }
        values.iter_mut().zip(found).for_each(|(value, found)| *value = found as f32);
    }

    /// The matrix with its ridge, times a vector.
    fn multiply(&self, weights: &[f64], vector: &[f64], out: &mut [f64]) {
        let rows = self.matrix.iter().zip(&self.neighbours).zip(weights).zip(vector);
        for (out, (((row, neighbours), weight), own)) in out.iter_mut().zip(rows) {
            let terms = row.iter().zip(neighbours).map(|(&factor, &number)| {
                f64::from(factor) * vector.get(number as usize).copied().unwrap_or(0.0)
            });
            *out = terms.sum::<f64>() + RIDGE * weight * own;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::node_set::corner_shares;
    use super::*;
    use crate::model::grid::NodeMask;

    const COUNTS: [usize; 3] = [3, 4, 5];

    /// A point: its cell, its place in it, its weight and its value.
    type At = ([usize; 3], [f64; 3], f64, f64);

    /// Four points of each cell.
    fn points(value: impl Fn([f64; 3]) -> f64) -> Vec<At> {
        let mut seed = 5u32;
        let mut noise = move || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 8) / f64::from(1 << 24)
        };
        let [nx, ny, nz] = COUNTS;
        let mut points = Vec::new();
        for at in 0..4 * (nx - 1) * (ny - 1) * (nz - 1) {
            let cell =
                [at / 4 / (nz - 1) / (ny - 1), at / 4 / (nz - 1) % (ny - 1), at / 4 % (nz - 1)];
            let inside = [(); 3].map(|()| noise());
            let place = [0, 1, 2].map(|axis| cell[axis] as f64 + inside[axis]);
            points.push((cell, inside, 0.1 + noise(), value(place)));
        }
        points
    }

    fn corner_numbers(set: &NodeSet, cell: [usize; 3]) -> [usize; 8] {
        [0usize, 1, 2, 3, 4, 5, 6, 7].map(|corner| {
            let up = [corner >> 2, corner >> 1 & 1, corner & 1];
            set.number([0, 1, 2].map(|axis| cell[axis] + up[axis])).expect("a node")
        })
    }

    fn solved(points: &[At]) -> (NodeSet, Vec<f32>) {
        let (nodes, full) = (Nodes(COUNTS), NodeMask::full(Nodes(COUNTS)));
        let set = NodeSet::new(nodes, (0..COUNTS[0]).map(|x| full.plane(x).to_vec()).collect());
        let limits = Limits::default();
        let mut equations = Equations::new(&set, nodes, 2, &limits).expect("little memory");
        for x in 0..COUNTS[0] - 1 {
            let mut slab = Slab::new(&set, x, 2);
            for (cell, inside, weight, value) in points.iter().filter(|point| point.0[0] == x) {
                let shares = corner_shares(*inside).map(|share| share as f32);
                // The second channel is the first one twice.
                let values = [*value as f32, 2.0 * *value as f32];
                let corners = corner_numbers(&set, *cell);
                slab.add(&corners, &shares, *weight as f32, values.into_iter());
            }
            equations.add(&slab);
        }
        let (values, has_points) = equations.solve().expect("no failure");
        assert!(has_points.into_iter().all(|has| has));
        (set, values)
    }

    /// The sum that is minimised, in float64.
    fn cost(set: &NodeSet, points: &[At], values: &[f64]) -> f64 {
        let mut sums = vec![[0.0; 2]; set.count()];
        let mut cost = 0.0;
        for (cell, inside, weight, value) in points {
            let mut between = 0.0;
            for (number, share) in
                corner_numbers(set, *cell).into_iter().zip(corner_shares(*inside))
            {
                between += share * values[number];
                sums[number][0] += weight * share;
                sums[number][1] += weight * share * value;
            }
            cost += weight * (between - value).powi(2);
        }
        let pulls = sums.iter().zip(values);
        cost + pulls.map(|([w, sum], c)| RIDGE * w * (c - sum / w).powi(2)).sum::<f64>()
    }

    /// The weighted means of the points around each node.
    fn means(set: &NodeSet, points: &[At]) -> Vec<f64> {
        let mut sums = vec![[0.0; 2]; set.count()];
        for (cell, inside, weight, value) in points {
            for (number, share) in
                corner_numbers(set, *cell).into_iter().zip(corner_shares(*inside))
            {
                sums[number][0] += weight * share;
                sums[number][1] += weight * share * value;
            }
        }
        sums.into_iter().map(|[weight, sum]| sum / weight).collect()
    }

    /// The minimum, by very many small steps of each value in turn.
    fn minimum(set: &NodeSet, points: &[At], from: &[f64]) -> f64 {
        let mut values = from.to_vec();
        for _ in 0..60 {
            for number in 0..values.len() {
                // A parabola along each value: three points tell its lowest one.
                let at = values[number];
                let costs = [at - 1.0, at, at + 1.0].map(|value| {
                    values[number] = value;
                    cost(set, points, &values)
                });
                let bend = costs[0] - 2.0 * costs[1] + costs[2];
                values[number] = at + 0.5 * (costs[0] - costs[2]) / bend;
            }
        }
        cost(set, points, &values)
    }

    #[test]
    fn values_are_nearly_the_best_ones() {
        let points = points(|[x, y, z]| (2.1 * x + 0.4 * y).sin() + (1.7 * z).cos() * y);
        let (set, values) = solved(&points);
        let (first, second) = values.split_at(set.count());
        assert!(first.iter().zip(second).all(|(a, b)| (2.0 * a - b).abs() < 1e-4));
        let found: Vec<f64> = first.iter().copied().map(f64::from).collect();
        let (own, least) = (cost(&set, &points, &found), minimum(&set, &points, &found));
        let from_means = cost(&set, &points, &means(&set, &points));
        assert!(own - least < 0.02 * (from_means - least), "{own} of {from_means} to {least}");
    }

    #[test]
    fn what_is_linear_between_nodes_is_found_again() {
        let points = points(|[x, y, z]| 0.3 + x * y - 0.2 * z);
        let (set, values) = solved(&points);
        let found: Vec<f64> = values[..set.count()].iter().copied().map(f64::from).collect();
        // All that is left is the pull to the means.
        let left = cost(&set, &points, &found) / cost(&set, &points, &means(&set, &points));
        assert!(left < 0.15, "{left}");
    }
}
