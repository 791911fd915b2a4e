//! Voxels as the leaves of an octree.

use crate::base::error::{Error, Place, Result};
use crate::base::limits::Budget;

/// Levels below the root, at most.
pub(super) const LEVELS: u32 = 16;
/// Edge of the root in edges of the smallest voxels.
pub(super) const SIDE: u32 = 1 << LEVELS;

/// World units of an edge of the smallest voxels.
pub(super) fn unit(extent: f64) -> f64 {
    extent / f64::from(SIDE)
}

/// Stands for no child.
const NONE: u32 = u32::MAX;
/// Set in children that are leaves; the rest is the voxel's number.
const LEAF: u32 = 1 << 31;
/// Maximum voxels: their numbers leave room for [`LEAF`] and [`NONE`].
pub(super) const MOST_VOXELS: u64 = (LEAF - 1) as u64;

/// A voxel's place: its lowest corner and edge, in edges of the smallest voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Cube {
    /// x, y and z, 0 to [`SIDE`] - 1.
    pub(super) corner: [u32; 3],
    /// A power of two.
    pub(super) edge: u32,
}

impl Cube {
    const ROOT: Self = Self { corner: [0; 3], edge: SIDE };

    /// The cube of a path at a level.
    pub(super) fn of_path(path: u64, level: u8) -> Self {
        let corner = [path >> 2, path >> 1, path].map(every_third);
        Self { corner, edge: SIDE >> u32::from(level).min(LEVELS) }
    }

    /// The path of the cube that has this lowest corner.
    pub(super) fn path(&self) -> u64 {
        let mut path = 0;
        for at in 0..LEVELS {
            for (corner, bit) in self.corner.into_iter().zip([2, 1, 0]) {
                path |= u64::from(corner >> at & 1) << (3 * at + bit);
            }
        }
        path
    }

    /// One of the eight parts of this cube, x highest.
    pub(super) fn child(&self, number: u32) -> Self {
        let edge = self.edge / 2;
        let mut corner = self.corner;
        for (corner, bit) in corner.iter_mut().zip([2, 1, 0]) {
            *corner += (number >> bit & 1) * edge;
        }
        Self { corner, edge }
    }
}

/// A part of the tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// Nothing.
    Empty,
    /// The voxel of this number.
    Leaf(u32),
    /// Eight parts, under this number.
    Node(u32),
}

/// The voxels of a file, found by their place.
#[derive(Debug)]
pub(super) struct Octree {
    root: u32,
    nodes: Vec<[u32; 8]>,
}

impl Octree {
    /// From the paths and levels of voxels.
    ///
    /// # Errors
    /// `Malformed` for levels out of range, paths with bits below the voxel's level, and voxels
    /// that overlap; `OverLimit` for more memory than the budget has.
    pub(super) fn new(paths: &[u64], levels: &[u8], budget: &mut Budget) -> Result<Self> {
        let place = Place::Tensor("octpath".to_owned());
        let mut order: Vec<u32> = budget.zeroed(paths.len(), "bytes of an octree", &place)?;
        order.iter_mut().zip(0..).for_each(|(out, number)| *out = number);
        let path = |voxel: u32| paths.get(voxel as usize).copied().unwrap_or(0);
        let level = |voxel: u32| levels.get(voxel as usize).copied().unwrap_or(0);
        order.sort_unstable_by_key(|&voxel| (path(voxel), voxel));
        let mut end = 0;
        for &voxel in &order {
            let (first, level) = (path(voxel), level(voxel));
            let malformed = |found: String, expected: &str| {
                Err(Error::malformed(place.clone(), format!("voxel {voxel}: {found}"), expected))
            };
            if !(1..=LEVELS).contains(&u32::from(level)) {
                return malformed(format!("level {level}"), "levels from 1 to 16");
            }
            let size = 1u64 << (3 * (LEVELS - u32::from(level)));
            if first >= 1 << (3 * LEVELS) || first & (size - 1) != 0 {
                let found = format!("path {first:#x} at level {level}");
                return malformed(found, "three bits per level, and zeros below the last one");
            }
            if first < end {
                return malformed(
                    "it overlaps another voxel".to_owned(),
                    "voxels that do not overlap",
                );
            }
            end = first + size;
        }
        let mut tree = Self { root: NONE, nodes: Vec::new() };
        tree.root = tree.build(&order, 0, &path, &level, budget)?;
        Ok(tree)
    }

    /// The part of the tree with these voxels, in order, `depth` levels below the root.
    fn build(
        &mut self,
        mut order: &[u32],
        depth: u32,
        path: &impl Fn(u32) -> u64,
        level: &impl Fn(u32) -> u8,
        budget: &mut Budget,
    ) -> Result<u32> {
        match order {
            [] => return Ok(NONE),
            [voxel] if u32::from(level(*voxel)) == depth => return Ok(LEAF | voxel),
            _ => {}
        }
        let number = u32::try_from(self.nodes.len()).ok().filter(|number| *number < LEAF);
        budget.spend(32, "bytes of an octree", &Place::Tensor("octpath".to_owned()))?;
        let number = number.unwrap_or(0);
        self.nodes.push([NONE; 8]);
        // Voxels do not overlap, so several voxels cannot end here, and depths end at 16.
        let shift = 3 * LEVELS.saturating_sub(depth + 1);
        for child in 0..8u64 {
            let count = order.partition_point(|&voxel| path(voxel) >> shift & 7 <= child);
            let (own, rest) = order.split_at(count);
            order = rest;
            let built = self.build(own, depth + 1, path, level, budget)?;
            let node = self.nodes.get_mut(number as usize);
            if let Some(out) = node.and_then(|node| node.get_mut(usize_of(child))) {
                *out = built;
            }
        }
        Ok(number)
    }

