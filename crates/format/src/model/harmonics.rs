//! View-dependent colour as real spherical harmonics.
//!
//! ```text
//! at a sample   s_c = offset + sum over b of Y_b(d) * k[b][c]
//! where ray     C_c = clamp(sum of w * s_c)
//! where sample  C_c = sum of w * clamp(s_c)
//! ```
//!
//! `d` is the unit direction from the camera into the scene, `k` the coefficients of the sample,
//! and `w` its weight. Functions are numbered as `l^2 + l + m`, with the signs of the
//! Condon-Shortley phase, so that `Y_1 = -0.4886 y`. Plenoxels, PlenOctrees, TensoRF and
//! tiny-cuda-nn share this basis. Band `l` holds the functions `l^2` to `(l + 1)^2 - 1`.

use serde::{Deserialize, Serialize};

use crate::base::error::{Error, Place, Result};
use crate::model::activate::lanes;
pub use crate::model::generated::{Clamp, Evaluation};

/// Functions of the highest degree.
pub const FUNCTIONS: usize = 16;
/// The value of the function of band 0.
pub const BAND_0: f32 = 0.282_094_8;

/// Values of all functions in one direction.
pub type Basis = [f32; FUNCTIONS];

/// The rules that turn coefficients into colours.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Harmonics {
    /// Degree of the harmonics, 0 to 3.
    pub degree: usize,
    /// Where colours are clamped.
    #[serde(rename = "where")]
    pub evaluation: Evaluation,
    /// Number added to the sum of each sample.
    pub offset: f32,
    /// Limits of a colour.
    pub clamp: Clamp,
}

impl Harmonics {
    /// The highest degree.
    pub const MAX_DEGREE: usize = 3;

    /// Number of coefficients of a colour channel.
    pub const fn functions(&self) -> usize {
        (self.degree + 1) * (self.degree + 1)
    }

    /// Number of coefficients of all three channels beyond band 0.
    pub const fn features(&self) -> usize {
        3 * (self.functions() - 1)
    }

    /// Refuses invalid rules. `features` is the number of a field's coefficients beyond band 0.
    ///
    /// # Errors
    /// `Malformed`, at `place`.
    pub fn check(&self, features: usize, place: &Place) -> Result<()> {
        let refuse = |found: String, expected: &str| {
            Err(Error::malformed(place.clone(), format!("harmonics of {found}"), expected))
        };
        if self.degree > Self::MAX_DEGREE {
            return refuse(format!("degree {}", self.degree), "degree 0 to 3");
        }
        if !self.offset.is_finite() {
            return refuse(format!("offset {}", self.offset), "a finite offset");
        }
        if self.clamp == Clamp::Sigmoid && self.evaluation == Evaluation::Ray {
            return refuse("a sigmoid once a ray".to_owned(), "a sigmoid at each sample");
        }
        if features != self.features() {
            let found = format!("degree {} with {features} features", self.degree);
            return refuse(found, &format!("{} features", self.features()));
        }
        Ok(())
    }

    /// The sums of one sample: its coefficients, band by band and within a function red, green,
    /// blue, weighted by the functions. Clamped where samples are.
    #[inline(always)]
    pub fn sample(&self, basis: &Basis, coefficients: &[f32]) -> [f32; 3] {
        let mut sum = [self.offset; 3];
        let functions = coefficients.as_chunks::<3>().0.iter().take(self.functions());
        for (value, coefficients) in basis.iter().zip(functions) {
            for (sum, coefficient) in sum.iter_mut().zip(coefficients) {
                *sum += value * coefficient;
            }
        }
        match self.evaluation {
            Evaluation::Ray => sum,
            Evaluation::Sample => sum.map(|sum| self.limit(sum)),
        }
    }

    /// The colour of a ray from the weighted sums of its samples.
    #[inline]
    pub fn ray(&self, sum: [f32; 3]) -> [f32; 3] {
        match self.evaluation {
            Evaluation::Ray => sum.map(|sum| self.limit(sum)),
            Evaluation::Sample => sum,
        }
    }

    /// The colour of these coefficients.
    pub fn color(&self, basis: &Basis, coefficients: &[f32]) -> [f32; 3] {
        self.ray(self.sample(basis, coefficients))
    }

    /// The derivative of the clamp, from the clamped value.
    #[inline(always)]
    pub fn slope(&self, limited: f32) -> f32 {
        match self.clamp {
            Clamp::Zero => f32::from(u8::from(limited > 0.0)),
            Clamp::None => 1.0,
            Clamp::Sigmoid => limited * (1.0 - limited),
        }
    }

    #[inline(always)]
    fn limit(&self, value: f32) -> f32 {
        match self.clamp {
            Clamp::Zero => value.max(0.0),
            Clamp::None => value,
            Clamp::Sigmoid => lanes::sigmoid(value),
        }
    }
}

