//! The basis functions of a leaf's colours.

use crate::base::error::{Error, Place, Result};
use crate::model::harmonics::{FUNCTIONS, basis_f64};

/// Directions of the least squares.
const DIRECTIONS: usize = 20_000;
/// The angle between consecutive directions of a spiral, which never repeats.
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// The meaning of a leaf's colours.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Basis {
    /// Three numbers; with `logits`, colours are their sigmoids.
    Colors {
        /// True if colours are logits.
        logits: bool,
    },
    /// This many harmonics.
    Harmonics(usize),
    /// Spherical Gaussians: sharpness, and axis.
    Gaussians(Vec<(f64, [f64; 3])>),
}

impl Basis {
    /// Reads a format's name. `channels` is the number per leaf, including density; colours of a
    /// draw list are not logits.
    pub(super) fn parse(
        name: Option<&str>,
        channels: usize,
        gaussians: &[f64],
        is_draw_list: bool,
    ) -> Result<Self> {
        let place = || Place::Key("data_format".to_owned());
        let colors = channels.saturating_sub(1);
        let fits = |functions: usize| functions > 0 && colors == 3 * functions;
        let number = |digits: &str| digits.parse::<usize>().ok().filter(|&count| fits(count));
        let name = match name {
            Some(name) => name.to_owned(),
            None if channels == 4 => "RGBA".to_owned(),
            None => format!("SH{}", colors / 3),
        };
        let found =
            || Error::unsupported(place(), format!("{name} with {channels} channels"), EXPECTED);
        if name == "RGBA" && fits(1) {
            return Ok(Self::Colors { logits: !is_draw_list });
        }
        if let Some(count) = name.strip_prefix("SH").and_then(number) {
            return match count {
                1 | 4 | 9 | 16 | 25 => Ok(Self::Harmonics(count)),
                _ => Err(found()),
            };
        }
        let Some(count) = name.strip_prefix("SG").and_then(number) else { return Err(found()) };
        let rows = gaussians.as_chunks::<4>().0;
        if rows.len() != count || gaussians.len() != 4 * count {
            let found = format!("{} numbers for {count} Gaussians", gaussians.len());
            let place = Place::Tensor("extra_data".to_owned());
            return Err(Error::malformed(place, found, "four for each"));
        }
        let rows = rows.iter().map(|&[sharpness, x, y, z]| (sharpness, [x, y, z]));
        Ok(Self::Gaussians(rows.collect()))
    }

    /// Functions of a colour in a leaf.
    pub(super) fn functions(&self) -> usize {
        match self {
            Self::Colors { .. } => 1,
            Self::Harmonics(count) => *count,
            Self::Gaussians(rows) => rows.len(),
        }
    }

    /// The functions' values in a unit direction, band 4 left out.
    pub(super) fn values(&self, direction: [f64; 3]) -> Vec<f64> {
        match self {
            Self::Colors { .. } => vec![1.0],
            Self::Harmonics(25) => {
                basis_f64(direction).into_iter().chain(band_4(direction)).collect()
            }
            Self::Harmonics(count) => basis_f64(direction).into_iter().take(*count).collect(),
            Self::Gaussians(rows) => rows
                .iter()
                .map(|(sharpness, axis)| {
                    let along: f64 = axis.iter().zip(direction).map(|(a, d)| a * d).sum();
                    libm::exp(sharpness * (along - 1.0)) / rows.len() as f64
                })
                .collect(),
        }
    }

