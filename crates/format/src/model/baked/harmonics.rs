//! The rules of harmonics as a container states them.

use serde::{Deserialize, Serialize};

use crate::model::harmonics::Harmonics;

/// View-dependent colour as spherical harmonics.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct HarmonicsMetadata {
    /// Always `spherical_harmonics`.
    kind: HarmonicsKind,
    /// The rules that turn coefficients into colours.
    #[serde(flatten)]
    pub rules: Harmonics,
}

/// The kind of view dependence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
enum HarmonicsKind {
    #[default]
    #[serde(rename = "spherical_harmonics")]
    SphericalHarmonics,
}

impl HarmonicsMetadata {
    /// Of these rules.
    pub fn new(rules: Harmonics) -> Self {
        Self { kind: HarmonicsKind::default(), rules }
    }
}
