//! The choice of the octree's cells for boxes.
//!
//! Box 0 is the inner box, and each next one is twice as large with twice the node distance, so all
//! have the same number of nodes. Nodes of box 0 are corners of the octree's cells of one level.
//! That level is the finest at which the boxes have at most [`MOST_CELLS`] times as many cells in
//! voxels as there are voxels (small models [`SMALL`]), and [`MOST_NODES`] along an edge: larger
//! voxels span many cells, and smaller ones are averaged.

use super::octree::{Cube, LEVELS, SIDE};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::model::field::Lattice;
use crate::model::grid::{Bounds, Nodes};

use super::settings::Settings;

/// Maximum ratio of cells in voxels to voxels.
const MOST_CELLS: f64 = 16.0;
/// Cells in voxels that every model may have: a bake of as many takes a second.
const SMALL: f64 = 1e6;
/// Default maximum of nodes along an edge: a bake of twice as many needs four times the memory,
/// which is 10 GB for harmonics of degree 3.
const MOST_NODES: u64 = 513;
/// Range of the search for a box's doublings, if the file does not state them.
const MOST_GUESSED: u32 = 8;

/// The nodes of a box: corners of the octree's cells of one level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct BoxPlan {
    /// Distance of nodes, in edges of the smallest voxels.
    pub(super) edge: u32,
    /// The lowest node along each axis, likewise.
    pub(super) first: u32,
    /// Nodes along each axis.
    pub(super) nodes: usize,
}

impl BoxPlan {
    /// The highest node along each axis.
    pub(super) fn last(&self) -> u32 {
        SIDE - self.first
    }

    /// The box in the world.
    pub(super) fn lattice(&self, settings: &Settings) -> Lattice {
        let mut bounds = Bounds { min: [0.0; 3], max: [0.0; 3] };
        let faces = bounds.min.iter_mut().zip(&mut bounds.max).zip(settings.center);
        for ((min, max), center) in faces {
            let at = |at: u32| center + settings.extent * (f64::from(at) / f64::from(SIDE) - 0.5);
            #[expect(clippy::cast_possible_truncation, reason = "a field's box is float32")]
            let ends = [at(self.first) as f32, at(self.last()) as f32];
            [*min, *max] = ends;
        }
        Lattice::new(bounds, Nodes([self.nodes; 3]))
    }
}

/// Boxes, and the data that determined them.
#[derive(Debug)]
pub(super) struct Plan {
    /// The inner box first.
    pub(super) boxes: Vec<BoxPlan>,
    /// Voxels that are smaller than the cells of their box.
    pub(super) averaged: u64,
}

/// Number of doublings of the inner box.
pub(super) fn doublings(settings: &Settings, stated: Option<u32>, cubes: &[Cube]) -> Result<u32> {
    let Some(inside) = settings.inside else {
        return Ok(stated.unwrap_or_else(|| guessed(cubes)));
    };
    let exact = libm::log2(settings.extent / inside);
    let whole = exact.round();
    if (exact - whole).abs() > 0.01 || !(0.0..f64::from(LEVELS)).contains(&whole) {
        let found = format!("{inside} within a scene_extent of {}", settings.extent);
        let expected = "scene_extent divided by a power of two";
        return Err(Error::malformed(Place::Key("inside_extent".to_owned()), found, expected));
    }
    #[expect(clippy::cast_possible_truncation, reason = "a whole number below 16")]
    Ok(whole as u32)
}

/// The doublings that need the fewest cells.
fn guessed(cubes: &[Cube]) -> u32 {
    let cells = |doublings: &u32| {
        let counts = Counts::new(cubes, *doublings);
        counts.cells(counts.finest())
    };
    (0..=MOST_GUESSED).min_by(|a, b| cells(a).total_cmp(&cells(b))).unwrap_or(0)
}

/// Number of voxels by the level of box 0's nodes from which on they are not averaged.
struct Counts([f64; 2 * LEVELS as usize + 1]);

impl Counts {
    fn new(cubes: &[Cube], doublings: u32) -> Self {
        let mut counts = [0.0; 2 * LEVELS as usize + 1];
        for cube in cubes {
            let level = LEVELS - cube.edge.max(1).ilog2();
            let at = level + number_of_box(cube, doublings);
            if let Some(count) = counts.get_mut(at as usize) {
                *count += 1.0;
            }
        }
        Self(counts)
    }

    fn with_levels(&self) -> impl Iterator<Item = (u32, f64)> {
        (0u32..).zip(self.0)
    }

    /// The level of the finest nodes that voxels need.
    fn finest(&self) -> u32 {
        let used = self.with_levels().filter(|(_, count)| *count > 0.0);
        used.map(|(level, _)| level).last().unwrap_or(1)
    }

    /// Cells in voxels, for nodes of a level.
    fn cells(&self, level: u32) -> f64 {
        let of = |(own, count): (u32, f64)| count * f64::from(8u32).powi(powers(level, own));
        self.with_levels().map(of).sum()
    }

    fn finer_than(&self, level: u32) -> f64 {
        self.with_levels().filter(|(own, _)| *own > level).map(|(_, count)| count).sum()
    }
}