    /// For each of the field's harmonics, the weights of a leaf's functions, by least squares over
    /// the sphere. None for plain colours.
    pub(super) fn harmonics(&self) -> Option<Vec<Vec<f32>>> {
        let unit = |function: usize, count: usize| {
            (0..count).map(|own| if own == function { 1.0 } else { 0.0 }).collect()
        };
        match self {
            Self::Colors { .. } => None,
            Self::Harmonics(count) => {
                Some((0..FUNCTIONS.min(*count)).map(|function| unit(function, *count)).collect())
            }
            Self::Gaussians(rows) => {
                let mut weights = vec![vec![0.0f64; rows.len()]; FUNCTIONS];
                for direction in directions() {
                    let own = self.values(direction);
                    for (row, harmonic) in weights.iter_mut().zip(basis_f64(direction)) {
                        row.iter_mut().zip(&own).for_each(|(sum, value)| *sum += harmonic * value);
                    }
                }
                let share = 4.0 * std::f64::consts::PI / DIRECTIONS as f64;
                #[expect(clippy::cast_possible_truncation, reason = "fields are float32")]
                let narrow =
                    |row: Vec<f64>| row.into_iter().map(|sum| (sum * share) as f32).collect();
                Some(weights.into_iter().map(narrow).collect())
            }
        }
    }
}

const EXPECTED: &str = "SH1, SH4, SH9, SH16, SH25, SG with extra_data, or RGBA";

/// Directions that cover the sphere evenly.
fn directions() -> impl Iterator<Item = [f64; 3]> {
    (0..DIRECTIONS).map(|number| {
        let z = 1.0 - (2.0 * number as f64 + 1.0) / DIRECTIONS as f64;
        let (sine, cosine) = libm::sincos(number as f64 * GOLDEN_ANGLE);
        let radius = (1.0 - z * z).sqrt();
        [radius * cosine, radius * sine, z]
    })
}

/// The harmonics of degree 4.
#[rustfmt::skip]
fn band_4([x, y, z]: [f64; 3]) -> [f64; 9] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        2.503_342_941_796_704_6 * x * y * (xx - yy),
        -1.770_130_769_779_930_4 * y * z * (3.0 * xx - yy),
        0.946_174_695_757_560_1 * x * y * (7.0 * zz - 1.0),
        -0.669_046_543_557_289_2 * y * z * (7.0 * zz - 3.0),
        0.105_785_546_915_204_31 * (zz * (35.0 * zz - 30.0) + 3.0),
        -0.669_046_543_557_289_2 * x * z * (7.0 * zz - 3.0),
        0.473_087_347_878_780_04 * (xx - yy) * (7.0 * zz - 1.0),
        -1.770_130_769_779_930_4 * x * z * (xx - 3.0 * yy),
        0.625_835_735_449_176_1 * (xx * (xx - 3.0 * yy) - yy * (3.0 * xx - yy)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn soft_gaussians_become_harmonics() {
        let extra = [1.0, 0.0, 0.6, 0.8, 0.5, 1.0, 0.0, 0.0];
        let basis = Basis::parse(Some("SG2"), 7, &extra, false).expect("two Gaussians");
        let weights = basis.harmonics().expect("harmonics");
        for direction in [[0.0, 0.6, 0.8], [0.0, 0.0, -1.0], [-0.6, 0.8, 0.0]] {
            let own = basis.values(direction);
            for (gaussian, expected) in own.iter().enumerate() {
                let functions = basis_f64(direction).into_iter().zip(&weights);
                let found: f64 = functions.map(|(f, row)| f * f64::from(row[gaussian])).sum();
                // Functions beyond degree 3 of such a Gaussian add up to 2.1e-3.
                assert!((found - expected).abs() < 2.5e-3, "{found} for {expected}");
            }
        }
    }

    #[test]
    fn formats_are_told_by_name_or_by_channels() {
        let parse = |name, channels, list| Basis::parse(name, channels, &[], list);
        assert_eq!(parse(None, 28, false).expect("SH9"), Basis::Harmonics(9));
        assert_eq!(parse(None, 4, true).expect("RGBA"), Basis::Colors { logits: false });
        for (name, channels) in [("ASG2", 7), ("SH9", 27), ("SH5", 16), ("SG2", 7), ("SH", 4)] {
            assert!(parse(Some(name), channels, false).is_err(), "{name}");
        }
    }
}
