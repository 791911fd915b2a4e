//! The rules of harmonics as a container states them.

use serde::{Deserialize, Serialize};

use crate::model::harmonics::Harmonics;

/// The rules of harmonics.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct HarmonicsMetadata {
    /// The name of the kind.
    kind: HarmonicsKind,
    /// The rules.
    #[serde(flatten)]
    pub rules: Harmonics,
}

/// The name of the kind.
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
