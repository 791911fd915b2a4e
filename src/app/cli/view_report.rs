//! The kind of view dependence, as reports state it.

use serde::Serialize;

use crate::input::Source;
use crate::model::baked::ViewMetadata;

/// View-dependent colour.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct ViewReport {
    /// `network`, `spherical_harmonics` or `none`.
    kind: &'static str,
    /// The highest band of harmonics.
    degree: Option<usize>,
    /// True if coefficients were fitted to a network's colours.
    fitted: bool,
    /// PSNR of fitted colours along directions that no fit has seen.
    held_out_psnr: Option<f64>,
    /// Share of visible weight whose colours are clamped; null where it was not measured.
    clamped_share: Option<f64>,
}

impl ViewReport {
    /// Of a container.
    pub fn of(view: Option<&ViewMetadata>) -> Self {
        let (kind, degree) = match view {
            Some(ViewMetadata::Harmonics(harmonics)) => {
                ("spherical_harmonics", Some(harmonics.rules.degree))
            }
            Some(ViewMetadata::Network(_)) => ("network", None),
            None => ("none", None),
        };
        Self { kind, degree, fitted: false, held_out_psnr: None, clamped_share: None }
    }

    /// Of a trained input. Where its colours are fitted, it says so as an assumption.
    pub fn of_source(source: &Source) -> Self {
        let own = Self::of(source.field.view.as_ref().map(ViewMetadata::of).as_ref());
        let is_fitted = source.assumptions.iter().any(|assumption| assumption.key == "view");
        Self { fitted: is_fitted && source.field.harmonics().is_some(), ..own }
    }
}
