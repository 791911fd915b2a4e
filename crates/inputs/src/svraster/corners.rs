//! The distinct corners of voxels.
//!
//! A file has a raw density for each of them, sorted by x, y and z. Corners in a plane of x are
//! adjacent, so duplicates are removed plane by plane.

use super::octree::{Cube, SIDE};
use crate::base::error::{Place, Result};
use crate::base::limits::{self, Budget};
use crate::base::parallel;

/// A corner's y and z in one number.
fn key(y: u32, z: u32) -> u64 {
    u64::from(y) << 32 | u64::from(z)
}

/// The y and z of the four corners of a voxel in a plane of x.
fn four(cube: Cube) -> [u64; 4] {
    let [_, y, z] = cube.corner;
    let (high_y, high_z) = (y + cube.edge, z + cube.edge);
    [key(y, z), key(y, high_z), key(high_y, z), key(high_y, high_z)]
}

/// The distinct corners of voxels.
#[derive(Debug)]
pub(super) struct Corners {
    /// The numbers of each voxel's corners, x slowest. They count distinct corners by x, y and z.
    pub(super) of_voxels: Vec<[u32; 8]>,
    /// Their number.
    pub(super) count: usize,
}

/// Planes that are deduplicated before their numbers are stored; they wait in memory.
const PLANES: usize = 64;

impl Corners {
    /// Finds the distinct corners of voxels.
    ///
    /// # Errors
    /// `OverLimit` for more memory than the budget has.
    pub(super) fn find(cubes: &[Cube], budget: &mut Budget) -> Result<Self> {
        let place = Place::Tensor("octpath".to_owned());
        let members = Members::find(cubes, budget)?;
        let cube_of = |member: u32| cubes.get(member as usize / 2).copied();
        let distinct = |x: usize| {
            let cubes = members.of(x).iter().filter_map(|member| cube_of(*member));
            let mut keys: Vec<u64> = cubes.flat_map(four).collect();
            keys.sort_unstable();
            keys.dedup();
            keys
        };
        let used: Vec<usize> = (0..=SIDE as usize).filter(|x| !members.of(*x).is_empty()).collect();
        let mut of_voxels: Vec<[u32; 8]> =
            budget.zeroed(cubes.len(), "bytes of corners", &place)?;
        let mut all = 0;
        for planes in used.chunks(PLANES) {
            // Numbers within a plane, and their count.
            let found = parallel::map(planes.len(), |at| {
                let x = planes.get(at).copied().unwrap_or(0);
                let keys = distinct(x);
                let number = |key: u64| {
                    let at = keys.binary_search(&key).unwrap_or(0);
                    u32::try_from(at).unwrap_or(0)
                };
                let numbers = members
                    .of(x)
                    .iter()
                    .map(|member| cube_of(*member).map_or([0; 4], |cube| four(cube).map(number)));
                Ok((numbers.collect::<Vec<_>>(), keys.len()))
            })?;
            for (x, (numbers, count)) in planes.iter().zip(found) {
                let before = u32::try_from(all).unwrap_or(u32::MAX);
                for (member, numbers) in members.of(*x).iter().zip(numbers) {
                    let voxel = of_voxels.get_mut(*member as usize / 2);
                    let halves = voxel.map(|corners| corners.split_at_mut(4));
                    let half = halves.map(|(low, high)| if member % 2 == 0 { low } else { high });
                    let out = half.into_iter().flatten().zip(numbers);
                    out.for_each(|(out, number)| *out = number.saturating_add(before));
                }
                all += count;
                limits::check_fixed("corners", all as u64, u64::from(u32::MAX - 1), &place)?;
            }
        }
        Ok(Self { of_voxels, count: all })
    }
}

/// The voxels with corners in each plane of x.
struct Members {
    /// The first member of each plane, and the end of the last one.
    starts: Vec<usize>,
    /// Twice a voxel's number, plus one for its upper plane.
    members: Vec<u32>,
}

impl Members {
    fn find(cubes: &[Cube], budget: &mut Budget) -> Result<Self> {
        let place = Place::Tensor("octpath".to_owned());
        let planes = |cube: &Cube| {
            let [x, _, _] = cube.corner;
            [x, x + cube.edge].map(|x| x as usize)
        };
        let mut starts: Vec<usize> = vec![0; SIDE as usize + 2];
        for x in cubes.iter().flat_map(planes) {
            if let Some(count) = starts.get_mut(x + 1) {
                *count += 1;
            }
        }
        let mut sum = 0;
        for start in &mut starts {
            sum += *start;
            *start = sum;
        }
        let count = limits::product(&[2, cubes.len() as u64], "corners", &place)?;
        let mut members: Vec<u32> = budget.zeroed(count, "bytes of corners", &place)?;
        let mut next = starts.clone();
        for (number, cube) in (0u32..).zip(cubes) {
            for (x, member) in planes(cube).into_iter().zip([2 * number, 2 * number + 1]) {
                let Some(next) = next.get_mut(x) else { continue };
                if let Some(out) = members.get_mut(*next) {
                    *out = member;
                }
                *next += 1;
            }
        }
        Ok(Self { starts, members })
    }

    fn of(&self, x: usize) -> &[u32] {
        let ends = self.starts.get(x).zip(self.starts.get(x + 1));
        ends.and_then(|(start, end)| self.members.get(*start..*end)).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::base::limits::Limits;

    #[test]
    fn corners_are_numbered_by_their_places() {
        let cubes = [
            Cube { corner: [0; 3], edge: 4 },
            Cube { corner: [4, 0, 0], edge: 4 },
            Cube { corner: [0, 4, 0], edge: 2 },
            Cube { corner: [8, 8, 8], edge: 1 },
        ];
        let of = |cube: &Cube| {
            let Cube { corner: [x, y, z], edge } = *cube;
            (0..8).map(move |number: u32| {
                [
                    x + (number >> 2 & 1) * edge,
                    y + (number >> 1 & 1) * edge,
                    z + (number & 1) * edge,
                ]
            })
        };
        let distinct: BTreeSet<[u32; 3]> = cubes.iter().flat_map(of).collect();
        let numbers: Vec<[u32; 3]> = distinct.into_iter().collect();
        let mut budget = Budget::new(&Limits::default());
        let found = Corners::find(&cubes, &mut budget).expect("corners");
        assert_eq!(found.count, numbers.len());
        for (cube, found) in cubes.iter().zip(found.of_voxels) {
            let places: Vec<[u32; 3]> = found.iter().map(|at| numbers[*at as usize]).collect();
            assert_eq!(places, of(cube).collect::<Vec<_>>());
        }
    }
}
