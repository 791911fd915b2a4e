//! The kind of view dependence, as reports state it.

use std::path::Path;

use serde::Serialize;

use crate::input::Source;
use crate::model::baked::ViewMetadata;
use crate::view::compare::DirectionErrors;

/// The figure of colours that are equal.
const EQUAL_PSNR: f64 = 200.0;

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
    /// The least PSNR of fitted colours, if one is required.
    required_psnr: Option<f64>,
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
        Self {
            kind,
            degree,
            fitted: false,
            held_out_psnr: None,
            clamped_share: None,
            required_psnr: None,
        }
    }

    /// Of a trained input. Where its colours are fitted, it says so as an assumption.
    pub fn of_source(source: &Source) -> Self {
        let own = Self::of(source.field.view.as_ref().map(ViewMetadata::of).as_ref());
        let is_fitted = source.assumptions.iter().any(|assumption| assumption.key == "view");
        Self { fitted: is_fitted && source.field.harmonics().is_some(), ..own }
    }

    /// True if colours were fitted.
    pub const fn is_fitted(&self) -> bool {
        self.fitted
    }

    /// True for harmonics.
    pub const fn has_harmonics(&self) -> bool {
        self.degree.is_some()
    }

    /// With the figures of a comparison along directions. Colours that were not fitted are the
    /// model's own.
    pub fn measured(&mut self, errors: DirectionErrors, required: Option<f64>) {
        self.clamped_share = errors.clamped_share;
        if self.fitted {
            // Equal colours have no finite figure, which JSON could not hold.
            self.held_out_psnr = errors.psnr.map(|psnr| psnr.min(EQUAL_PSNR));
            self.required_psnr = required;
        }
    }

    /// True if no figure is required, or it is reached.
    pub fn passes(&self) -> bool {
        let least = self.required_psnr;
        least.is_none_or(|least| self.held_out_psnr.is_some_and(|found| found >= least))
    }

    /// The reason why the container at `output` was not written, if the figure is missed.
    pub fn failure(&self, output: &Path) -> Option<String> {
        let least = self.required_psnr.filter(|_| !self.passes())?;
        let output = output.display();
        let found = match self.held_out_psnr {
            Some(found) => format!("{found:.2} dB along directions that no fit has seen"),
            None => "no visible colour was met along directions that no fit has seen".to_owned(),
        };
        Some(format!("{output}: not written: {found}, {least} dB required"))
    }

    /// For people; empty where nothing was measured.
    pub fn text(&self) -> String {
        let Some(degree) = self.degree else { return String::new() };
        let mut text = String::new();
        if let Some(psnr) = self.held_out_psnr {
            text += &format!(
                "  colours were fitted with harmonics of degree {degree}: {psnr:.2} dB along \
                 directions that no fit has seen\n"
            );
        }
        if let Some(share) = self.clamped_share {
            text += &format!("  {:.2} % of the visible colour is limited at 0\n", 100.0 * share);
        }
        text
    }
}