/// The functions in a unit direction, in f64.
#[rustfmt::skip]
pub fn basis_f64([x, y, z]: [f64; 3]) -> [f64; FUNCTIONS] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        0.282_094_791_773_878_14,
        -0.488_602_511_902_919_9 * y,
        0.488_602_511_902_919_9 * z,
        -0.488_602_511_902_919_9 * x,
        1.092_548_430_592_079_2 * x * y,
        -1.092_548_430_592_079_2 * y * z,
        0.315_391_565_252_520_05 * (2.0 * zz - xx - yy),
        -1.092_548_430_592_079_2 * x * z,
        0.546_274_215_296_039_6 * (xx - yy),
        -0.590_043_589_926_643_5 * y * (3.0 * xx - yy),
        2.890_611_442_640_554 * x * y * z,
        -0.457_045_799_464_465_8 * y * (4.0 * zz - xx - yy),
        0.373_176_332_590_115_4 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -0.457_045_799_464_465_8 * x * (4.0 * zz - xx - yy),
        1.445_305_721_320_277 * z * (xx - yy),
        -0.590_043_589_926_643_5 * x * (xx - 3.0 * yy),
    ]
}

/// The functions in a unit direction.
pub fn basis(direction: [f64; 3]) -> Basis {
    basis_f64(direction).map(|value| value as f32)
}

/// The largest sum over a band's functions of their magnitudes, in any direction. A change of at
/// most `e` in each coefficient of band `l` moves a sum by at most `e * BAND_GAIN[l]`.
///
/// Band 1: `C1 (|x| + |y| + |z|)` is largest on the diagonal, `C1 sqrt(3)`. The others were
/// maximised numerically and rounded up; a test holds them against a dense set of directions.
pub const BAND_GAIN: [f64; 4] =
    [0.282_094_791_773_878_2, 0.846_284_375_321_634_5, 1.351_369_885, 1.859_084_698];

#[cfg(test)]
mod tests {
    use super::*;

    /// Directions that cover the sphere.
    fn directions() -> impl Iterator<Item = [f64; 3]> {
        const COUNT: usize = 200_000;
        (0..COUNT).map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / COUNT as f64;
            let (sine, cosine) = libm::sincos(i as f64 * 2.399_963_229_728_653);
            let radius = (1.0 - z * z).sqrt();
            [radius * cosine, radius * sine, z]
        })
    }

    #[test]
    fn functions_are_orthonormal() {
        let mut gram = [[0.0f64; FUNCTIONS]; FUNCTIONS];
        let mut count = 0.0;
        for direction in directions() {
            let values = basis_f64(direction);
            for (row, one) in gram.iter_mut().zip(values) {
                row.iter_mut().zip(values).for_each(|(sum, other)| *sum += one * other);
            }
            count += 1.0;
        }
        for (i, row) in gram.iter().enumerate() {
            for (j, sum) in row.iter().enumerate() {
                let mean = sum / count * 4.0 * std::f64::consts::PI;
                let expected = f64::from(u8::from(i == j));
                assert!((mean - expected).abs() < 1e-4, "functions {i} and {j}: {mean}");
            }
        }
    }

    #[test]
    fn gains_bound_bands_closely() {
        for (band, gain) in BAND_GAIN.into_iter().enumerate() {
            let functions = band * band..(band + 1) * (band + 1);
            let sum = |values: [f64; FUNCTIONS]| -> f64 {
                values[functions.clone()].iter().map(|value| value.abs()).sum()
            };
            let most = directions().map(basis_f64).map(sum).fold(0.0, f64::max);
            assert!(most <= gain && most > 0.999 * gain, "band {band}: {most} of {gain}");
        }
    }

    #[test]
    fn clamps_at_samples_and_at_rays_agree_where_nothing_clamps() {
        let rules = |evaluation, clamp| Harmonics { degree: 1, evaluation, offset: 0.5, clamp };
        let basis = basis([0.6, 0.0, 0.8]);
        let coefficients: Vec<f32> = (0..12).map(|i| 0.1 * i as f32 - 0.5).collect();
        let [ray, sample] = [Evaluation::Ray, Evaluation::Sample].map(|evaluation| {
            let rules = rules(evaluation, Clamp::Zero);
            rules.ray(rules.sample(&basis, &coefficients).map(|sum| 0.7 * sum))
        });
        for (ray, sample) in ray.into_iter().zip(sample) {
            assert!((ray - sample).abs() < 1e-6 && ray > 0.0, "{ray} {sample}");
        }
        let below = rules(Evaluation::Sample, Clamp::Zero).color(&basis, &[-9.0; 12]);
        assert_eq!(below, [0.0; 3]);
    }

    #[test]
    fn rules_that_do_not_fit_are_refused() {
        let sound =
            Harmonics { degree: 2, evaluation: Evaluation::Ray, offset: 0.5, clamp: Clamp::Zero };
        let check = |rules: Harmonics, features| rules.check(features, &Place::File).is_ok();
        assert!(check(sound, 24));
        assert!(!check(sound, 9), "too few features");
        assert!(!check(Harmonics { degree: 4, ..sound }, 72), "degree 4");
        assert!(!check(Harmonics { offset: f32::NAN, ..sound }, 24), "no offset");
        assert!(!check(Harmonics { clamp: Clamp::Sigmoid, ..sound }, 24), "a sigmoid once a ray");
    }
}
