//! Places of voxels in the world.

use crate::base::bytes::ByteReader;
use crate::base::error::{Error, Place, Result};

/// Off-diagonal numbers up to this share of the others are rounding, because programs compute
/// quarter turns in float32. Over a thousand voxels, it is a thousandth of a voxel.
const ROUNDING: f64 = 1e-6;

/// An axis-aligned map from voxels to the world. The middle of voxel `v` is, along axis `w` of the
/// world, `first[w] + step[w] * v[axis[w]]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// The axis of voxels along each axis of the world; no two are the same.
    pub axis: [usize; 3],
    /// World units from a voxel to the next; negative if voxels run against the world's axis.
    pub step: [f64; 3],
    /// World position of voxel 0.
    pub first: [f64; 3],
}

impl Placed {
    /// A voxel's index along each axis of the world: whole steps from voxel 0 in the world's
    /// direction.
    pub fn turned(&self, voxel: [i32; 3]) -> [i32; 3] {
        let mut turned = [0; 3];
        for ((turned, axis), step) in turned.iter_mut().zip(self.axis).zip(self.step) {
            let along = voxel.get(axis).copied().unwrap_or(0);
            *turned = if step < 0.0 { along.wrapping_neg() } else { along };
        }
        turned
    }

    /// The voxels' edges and the place of the first one, for messages.
    pub fn describe(&self) -> String {
        let ([x, y, z], [a, b, c]) = (self.spacing(), self.first);
        format!("{x} x {y} x {z} from ({a}, {b}, {c})")
    }

    /// Distances of voxels along each axis of the world.
    pub fn spacing(&self) -> [f64; 3] {
        self.step.map(f64::abs)
    }

    /// The same in a world that is rotated from `(x, z, -y)` back to `(x, y, z)`.
    #[must_use]
    pub fn with_z_up(&self) -> Self {
        let ([ax, ay, az], [sx, sy, sz], [fx, fy, fz]) = (self.axis, self.step, self.first);
        Self { axis: [ax, az, ay], step: [sx, -sz, sy], first: [fx, -fz, fy] }
    }
}

/// The map of a grid.
///
/// # Errors
/// `Unsupported` for maps that rotate or shear, `Malformed` for maps without extent.
pub fn read_map(reader: &mut ByteReader, kind: &str, place: &Place) -> Result<Placed> {
    let mut numbers = |count: usize| {
        (0..count).map(|_| reader.array().map(f64::from_le_bytes)).collect::<Result<Vec<f64>>>()
    };
    let diagonal = |scale: &[f64], first: &[f64]| {
        let mut rows = [[0.0; 3]; 4];
        for (axis, row) in rows.iter_mut().enumerate() {
            for (column, number) in row.iter_mut().enumerate() {
                let from = if axis == 3 { first } else { scale };
                if axis == 3 || axis == column {
                    *number = from.get(column).copied().unwrap_or(0.0);
                }
            }
        }
        rows
    };
    let rows = match kind {
        "AffineMap" | "UnitaryMap" => {
            let numbers = numbers(16)?;
            let mut rows = [[0.0; 3]; 4];
            for (row, numbers) in rows.iter_mut().zip(numbers.chunks_exact(4)) {
                row.iter_mut().zip(numbers).for_each(|(number, from)| *number = *from);
            }
            rows
        }
        // The scale, and four vectors derived from it.
        "ScaleMap" | "UniformScaleMap" => diagonal(&numbers(15)?, &[]),
        "ScaleTranslateMap" | "UniformScaleTranslateMap" => {
            let numbers = numbers(18)?;
            let (first, scale) = numbers.split_at(3);
            diagonal(scale, first)
        }
        "TranslationMap" => diagonal(&[1.0; 3], &numbers(3)?),
        other => {
            let expected = "a map that scales and moves voxels";
            return Err(Error::unsupported(place.clone(), format!("a {other}"), expected));
        }
    };
    placed(&rows, place)
}

/// The map from rows with the world's steps along the axes of voxels, and the position of voxel 0.
pub(super) fn placed(rows: &[[f64; 3]; 4], place: &Place) -> Result<Placed> {
    let [axes @ .., first] = rows;
    let largest = axes.as_flattened().iter().fold(0.0f64, |most, number| most.max(number.abs()));
    let refused = |what: &str| {
        let found = format!("voxels that are {what} against the world: {rows:?}");
        Error::unsupported(place.clone(), found, "voxels along the world's axes: resample the grid")
    };
    if !rows.as_flattened().iter().all(|number| number.is_finite()) || largest <= 0.0 {
        let found = format!("a map {rows:?}");
        return Err(Error::malformed(place.clone(), found, "finite steps"));
    }
    let mut placed = Placed { axis: [0; 3], step: [0.0; 3], first: *first };
    let mut taken = [false; 3];
    let most = |numbers: &mut dyn Iterator<Item = f64>| numbers.fold(0.0, f64::max);
    for world in 0..3 {
        let of_world = most(&mut axes.iter().filter_map(|row| row.get(world)).map(|n| n.abs()));
        let mut along = axes
            .iter()
            .enumerate()
            .filter_map(|(axis, row)| row.get(world).map(|&step| (axis, step)))
            .filter(|(axis, step)| {
                let row = axes.get(*axis).into_iter().flatten();
                let of_axis = most(&mut row.map(|number| number.abs()));
                step.abs() > ROUNDING * of_axis.min(of_world)
            });
        let (Some((axis, step)), None) = (along.next(), along.next()) else {
            return Err(refused("turned or sheared"));
        };
        if let (Some(own), Some(length), Some(taken)) =
            (placed.axis.get_mut(world), placed.step.get_mut(world), taken.get_mut(axis))
        {
            if std::mem::replace(taken, true) {
                return Err(refused("flat"));
            }
            (*own, *length) = (axis, step);
        }
    }
    Ok(placed)
}
