//! The kind of view dependence, for reports.

use std::path::Path;

use serde::Serialize;

use crate::base::error::{Error, Result};
use crate::model::baked::ViewMetadata;
use crate::view::compare::DirectionErrors;
use mipvog_inputs::Source;

/// The PSNR of equal colours.
const EQUAL_PSNR: f64 = 200.0;

/// View-dependent colour of a field.
#[derive(Debug, Clone, Copy, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct ViewReport {
    /// `network`, `spherical_harmonics` or `none`.
    kind: &'static str,
    /// Degree of the harmonics, 0 to 3; null without harmonics.
    degree: Option<usize>,
    /// True if the harmonics were fitted to the colours of a network.
    fitted: bool,
    /// PSNR of the fitted colours along held-out directions in dB, at most 200; null if not
    /// measured.
    held_out_psnr: Option<f64>,
    /// Share of the visible weight whose colours are clamped, 0 to 1; null if not measured.
    clamped_share: Option<f64>,
    /// Required PSNR of the fitted colours in dB; null if none is required.
    required_psnr: Option<f64>,
    /// True if the maker of the fit stated its PSNR, which the input does not record.
    #[serde(skip)]
    is_stated: bool,
}

/// A fit of colours that a program embedding this library made before the bake.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColorFit {
    /// Degree of the harmonics.
    pub degree: usize,
    /// PSNR along held-out directions in dB.
    pub held_out_psnr: f64,
}

impl ViewReport {
    /// View-dependent colour of a container.
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
            is_stated: false,
        }
    }

    /// View-dependent colour of a trained input. Fitted colours show as an assumption of the input,
    /// or as `fit`. The PSNR of `fit` is valid for its own degree only: with fewer bands, it is
    /// another fit.
    pub fn of_source(source: &Source, fit: Option<ColorFit>) -> Self {
        let own = Self::of(source.field.view.as_ref().map(ViewMetadata::of).as_ref());
        if let Some(fit) = fit.filter(|_| own.degree.is_some()) {
            let held_out_psnr = Some(fit.held_out_psnr).filter(|_| own.degree == Some(fit.degree));
            return Self { fitted: true, held_out_psnr, is_stated: true, ..own };
        }
        let is_fitted = source.assumptions.iter().any(|assumption| assumption.key == "view");
        Self { fitted: is_fitted && own.degree.is_some(), ..own }
    }

    /// Requires a PSNR of the fit.
    ///
    /// # Errors
    /// `Usage` if the PSNR of this view is never measured.
    pub fn require(&mut self, least: Option<f64>) -> Result<()> {
        self.required_psnr = least;
        let reason = match (least, self.fitted) {
            (None, _) => return Ok(()),
            (Some(_), false) => {
                "no colour of this input is fitted: it keeps its own, or has none \
                                 that depend on the view"
            }
            (Some(_), true) if self.is_stated && self.held_out_psnr.is_none() => {
                "the fit was made with harmonics of another degree, whose figure is not this one's: \
                 fit with the degree that is stored"
            }
            (Some(_), true) => return Ok(()),
        };
        Err(Error::usage(format!("--require-view-psnr has nothing to judge: {reason}")))
    }

    /// True if colours were fitted.
    pub const fn is_fitted(&self) -> bool {
        self.fitted
    }

    /// True for harmonics.
    pub const fn has_harmonics(&self) -> bool {
        self.degree.is_some()
    }

    /// Adds the errors of a comparison along directions. Colours that were not fitted have no PSNR:
    /// they are the model's own.
    pub fn measured(&mut self, errors: DirectionErrors) {
        self.clamped_share = errors.clamped_share;
        if self.fitted && !self.is_stated {
            // Equal colours have no finite figure, which JSON could not hold.
            self.held_out_psnr = errors.psnr.map(|psnr| psnr.min(EQUAL_PSNR));
        }
    }

    /// True if the required PSNR is reached or none is required.
    pub fn passes(&self) -> bool {
        let least = self.required_psnr;
        least.is_none_or(|least| self.held_out_psnr.is_some_and(|found| found >= least))
    }

    /// The reason for not writing the container at `output`, if the PSNR is too low.
    pub fn failure(&self, output: &Path) -> Option<String> {
        let least = self.required_psnr.filter(|_| !self.passes())?;
        let output = output.display();
        let found = match self.held_out_psnr {
            Some(found) => format!("{found:.2} dB along held-out directions"),
            None => "there was no visible colour along held-out directions".to_owned(),
        };
        Some(format!("{output}: not written: {found}, {least} dB required"))
    }

    /// The lines of the text report; empty if nothing was measured.
    pub fn lines(&self) -> Vec<String> {
        let Some(degree) = self.degree else { return Vec::new() };
        let fitted = self.held_out_psnr.map(|psnr| {
            format!("  colours fitted by harmonics of degree {degree}: {psnr:.2} dB in held-out directions")
        });
        let clamped = self
            .clamped_share
            .filter(|share| *share >= 5e-5)
            .map(|share| format!("  {:.2} % of the visible colour is clamped at 0", 100.0 * share));
        fitted.into_iter().chain(clamped).collect()
    }
}
