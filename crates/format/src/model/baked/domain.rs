//! The meaning of decoded values.

use serde::{Deserialize, Serialize};

use crate::model::activate;
use crate::model::harmonics::BAND_GAIN;
use crate::model::scene::{Activation, INVISIBLE_OPACITY};

/// The form in which a level stores density.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DensityDomain {
    /// Raw density, the input of the activation.
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

    /// Opacity over one interval, 0 to 1. Monotone in the value.
    pub fn opacity(self, value: f64, activation: &Activation) -> f64 {
        match self {
            Self::Raw => activation.opacity(value),
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
    /// Colour itself.
    Linear,
    /// A coefficient of this band of harmonics, 0 to 3.
    Coefficient(u8),
    /// Directional brightness: a part of a vector whose dot product with the unit direction of a
    /// ray is added to all three logits of diffuse colour.
    Directional,
    /// Anisotropy: a coefficient of a function of band 2, whose sum in the direction of a ray is
    /// added to the square root of optical depth.
    Anisotropy,
}

/// The largest change of a colour if all three components of directional brightness change by 1:
/// the dot product with a unit vector changes by at most `sqrt(3)`, and the sigmoid's slope is at
/// most 1/4.
const DIRECTIONAL_GAIN: f64 = 0.433_012_701_892_219_3;
/// The largest change of opacity if all five values of anisotropy change by 1: the sum changes by
/// at most `sqrt(5) * sqrt(5 / (4 pi))`, and the slope of `1 - exp(-u^2)` is at most `sqrt(2 / e)`.
const ANISOTROPY_GAIN: f64 = 1.209_867_5;

impl Decode {
    /// Every meaning.
    pub const ALL: [Self; 11] = [
        Self::Density(DensityDomain::Raw),
        Self::Density(DensityDomain::SqrtOpticalDepth),
        Self::Density(DensityDomain::Opacity),
        Self::Logit,
        Self::Linear,
        Self::Coefficient(0),
        Self::Coefficient(1),
        Self::Coefficient(2),
        Self::Coefficient(3),
        Self::Directional,
        Self::Anisotropy,
    ];

    /// Opacity over one interval, or colour from 0 to 1. For coefficients, the largest colour that
    /// a band of such coefficients adds in any direction; for directional brightness, that of three
    /// such values; for anisotropy, the largest opacity that five such values add. Errors are
    /// stated in these units. Monotone in the value.
    pub fn activated(self, value: f64, activation: &Activation) -> f64 {
        match self {
            Self::Density(domain) => domain.opacity(value, activation),
            Self::Logit => activate::sigmoid(value),
            Self::Linear => value,
            Self::Coefficient(band) => value * BAND_GAIN[usize::from(band.min(3))],
            Self::Directional => value * DIRECTIONAL_GAIN,
            Self::Anisotropy => value * ANISOTROPY_GAIN,
        }
    }

    /// The domain of density; none for other values.
    pub const fn density(self) -> Option<DensityDomain> {
        match self {
            Self::Density(domain) => Some(domain),
            Self::Logit
            | Self::Linear
            | Self::Coefficient(_)
            | Self::Directional
            | Self::Anisotropy => None,
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
    Linear,
    #[serde(rename = "band_0")]
    Band0,
    #[serde(rename = "band_1")]
    Band1,
    #[serde(rename = "band_2")]
    Band2,
    #[serde(rename = "band_3")]
    Band3,
    DirectionalLogit,
    DirectionalSqrtDepth,
}

impl From<Name> for Decode {
    fn from(name: Name) -> Self {
        match name {
            Name::RawDensity => Self::Density(DensityDomain::Raw),
            Name::SqrtOpticalDepth => Self::Density(DensityDomain::SqrtOpticalDepth),
            Name::Opacity => Self::Density(DensityDomain::Opacity),
            Name::Logit => Self::Logit,
            Name::Linear => Self::Linear,
            Name::Band0 => Self::Coefficient(0),
            Name::Band1 => Self::Coefficient(1),
            Name::Band2 => Self::Coefficient(2),
            Name::Band3 => Self::Coefficient(3),
            Name::DirectionalLogit => Self::Directional,
            Name::DirectionalSqrtDepth => Self::Anisotropy,
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
            Decode::Linear => Self::Linear,
            Decode::Coefficient(0) => Self::Band0,
            Decode::Coefficient(1) => Self::Band1,
            Decode::Coefficient(2) => Self::Band2,
            Decode::Coefficient(_) => Self::Band3,
            Decode::Directional => Self::DirectionalLogit,
            Decode::Anisotropy => Self::DirectionalSqrtDepth,
        }
    }
}
