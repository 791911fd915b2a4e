//! Sizes of node grids, and the cut of a grid into blocks.

use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};

/// Nodes along x, y and z.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Nodes(pub [usize; 3]);

impl Nodes {
    /// Checks sizes that a file states: each is at least 2, and they and their product are within
    /// the limits.
    pub fn checked(sizes: [u64; 3], limits: &Limits, place: &Place) -> Result<Self> {
        if sizes.iter().any(|&size| size < 2) {
            let [x, y, z] = sizes;
            return Err(Error::malformed(
                place.clone(),
                format!("a grid of {x} x {y} x {z} nodes"),
                "at least 2 nodes along each axis",
            ));
        }
        for size in sizes {
            limits::check(
                LimitName::AxisNodes,
                "nodes along an axis",
                size,
                limits.axis_nodes,
                place,
            )?;
        }
        let count = limits::product(&sizes, "node count", place)?;
        limits::check(LimitName::Nodes, "nodes", count as u64, limits.nodes, place)?;
        // Each size divides a product that fits in memory.
        Ok(Self(sizes.map(|size| size as usize)))
    }

    /// Refuses a grid if `count` of its planes along x, as 4-byte values, take more memory than the
    /// limits allow.
    ///
    /// # Errors
    ///
    /// `OverLimit`.
    pub fn check_planes(self, count: usize, limits: &Limits, place: &Place) -> Result<()> {
        let [_, ny, nz] = self.0;
        let bytes = (4 * ny * nz) as u64 * count as u64;
        limits::check(LimitName::Memory, "bytes of planes of a grid", bytes, limits.memory, place)
    }

    /// Total number of nodes.
    pub fn count(self) -> usize {
        self.0.iter().product()
    }

    /// The next coarser level: each axis is halved, rounded down, to at least 2 nodes.
    pub fn halved(self) -> Self {
        Self(self.0.map(|size| (size / 2).max(2)))
    }

    /// The distance of neighbouring nodes along each axis, in world units.
    pub fn spacing(self, bounds: &Bounds) -> [f64; 3] {
        std::array::from_fn(|axis| bounds.extent()[axis] / (self.0[axis] - 1) as f64)
    }
}

/// An axis-aligned box in world units.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Bounds {
    /// Lowest corner: x, y, z.
    pub min: [f32; 3],
    /// Highest corner: x, y, z.
    pub max: [f32; 3],
}

impl Bounds {
    /// Finite bounds with some extent along every axis.
    pub fn check(&self, place: &Place) -> Result<()> {
        let ordered = (0..3).all(|axis| {
            let (min, max) = (self.min[axis], self.max[axis]);
            min.is_finite() && max.is_finite() && min < max
        });
        if ordered {
            return Ok(());
        }
        Err(Error::malformed(
            place.clone(),
            format!("a box from {:?} to {:?}", self.min, self.max),
            "finite corners with min below max along every axis",
        ))
    }

    /// The intersection of two boxes, if not empty.
    pub fn common(&self, other: &Self) -> Option<Self> {
        let mut common = *self;
        let axes = common.min.iter_mut().zip(&mut common.max);
        for ((min, max), (low, high)) in axes.zip(other.min.into_iter().zip(other.max)) {
            (*min, *max) = (min.max(low), max.min(high));
        }
        let meets = common.min.iter().zip(&common.max).all(|(min, max)| min < max);
        meets.then_some(common)
    }

    /// Maximum distance of a model box's corners from 0, so that cameras around it are within a
    /// hundred times as much.
    pub const FARTHEST: f64 = 1e10;

    /// The same for the box of a model, with room for cameras around it.
    ///
    /// # Errors
    /// `Malformed`.
    pub fn check_model(&self, place: &Place) -> Result<()> {
        self.check(place)?;
        let mut corners = self.min.iter().chain(&self.max);
        if corners.all(|corner| f64::from(corner.abs()) <= Self::FARTHEST) {
            return Ok(());
        }
        let found = format!("a box from {:?} to {:?}", self.min, self.max);
        Err(Error::malformed(place.clone(), found, "corners within 1e10 of 0"))
    }

    /// Lengths of its edges.
    pub fn extent(&self) -> [f64; 3] {
        std::array::from_fn(|axis| f64::from(self.max[axis]) - f64::from(self.min[axis]))
    }
}

/// The cut of a level into blocks: block `(i, j, k)` holds nodes `[i*b, min((i+1)*b, N))`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlockGrid {
    /// Nodes of the level.
    pub nodes: Nodes,
    /// Nodes along a block's edge.
    pub edge: usize,
}

impl BlockGrid {
    /// Blocks along each axis.
    pub fn counts(self) -> [usize; 3] {
        self.nodes.0.map(|size| size.div_ceil(self.edge))
    }

    /// Total number of blocks.
    pub fn total(self) -> usize {
        self.counts().iter().product()
    }

    /// Nodes of a stored block; those beyond the grid's end are padding.
    pub fn block_nodes(self) -> usize {
        self.edge.pow(3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_from_files_are_checked() {
        let limits = Limits { nodes: 1000, ..Limits::default() };
        let checked = |sizes| Nodes::checked(sizes, &limits, &Place::File);
        assert_eq!(checked([2, 5, 100]).expect("1000 nodes").count(), 1000);
        assert!(checked([2, 5, 101]).is_err());
        assert!(checked([0, 5, 5]).is_err());
        assert!(checked([1, 5, 5]).is_err());
        assert!(checked([u64::MAX, u64::MAX, 2]).is_err());
        // Eight planes of 100 values are 3200 bytes.
        for (memory, fits) in [(3199, false), (3200, true)] {
            let limits = Limits { memory, ..Limits::default() };
            assert_eq!(Nodes([50, 10, 10]).check_planes(8, &limits, &Place::File).is_ok(), fits);
        }
    }

    #[test]
    fn halving_keeps_two_nodes() {
        assert_eq!(Nodes([33, 2, 3]).halved(), Nodes([16, 2, 2]));
    }

    #[test]
    fn blocks_cover_odd_sizes() {
        let grid = BlockGrid { nodes: Nodes([33, 8, 2]), edge: 8 };
        assert_eq!((grid.counts(), grid.total(), grid.block_nodes()), ([5, 1, 1], 5, 512));
    }
}
