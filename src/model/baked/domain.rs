//! The meaning of decoded values.

use serde::{Deserialize, Serialize};

use crate::model::activate;
use crate::model::field::{Activation, INVISIBLE_OPACITY};

/// The form in which a level stores density.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DensityDomain {
    /// Raw density, a logit: `sigma = softplus(value + shift)`.
    #[serde(rename = "raw_density")]
    Raw,
    /// Square root of the optical depth over one interval: `alpha = 1 - exp(-value^2)`.
    SqrtOpticalDepth,
    /// Opacity over one interval, 0 to 1.
    Opacity,
}

impl DensityDomain {
    /// Every domain.
    pub const ALL: [Self; 3] = [Self::Raw, Self::SqrtOpticalDepth, Self::Opacity];

    /// Opacity over one interval, 0 to 1. It never falls where values rise.
    pub fn opacity(self, value: f64, activation: &Activation) -> f64 {
        match self {
            Self::Raw => {
                activate::opacity(value, activation.shift.into(), activation.interval.into())
            }
            Self::SqrtOpticalDepth => -libm::expm1(-value * value),
            Self::Opacity => value.clamp(0.0, 1.0),
        }
    }

    /// The density of [`INVISIBLE_OPACITY`]: no picture shows this value or a lower one.
    pub fn invisible(self, activation: &Activation) -> f32 {
        match self {
            Self::Raw => activation.invisible_raw(),
            Self::SqrtOpticalDepth => INVISIBLE_OPACITY.sqrt() as f32,
            Self::Opacity => INVISIBLE_OPACITY as f32,
        }
    }
}

/// The meaning of a decoded value of any group.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "Name", into = "Name")]
pub enum Decode {
    /// Density.
    Density(DensityDomain),
    /// Raw colour: `sigmoid(value)`.
    Logit,
}

impl Decode {
    /// Every meaning.
    pub const ALL: [Self; 4] = [
        Self::Density(DensityDomain::Raw),
        Self::Density(DensityDomain::SqrtOpticalDepth),
        Self::Density(DensityDomain::Opacity),
        Self::Logit,
    ];

    /// Opacity over one interval, or colour from 0 to 1. Errors are stated in these. It never falls
    /// where values rise.
    pub fn activated(self, value: f64, activation: &Activation) -> f64 {
        match self {
            Self::Density(domain) => domain.opacity(value, activation),
            Self::Logit => activate::sigmoid(value),
        }
    }

    /// The domain of density; none for colour.
    pub const fn density(self) -> Option<DensityDomain> {
        match self {
            Self::Density(domain) => Some(domain),
            Self::Logit => None,
        }
    }
}

/// The names in a container.
#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Name {
    RawDensity,
    Logit,
    SqrtOpticalDepth,
    Opacity,
}

impl From<Name> for Decode {
    fn from(name: Name) -> Self {
        match name {
            Name::RawDensity => Self::Density(DensityDomain::Raw),
            Name::SqrtOpticalDepth => Self::Density(DensityDomain::SqrtOpticalDepth),
            Name::Opacity => Self::Density(DensityDomain::Opacity),
            Name::Logit => Self::Logit,
        }
    }
}

impl From<Decode> for Name {
    fn from(decode: Decode) -> Self {
        match decode {
            Decode::Density(DensityDomain::Raw) => Self::RawDensity,
            Decode::Density(DensityDomain::SqrtOpticalDepth) => Self::SqrtOpticalDepth,
            Decode::Density(DensityDomain::Opacity) => Self::Opacity,
            Decode::Logit => Self::Logit,
        }
    }
}
