//! The largest errors that stored values may have.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::Value;

use crate::base::error::{Error, Result};
use crate::model::baked::{GROUPS, Group};

/// The range of an error. Smaller errors need f32; larger ones are meaningless.
const RANGE: std::ops::RangeInclusive<f32> = 1e-6..=0.25;

/// The largest error of each group: of opacity over one interval for density and for anisotropy, of
/// activated values (0 to 1) for diffuse colours and features, and of the colour that it adds for a
/// band of harmonics and for directional brightness. Features and band 1 share one bound. In text
/// form, it is one number, or 3, 5 or 7 with colons between them: for opacity, diffuse colours and
/// features; for bands 2 and 3, by default as features; for directional brightness, by default as
/// diffuse colours; and for anisotropy, by default as opacity.
///
/// ```
/// use mipvog::MaxErrors;
///
/// let errors: MaxErrors = "0.02:0.018:0.05".parse().expect("three errors");
/// assert_eq!(errors, MaxErrors::new(0.02, 0.018, 0.05));
/// assert_eq!("0.01".parse(), Ok(MaxErrors::from(0.01)));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaxErrors {
    /// By [`Group`].
    by_group: [f32; GROUPS],
}

impl MaxErrors {
    /// Of density's opacity, diffuse colours and features.
    pub const fn new(density: f32, diffuse: f32, features: f32) -> Self {
        Self {
            by_group: [density, diffuse, features, features, features, features, diffuse, density],
        }
    }

    /// With other errors for bands 2 and 3 of harmonics.
    #[must_use]
    pub const fn with_bands(mut self, second: f32, third: f32) -> Self {
        self.by_group[4] = second;
        self.by_group[5] = third;
        self
    }

    /// With other errors for directional brightness and for anisotropy.
    #[must_use]
    pub const fn with_direction(mut self, brightness: f32, anisotropy: f32) -> Self {
        self.by_group[6] = brightness;
        self.by_group[7] = anisotropy;
        self
    }

    /// All errors times `factor`, rounded to three digits and clamped to the range.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        for error in &mut self.by_group {
            let (least, most) = (f64::from(*RANGE.start()), f64::from(*RANGE.end()));
            let scaled = (f64::from(*error) * factor).clamp(least, most);
            *error = format!("{scaled:.2e}").parse().unwrap_or(scaled as f32);
        }
        self
    }

    /// The errors of a level: their [`level_share`].
    #[must_use]
    pub fn of_level(self, level: usize) -> Self {
        if level < 2 { self } else { self.scaled(level_share(level)) }
    }

    /// That of a group.
    pub fn of(&self, group: Group) -> f32 {
        self.by_group[group.index()]
    }

    /// The error that all groups share, if they do.
    fn common(&self) -> Option<f32> {
        let [density, others @ ..] = self.by_group;
        others.iter().all(|&other| other == density).then_some(density)
    }

    /// The shortest list of numbers, each formatted by `shown`.
    fn text(&self, shown: impl Fn(f32) -> String) -> String {
        match self.common() {
            Some(error) => shown(error),
            None => {
                let [density, diffuse, features, _, second, third, brightness, anisotropy] =
                    self.by_group;
                let numbers = [density, diffuse, features, second, third, brightness, anisotropy];
                let count = if [brightness, anisotropy] != [diffuse, density] {
                    7
                } else if third != second {
                    5
                } else if second != features {
                    4
                } else {
                    3
                };
                numbers[..count].iter().map(|&error| shown(error)).collect::<Vec<_>>().join(":")
            }
        }
    }

    /// Checks that each error is within 1e-6 to 0.25.
    ///
    /// # Errors
    ///
    /// [`crate::base::error::ErrorKind::InvalidOption`].
    pub fn check(&self) -> Result<()> {
        let fits = self.by_group.iter().all(|error| RANGE.contains(error));
        Error::require_option(fits, "max_error", self, "1e-6 to 0.25")
    }

    /// As in provenance and reports: a number if all are equal, else text.
    pub fn to_json(&self) -> Value {
        self.common().map_or_else(|| self.to_string().into(), Value::from)
    }

    /// From the value of [`to_json`](Self::to_json).
    pub fn from_json(json: &Value) -> Option<Self> {
        json.as_f64().map(|error| (error as f32).into()).or_else(|| json.as_str()?.parse().ok())
    }
}