fn powers(level: u32, own: u32) -> i32 {
    i32::try_from(level.saturating_sub(own)).unwrap_or(0)
}

/// The number of the smallest box around a voxel's middle.
fn number_of_box(cube: &Cube, doublings: u32) -> u32 {
    let away = cube.corner.iter().map(|corner| (2 * corner + cube.edge).abs_diff(SIDE)).max();
    let away = away.unwrap_or(0);
    (0..doublings).find(|number| away <= SIDE >> (doublings - number)).unwrap_or(doublings)
}

impl Plan {
    /// The boxes up to one that reaches `extent` half sides of the inner one. `resolution` asks for
    /// this many nodes along an edge of the inner box, or a few more.
    pub(super) fn new(
        cubes: &[Cube],
        doublings: u32,
        extent: f64,
        resolution: Option<usize>,
        limits: &Limits,
    ) -> Result<Self> {
        let counts = Counts::new(cubes, doublings);
        let most = (MOST_CELLS * cubes.len() as f64).max(SMALL);
        let (least, finest) = (doublings + 1, counts.finest().clamp(doublings + 1, LEVELS));
        let fits = |level: &u32| {
            let nodes = (1u64 << (level - doublings)) + 1;
            nodes <= limits.axis_nodes.min(MOST_NODES) && counts.cells(*level) <= most
        };
        let level = match resolution {
            None => (least..=finest).rev().find(fits).unwrap_or(least),
            Some(nodes) => {
                let cells = nodes.saturating_sub(1).max(2).next_power_of_two().ilog2();
                (doublings + cells).min(LEVELS)
            }
        };
        let place = Place::Tensor("octlevel".to_owned());
        let nodes = (1u64 << (level - doublings)) + 1;
        let Nodes([nodes, ..]) = Nodes::checked([nodes; 3], limits, &place)?;
        let reaches = |number: &u32| *number == 0 || libm::ldexp(1.0, powers(*number, 1)) < extent;
        let boxes = (0..=doublings).take_while(reaches).map(|number| BoxPlan {
            edge: SIDE >> (level - number),
            first: SIDE / 2 - (SIDE >> (doublings - number)) / 2,
            nodes,
        });
        #[expect(clippy::cast_possible_truncation, reason = "a count of voxels")]
        let averaged = counts.finer_than(level) as u64;
        Ok(Self { boxes: boxes.collect(), averaged })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(at: [u32; 3], level: u32) -> Cube {
        let edge = SIDE >> level;
        Cube { corner: at.map(|at| at * edge), edge }
    }

    #[test]
    fn boxes_double_and_have_as_many_nodes() {
        // A voxel of level 5 in the middle eighth, one of level 3 at the root's corner.
        let cubes = [cube([16; 3], 5), cube([0; 3], 3)];
        assert_eq!(number_of_box(&cubes[0], 2), 0);
        assert_eq!(number_of_box(&cubes[1], 2), 2);
        let limits = Limits::default();
        let plan = Plan::new(&cubes, 2, 1e9, None, &limits).expect("a plan");
        let edges: Vec<[u32; 3]> =
            plan.boxes.iter().map(|plan| [plan.edge, plan.first, plan.last()]).collect();
        let (unit, half) = (SIDE / 32, SIDE / 2);
        let expected = [
            [unit, half - SIDE / 8, half + SIDE / 8],
            [2 * unit, half - SIDE / 4, half + SIDE / 4],
            [4 * unit, 0, SIDE],
        ];
        assert_eq!(edges, expected);
        assert!(plan.boxes.iter().all(|plan| plan.nodes == 9));
        assert_eq!(plan.averaged, 0);
        for (extent, count) in [(1.0, 1), (1.5, 2), (2.0, 2), (2.1, 3), (100.0, 3)] {
            let plan = Plan::new(&cubes, 2, extent, None, &limits).expect("a plan");
            assert_eq!(plan.boxes.len(), count, "{extent}");
        }
        let coarse = Plan::new(&cubes, 2, 1e9, Some(5), &limits).expect("a plan");
        assert_eq!((coarse.boxes[0].nodes, coarse.averaged), (5, 2));
    }

    #[test]
    fn nobody_gets_large_grids_unasked() {
        let cubes = [cube([1000; 3], 10), cube([3; 3], 10)];
        let plan = |nodes| Plan::new(&cubes, 0, 1.0, nodes, &Limits::default()).expect("a plan");
        let [unasked, asked] = [plan(None), plan(Some(1025))];
        assert_eq!((unasked.boxes[0].nodes, unasked.averaged), (513, 2));
        assert_eq!((asked.boxes[0].nodes, asked.averaged), (1025, 0));
    }

    #[test]
    fn many_cells_make_nodes_coarser() {
        // Eight voxels of level 1 are 2^24 cells of level 8, of level 6 2^18.
        let mut cubes: Vec<Cube> =
            (0..8).map(|at| cube([at >> 2 & 1, at >> 1 & 1, at & 1], 1)).collect();
        cubes.push(cube([255; 3], 8));
        let plan = Plan::new(&cubes, 0, 1.0, None, &Limits::default()).expect("a plan");
        assert_eq!((plan.boxes[0].nodes, plan.averaged), (65, 1));
    }
}
