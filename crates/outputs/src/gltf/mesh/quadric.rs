//! Quadrics of distances, as [`super::simplify`] sums them.

use super::vector::{cross, dot};

/// `x' A x + 2 b' x + c`, `A` symmetric: xx, xy, xz, yy, yz, zz.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Quadric {
    a: [f64; 6],
    b: [f64; 3],
    c: f64,
}

impl Quadric {
    pub(super) fn plus(&self, other: &Self) -> Self {
        Self {
            a: std::array::from_fn(|i| self.a[i] + other.a[i]),
            b: std::array::from_fn(|i| self.b[i] + other.b[i]),
            c: self.c + other.c,
        }
    }

    /// Weighted squared distance to the plane through `point` with this unit normal.
    pub(super) fn plane(normal: [f64; 3], point: [f64; 3], weight: f64) -> Self {
        let [x, y, z] = normal;
        let d = -dot(normal, point);
        Self {
            a: [x * x, x * y, x * z, y * y, y * z, z * z].map(|value| weight * value),
            b: normal.map(|value| weight * d * value),
            c: weight * d * d,
        }
    }

    /// Weighted squared distance to a point.
    pub(super) fn point(point: [f64; 3], weight: f64) -> Self {
        Self {
            a: [weight, 0.0, 0.0, weight, 0.0, weight],
            b: point.map(|value| -weight * value),
            c: weight * dot(point, point),
        }
    }

    pub(super) fn at(&self, [x, y, z]: [f64; 3]) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let squares = xx * x * x + yy * y * y + zz * z * z;
        let products = xy * x * y + xz * x * z + yz * y * z;
        squares + 2.0 * (products + dot(self.b, [x, y, z])) + self.c
    }

    /// The place of its least value, by Cramer's rule; none if rounding leaves no answer.
    pub(super) fn least(&self) -> Option<[f64; 3]> {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let rows = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let determinant = dot(rows[0], cross(rows[1], rows[2]));
        let right = self.b.map(|value| -value);
        // The inverse of a symmetric matrix: its rows' cross products over the determinant.
        let inverse = [cross(rows[1], rows[2]), cross(rows[2], rows[0]), cross(rows[0], rows[1])];
        let found = inverse.map(|row| dot(row, right) / determinant);
        (determinant > 0.0 && found.iter().all(|value| value.is_finite())).then_some(found)
    }
}