/// The share of the errors that a level may have: from level 2 on, half the share of the level
/// before. Distant pictures read few nodes, whose errors do not average out. These nodes are few,
/// so more bits for them cost few bytes.
pub fn level_share(level: usize) -> f64 {
    libm::exp2(1.0 - level.max(1) as f64)
}

impl From<f32> for MaxErrors {
    fn from(error: f32) -> Self {
        Self::new(error, error, error)
    }
}

impl FromStr for MaxErrors {
    type Err = &'static str;

    fn from_str(text: &str) -> std::result::Result<Self, Self::Err> {
        let errors: Option<Vec<f32>> = text.split(':').map(|part| part.parse().ok()).collect();
        match *errors.unwrap_or_default() {
            [error] => Ok(error.into()),
            [density, diffuse, features] => Ok(Self::new(density, diffuse, features)),
            [density, diffuse, features, second] => {
                Ok(Self::new(density, diffuse, features).with_bands(second, second))
            }
            [density, diffuse, features, second, third] => {
                Ok(Self::new(density, diffuse, features).with_bands(second, third))
            }
            [density, diffuse, features, second, third, brightness, anisotropy] => {
                let errors = Self::new(density, diffuse, features).with_bands(second, third);
                Ok(errors.with_direction(brightness, anisotropy))
            }
            _ => Err("expected a number, or three, four, five or seven with colons between"),
        }
    }
}

impl Serialize for MaxErrors {
    fn serialize<S: Serializer>(&self, to: S) -> std::result::Result<S::Ok, S::Error> {
        self.to_json().serialize(to)
    }
}

impl<'de> Deserialize<'de> for MaxErrors {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        let expected = "expected a number, or three, four, five or seven with colons between";
        Self::from_json(&Value::deserialize(from)?)
            .ok_or_else(|| serde::de::Error::custom(expected))
    }
}

impl fmt::Display for MaxErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text(|error| error.to_string()))
    }
}

impl fmt::LowerExp for MaxErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text(|error| format!("{error:e}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_json_say_the_same() {
        for (text, json) in [
            ("0.02", "0.02"),
            ("0.02:0.014:0.06", "\"0.02:0.014:0.06\""),
            ("0.1:0.01:0.02:0.03", "\"0.1:0.01:0.02:0.03\""),
            ("0.1:0.01:0.02:0.03:0.04", "\"0.1:0.01:0.02:0.03:0.04\""),
            ("0.1:0.01:0.02:0.02:0.02:0.05:0.06", "\"0.1:0.01:0.02:0.02:0.02:0.05:0.06\""),
        ] {
            let errors: MaxErrors = text.parse().expect("errors");
            assert_eq!(errors.to_string(), text);
            assert_eq!(MaxErrors::from_json(&errors.to_json()), Some(errors));
            let read = serde_json::from_str(json).expect("JSON");
            assert_eq!(MaxErrors::from_json(&read), Some(errors));
        }
        for text in ["", "0.1:0.2", "0.1:0.2:0.3:0.4:0.5:0.6", "a", "0.1:b:0.2", ":", "0.1,0.2,0.3"]
        {
            assert!(text.parse::<MaxErrors>().is_err(), "{text}");
        }
        assert_eq!(MaxErrors::from_json(&Value::Null), None);
    }

    #[test]
    fn every_error_is_checked() {
        assert!(MaxErrors::new(0.1, 1e-6, 0.25).check().is_ok());
        for wrong in [0.0, 0.26, f32::NAN] {
            for errors in [[wrong, 0.1, 0.1], [0.1, wrong, 0.1], [0.1, 0.1, wrong]] {
                let [density, diffuse, features] = errors;
                assert!(MaxErrors::new(density, diffuse, features).check().is_err(), "{errors:?}");
            }
        }
    }
}
