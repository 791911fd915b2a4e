//! Anisotropy: the direction dependence of a coarse node's density.
//!
//! ```text
//! optical depth over one interval  t = max(0, v + sum over m of a_m * Y_2m(d))^2
//! ```
//!
//! `d` is the unit direction from the camera into the scene, `v` the interpolated density, a square
//! root of optical depth, and `a` the five interpolated values of anisotropy. `Y_2m` are the
//! functions of band 2 of [`super::harmonics`]. A coarse node in a thin wall absorbs more across
//! the wall than along it. Both directions along a line are equivalent, so odd bands are 0, and the
//! mean over all directions is `v`.

use super::harmonics::basis;

/// Values of a node.
pub const ANISOTROPY: usize = 5;
/// The functions of band 2 among those of all bands.
const FIRST: usize = 4;
/// The square root of the sum of the functions' squares, `sqrt(5 / (4 pi))`: the same in every
/// direction (Unsöld's theorem).
const NORM: f32 = 0.630_783_1;

/// The largest value of a function in any direction.
pub const LARGEST_FUNCTION: f32 = 0.630_783_2;

/// The functions of band 2 in a unit `direction`.
pub fn functions(direction: [f64; 3]) -> [f32; ANISOTROPY] {
    let all = basis(direction);
    std::array::from_fn(|m| all[FIRST + m])
}

/// Sums of the functions over vectors, each in the direction of the vector and times its squared
/// length, from the sums of products xx, yy, zz, xy, xz, yz of the vectors' parts.
#[inline(always)]
pub fn of_tensor([xx, yy, zz, xy, xz, yz]: [f32; 6]) -> [f32; ANISOTROPY] {
    [
        1.092_548_4 * xy,
        -1.092_548_4 * yz,
        0.315_391_57 * (2.0 * zz - xx - yy),
        -1.092_548_4 * xz,
        0.546_274_24 * (xx - yy),
    ]
}

/// The contribution of `anisotropy` to density for these function values.
#[inline(always)]
pub fn added_density(anisotropy: &[f32; ANISOTROPY], along: &[f32; ANISOTROPY]) -> f32 {
    let [a, b, c, d, e] = anisotropy;
    let [u, v, w, x, y] = along;
    a * u + b * v + c * w + d * x + e * y
}

/// The largest contribution of `anisotropy` to density in any direction (Cauchy-Schwarz).
pub fn most_added(anisotropy: &[f32; ANISOTROPY]) -> f32 {
    NORM * added_density(anisotropy, anisotropy).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_direction_adds_more_than_the_most_and_the_mean_is_nothing() {
        let anisotropy = [0.3, -0.7, 0.2, 0.9, -0.4];
        let (mut sum, mut most, count) = (0.0f64, 0.0f32, 20_000);
        for i in 0..count {
            let z = 1.0 - (2 * i + 1) as f64 / f64::from(count);
            let around = 2.399_963_229_728_653 * f64::from(i);
            let flat = (1.0 - z * z).sqrt();
            let direction = [flat * libm::cos(around), flat * libm::sin(around), z];
            let added = added_density(&anisotropy, &functions(direction));
            let back = added_density(&anisotropy, &functions(direction.map(|along| -along)));
            assert_eq!(added, back);
            (sum, most) = (sum + f64::from(added), most.max(added.abs()));
        }
        assert!((sum / f64::from(count)).abs() < 1e-4, "{sum}");
        let bound = most_added(&anisotropy);
        assert!(most <= bound && most > 0.8 * bound, "{most} of {bound}");
    }
}
