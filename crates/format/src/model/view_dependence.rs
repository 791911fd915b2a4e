//! Colour that depends on the direction of a ray.

use super::harmonics::Harmonics;
use super::view_mlp::ViewMlp;
use crate::base::error::{Place, Result};

/// Colour that depends on the direction of a ray.
#[derive(Debug, Clone, PartialEq)]
pub enum ViewDependence {
    /// A network that runs once per ray on the accumulated features. Its colour is added.
    Network(ViewMlp),
    /// Harmonics, whose coefficients are the colour channels.
    Harmonics(Harmonics),
}

impl ViewDependence {
    /// The network, if it is one.
    pub fn network(&self) -> Option<&ViewMlp> {
        match self {
            Self::Network(network) => Some(network),
            Self::Harmonics(_) => None,
        }
    }

    /// The harmonics, if it is them.
    pub fn harmonics(&self) -> Option<&Harmonics> {
        match self {
            Self::Network(_) => None,
            Self::Harmonics(harmonics) => Some(harmonics),
        }
    }

    /// Refuses view dependence that does not fit a field of `features` colour channels beyond
    /// three.
    ///
    /// # Errors
    /// `Malformed`, or `Unsupported` for networks that run at every sample.
    pub fn check(&self, features: usize, place: &Place) -> Result<()> {
        match self {
            Self::Network(network) => network.check(features, place),
            Self::Harmonics(harmonics) => harmonics.check(features, place),
        }
    }
}