    /// The whole tree.
    pub(super) fn root(&self) -> (Part, Cube) {
        (part(self.root), Cube::ROOT)
    }

    /// The eight parts of a node, x highest, with their cubes.
    pub(super) fn children(&self, node: u32, cube: Cube) -> impl Iterator<Item = (Part, Cube)> {
        let parts = self.nodes.get(node as usize).copied().unwrap_or([NONE; 8]);
        parts.into_iter().zip(0..).map(move |(child, number)| (part(child), cube.child(number)))
    }

    /// The smallest part around a cube of the finest level, a voxel or nothing, and its place.
    pub(super) fn find(&self, at: [u32; 3]) -> (Option<u32>, Cube) {
        let (mut found, mut cube) = (self.root, Cube::ROOT);
        while let Part::Node(node) = part(found) {
            let half = cube.edge / 2;
            let bits = at.iter().zip(cube.corner).fold(0, |bits, (at, corner)| {
                bits << 1 | u32::from(at.saturating_sub(corner) >= half)
            });
            let node = self.nodes.get(node as usize);
            found = node.and_then(|node| node.get(bits as usize)).copied().unwrap_or(NONE);
            cube = cube.child(bits);
        }
        match part(found) {
            Part::Leaf(voxel) => (Some(voxel), cube),
            _ => (None, cube),
        }
    }
}

/// Bits 0, 3, 6 and so on, compacted.
fn every_third(bits: u64) -> u32 {
    let mut bits = bits & 0x1249_2492_4924_9249;
    for (shift, mask) in [
        (2, 0x10c3_0c30_c30c_30c3),
        (4, 0x100f_00f0_0f00_f00f),
        (8, 0x001f_0000_ff00_00ff),
        (16, 0x001f_0000_0000_ffff),
    ] {
        bits = (bits | bits >> shift) & mask;
    }
    u32::try_from(bits & 0xffff).unwrap_or(0)
}

fn part(stored: u32) -> Part {
    match stored {
        NONE => Part::Empty,
        leaf if leaf & LEAF != 0 => Part::Leaf(leaf & !LEAF),
        node => Part::Node(node),
    }
}

fn usize_of(small: u64) -> usize {
    usize::try_from(small).unwrap_or(usize::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::limits::Limits;

    fn tree(voxels: &[(u64, u8)]) -> Result<Octree> {
        let paths: Vec<u64> = voxels.iter().map(|voxel| voxel.0).collect();
        let levels: Vec<u8> = voxels.iter().map(|voxel| voxel.1).collect();
        Octree::new(&paths, &levels, &mut Budget::new(&Limits::default()))
    }

    #[test]
    fn paths_are_places() {
        // Level 1 is in bits 45 to 47, x highest.
        assert_eq!(Cube::of_path(4 << 45, 1), Cube { corner: [SIDE / 2, 0, 0], edge: SIDE / 2 });
        assert_eq!(Cube::of_path(1, 16), Cube { corner: [0, 0, 1], edge: 1 });
        for path in [0, 1, 0o7654_3210_7654_3210, (1 << 48) - 1] {
            assert_eq!(Cube::of_path(path, 16).path(), path);
        }
    }

    #[test]
    fn every_place_is_found_in_its_voxel() {
        let voxels = [(0o7 << 45, 1), (0o12 << 42, 2), (0o133 << 39, 3), (0o1345 << 36, 4)];
        let tree = tree(&voxels).expect("sound");
        let step = SIDE / 16;
        for number in 0..4096u32 {
            let at = [number / 256, number / 16 % 16, number % 16].map(|at| at * step);
            let holds = |cube: Cube| {
                (0..3).all(|axis| {
                    (cube.corner[axis]..cube.corner[axis] + cube.edge).contains(&at[axis])
                })
            };
            let expected =
                (0u32..).zip(voxels).find(|(_, (path, level))| holds(Cube::of_path(*path, *level)));
            let (found, cube) = tree.find(at);
            assert_eq!(found, expected.map(|(number, _)| number), "{at:?}");
            assert!(holds(cube), "{at:?} {cube:?}");
        }
    }

    #[test]
    fn voxels_that_cannot_be_are_refused() {
        for (voxels, said) in [
            (vec![(0, 0)], "level 0"),
            (vec![(0, 17)], "level 17"),
            (vec![(1, 15)], "path 0x1"),
            (vec![(1 << 48, 1)], "path"),
            (vec![(0, 1), (0, 1)], "overlaps"),
            (vec![(0, 1), (0o3 << 42, 2)], "overlaps"),
        ] {
            let error = tree(&voxels).expect_err(said).to_string();
            assert!(error.contains(said), "{error}");
        }
        assert_eq!(tree(&[]).expect("none").find([5; 3]).0, None);
    }
}
