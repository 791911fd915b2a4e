//! Regular lattices of points over a field's box: the nodes of a level and points between them, or
//! the corners of equal cubes.

use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::model::grid::{Bounds, Nodes};

/// An axis-aligned lattice of points.
#[derive(Debug, Clone, PartialEq)]
pub struct Lattice {
    /// Positions of the points along each axis, as fractions of the field's box.
    shares: [Vec<f64>; 3],
    /// World position of the first point.
    pub first: [f64; 3],
    /// Distance between neighbours along each axis, in world units.
    pub spacing: [f64; 3],
}

impl Lattice {
    /// The nodes of a level that spans a box, with `factor - 1` more points between neighbours.
    ///
    /// # Errors
    ///
    /// More points than the limits allow.
    pub fn of_nodes(bounds: &Bounds, nodes: Nodes, factor: usize, limits: &Limits) -> Result<Self> {
        let cells = nodes.0.map(|size| size - 1);
        check_counts(cells.map(|cells| cells.saturating_mul(factor).saturating_add(1)), limits)?;
        let shares = cells.map(|cells| {
            (0..=cells * factor)
                .map(|i| {
                    let at = (i / factor) as f64 + (i % factor) as f64 / factor as f64;
                    let mut share = at / cells as f64;
                    // Rounding must not place a node below itself: it would be interpolated.
                    while share * (cells as f64) < at {
                        share = share.next_up();
                    }
                    share.min(1.0)
                })
                .collect()
        });
        let extent = bounds.extent();
        let spacing = [0, 1, 2].map(|axis| extent[axis] / (cells[axis] * factor) as f64);
        Ok(Self { shares, first: bounds.min.map(f64::from), spacing })
    }

    /// The corners of equal cubes, `count` along the longest axis of a box. The last cubes may
    /// extend beyond the box.
    ///
    /// # Errors
    ///
    /// More points than the limits allow.
    pub fn of_cubes(bounds: &Bounds, count: usize, limits: &Limits) -> Result<Self> {
        let extent = bounds.extent();
        let edge = extent.into_iter().fold(0.0, f64::max) / count as f64;
        // A cube that overhangs only by rounding does not count.
        let cubes = extent.map(|extent| (extent / edge - 1e-6).ceil().max(1.0) as usize);
        check_counts(cubes.map(|cubes| cubes + 1), limits)?;
        // A share that is outside the box only by rounding is on its face.
        let snapped = |share: f64| if (share - 1.0).abs() < 1e-6 { 1.0 } else { share };
        let shares = [0, 1, 2].map(|axis| {
            (0..=cubes[axis]).map(|i| snapped(i as f64 * edge / extent[axis])).collect()
        });
        Ok(Self { shares, first: bounds.min.map(f64::from), spacing: [edge; 3] })
    }

    /// Number of points along each axis.
    pub fn counts(&self) -> [usize; 3] {
        [0, 1, 2].map(|axis| self.shares[axis].len())
    }

    /// The position of a point as fractions of the box, from 0; above 1 outside.
    pub fn share(&self, at: [usize; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.shares[axis][at[axis]])
    }

    /// The position of a point in world units.
    pub fn world(&self, at: [usize; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.first[axis] + at[axis] as f64 * self.spacing[axis])
    }

    /// Keeps only the points in a box.
    ///
    /// # Errors
    ///
    /// A box with fewer than two points along an axis.
    pub fn crop(&mut self, crop: &Bounds) -> Result<()> {
        for axis in 0..3 {
            let [low, high] = [crop.min[axis], crop.max[axis]].map(f64::from);
            let (first, spacing) = (self.first[axis], self.spacing[axis]);
            let last = self.shares[axis].len() - 1;
            // Rounded: corners of a box are float32.
            let start = ((low - first) / spacing - 1e-4).ceil().clamp(0.0, last as f64) as usize;
            let end = ((high - first) / spacing + 1e-4).floor().clamp(0.0, last as f64) as usize;
            let found = format!("{crop:?}");
            Error::require_option(
                start < end,
                "crop",
                found,
                "a box with two points along each axis",
            )?;
            self.shares[axis] = self.shares[axis][start..=end].to_vec();
            self.first[axis] = first + start as f64 * spacing;
        }
        Ok(())
    }

    /// The box around all points, in world units.
    pub fn bounds(&self) -> [[f64; 3]; 2] {
        let counts = self.counts();
        let last = |axis: usize| self.first[axis] + (counts[axis] - 1) as f64 * self.spacing[axis];
        [self.first, [0, 1, 2].map(last)]
    }
}

fn check_counts(counts: [usize; 3], limits: &Limits) -> Result<()> {
    let place = Place::File;
    for count in counts {
        limits::check(
            LimitName::AxisNodes,
            "points along an axis",
            count as u64,
            limits.axis_nodes,
            &place,
        )?;
    }
    let points = limits::product(&counts.map(|count| count as u64), "points", &place)?;
    limits::check(LimitName::Nodes, "points", points as u64, limits.nodes, &place)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubes_that_fill_a_box_end_on_its_faces() {
        for count in 1..400 {
            for edge in [1.0f32, 1.0 / 3.0, 0.6, 1.7, 1e-3] {
                let bounds = Bounds { min: [0.0; 3], max: [1.0, edge, 1.0] };
                let lattice = Lattice::of_cubes(&bounds, count, &Limits::default());
                let lattice = lattice.expect("small");
                let counts = lattice.counts();
                let last = lattice.share(counts.map(|count| count - 1));
                // Cubes fill the longest axis exactly; on the others one cube may overhang.
                let longest = usize::from(edge > 1.0);
                assert_eq!(last[longest], 1.0, "{count} {edge}");
                assert!(last.iter().all(|&last| last >= 1.0), "{count} {edge} {last:?}");
            }
        }
    }

    const BOX: Bounds = Bounds { min: [-1.0, 0.0, 2.0], max: [1.0, 0.5, 3.0] };

    #[test]
    fn nodes_are_points_and_never_below_themselves() {
        for size in 2..200 {
            for factor in 1..4 {
                let limits = Limits::default();
                let lattice = Lattice::of_nodes(&BOX, Nodes([size; 3]), factor, &limits);
                let lattice = lattice.expect("small");
                assert_eq!(lattice.counts(), [(size - 1) * factor + 1; 3]);
                for node in 0..size {
                    let at = lattice.share([node * factor; 3])[0] * (size - 1) as f64;
                    assert!(at >= node as f64 && at < node as f64 + 1e-9, "{size} {node} {at}");
                }
            }
        }
    }

    #[test]
    fn cubes_fill_the_box() {
        let mut lattice = Lattice::of_cubes(&BOX, 10, &Limits::default()).expect("small");
        assert_eq!((lattice.counts(), lattice.spacing), ([11, 4, 6], [0.2; 3]));
        assert!(lattice.share([10, 3, 5])[1] > 1.0, "cubes overhang");
        let crop = Bounds { min: [-0.5, 0.0, 2.2], max: [0.5, 0.4, 2.6] };
        lattice.crop(&crop).expect("it meets the box");
        assert_eq!(lattice.counts(), [5, 3, 3]);
        assert!((lattice.first[0] + 0.4).abs() < 1e-9);
        assert!(lattice.crop(&Bounds { min: [7.0; 3], max: [8.0; 3] }).is_err());
    }
}
