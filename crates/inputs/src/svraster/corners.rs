//! The raw densities at voxels' corners, out of the table of distinct corners.

use super::octree::{Cube, SIDE};
use crate::base::error::{Error, Place, Result};
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

/// The raw densities at the eight corners of each voxel, x slowest. `table` holds those of all
/// distinct corners, sorted by x, y and z.
///
/// # Errors
/// `Malformed` for a table of more or fewer corners than the voxels have.
pub(super) fn corners(cubes: &[Cube], table: &[f32], budget: &mut Budget) -> Result<Vec<[f32; 8]>> {
    let place = Place::Tensor("_geo_grid_pts".to_owned());
    // A voxel has two planes of corners. Those of each plane of x lie together in the table, so
    // they are told apart plane by plane.
    let mut starts: Vec<usize> = vec![0; SIDE as usize + 2];
    let planes = |cube: &Cube| {
        let [x, _, _] = cube.corner;
        [x, x + cube.edge].map(|x| x as usize)
    };
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
    // For each plane its voxels, twice their number, plus one for the upper plane.
    let mut members: Vec<u32> = budget.zeroed(count, "bytes of corners", &place)?;
    let mut next = starts.clone();
    for (number, cube) in (0u32..).zip(cubes) {
        for (x, member) in planes(cube).into_iter().zip([2 * number, 2 * number + 1]) {
            if let Some(next) = next.get_mut(x) {
                if let Some(out) = members.get_mut(*next) {
                    *out = member;
                }
                *next += 1;
            }
        }
    }
    let members_of = |x: usize| {
        let ends = starts.get(x).zip(starts.get(x + 1));
        ends.and_then(|(start, end)| members.get(*start..*end)).unwrap_or_default()
    };
    let cube_of = |member: u32| cubes.get(member as usize / 2).copied();
    let distinct = |x: usize| {
        let cubes = members_of(x).iter().filter_map(|member| cube_of(*member));
        let mut keys: Vec<u64> = cubes.flat_map(four).collect();
        keys.sort_unstable();
        keys.dedup();
        keys
    };
    let used: Vec<usize> = (0..=SIDE as usize).filter(|x| !members_of(*x).is_empty()).collect();
    let at = |number: usize| used.get(number).copied().unwrap_or(usize::MAX - 1);
    let counts = parallel::map(used.len(), |number| Ok(distinct(at(number)).len()))?;
    let all: usize = counts.iter().sum();
    if all != table.len() {
        let found = format!("{} raw densities", table.len());
        let expected = format!("{all}, as many as the voxels have distinct corners");
        return Err(Error::malformed(place, found, expected));
    }
    let mut rest = table;
    let tables: Vec<&[f32]> = counts
        .iter()
        .map(|count| {
            let (own, left) = rest.split_at(*count);
            rest = left;
            own
        })
        .collect();
    let mut raw: Vec<[f32; 8]> = budget.zeroed(cubes.len(), "bytes of corners", &place)?;
    for first in (0..used.len()).step_by(PLANES) {
        let count = PLANES.min(used.len() - first);
        let found = parallel::map(count, |number| {
            let x = at(first + number);
            let (keys, table) = (distinct(x), tables.get(first + number).copied());
            let value = |key: u64| {
                let place = keys.binary_search(&key).ok();
                place.and_then(|place| table?.get(place)).copied().unwrap_or(0.0)
            };
            let members = members_of(x).iter();
            Ok(members
                .map(|member| cube_of(*member).map_or([0.0; 4], |cube| four(cube).map(value)))
                .collect::<Vec<_>>())
        })?;
        for (number, values) in (first..).zip(found) {
            for (member, values) in members_of(at(number)).iter().zip(values) {
                let raw = raw.get_mut(*member as usize / 2).map(|raw| raw.split_at_mut(4));
                let half = raw.map(|(low, high)| if member % 2 == 0 { low } else { high });
                if let Some(half) = half {
                    half.copy_from_slice(&values);
                }
            }
        }
    }
    Ok(raw)
}

/// Planes whose values are found before they are stored: they wait in memory.
const PLANES: usize = 64;

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::base::limits::Limits;

    #[test]
    fn each_corner_has_its_entry() {
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
        let value = |[x, y, z]: [u32; 3]| (x * 100 + y * 10 + z) as f32;
        let table: Vec<f32> = distinct.into_iter().map(value).collect();
        let mut budget = Budget::new(&Limits::default());
        let found = corners(&cubes, &table, &mut budget).expect("a fitting table");
        for (cube, found) in cubes.iter().zip(found) {
            let expected: Vec<f32> = of(cube).map(value).collect();
            assert_eq!(found.as_slice(), expected);
        }
        let error = corners(&cubes, &table[1..], &mut budget).expect_err("a corner is missing");
        assert!(error.to_string().contains("as many as the voxels have"), "{error}");
    }
}
