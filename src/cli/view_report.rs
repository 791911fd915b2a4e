//! The kind of view dependence, for reports.

use std::path::Path;

use serde::Serialize;

use crate::base::error::{Error, Result};
use crate::model::baked::ViewMetadata;
use crate::view::compare::DirectionErrors;
use mipvog_inputs::Source;

/// The PSNR of equal colours.
const EQUAL_PSNR: f64 = 200.0;

/// View-dependent colour.
#[derive(Debug, Clone, Copy, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct ViewReport {
    /// `network`, `spherical_harmonics` or `none`.
    kind: &'static str,
    /// The highest band of harmonics.
    degree: Option<usize>,
    /// True if coefficients were fitted to a network's colours.
    fitted: bool,
    /// PSNR of fitted colours along held-out directions.
    held_out_psnr: Option<f64>,
    /// Share of visible weight whose colours are clamped; null where it was not measured.
    clamped_share: Option<f64>,
    /// The least PSNR of fitted colours, if one is required.
    required_psnr: Option<f64>,
    /// True if whoever made the fit knows the figure; the input itself has only its result.
    #[serde(skip)]
    is_stated: bool,
}

/// A fit of colours that was made before the bake, by a program that holds this library.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColorFit {
    /// The degree of its harmonics.
    pub degree: usize,
    /// PSNR along directions that the fit has not seen.
    pub held_out_psnr: f64,
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
            is_stated: false,
        }
    }

    /// Of a trained input. Where its colours are fitted, it says so as an assumption, or `fit` is
    /// known. The figure of a fit is that of its degree: fewer bands of it are another fit.
    pub fn of_source(source: &Source, fit: Option<ColorFit>) -> Self {
        let own = Self::of(source.field.view.as_ref().map(ViewMetadata::of).as_ref());
        if let Some(fit) = fit.filter(|_| own.degree.is_some()) {
            let held_out_psnr = Some(fit.held_out_psnr).filter(|_| own.degree == Some(fit.degree));
            return Self { fitted: true, held_out_psnr, is_stated: true, ..own };
        }
        let is_fitted = source.assumptions.iter().any(|assumption| assumption.key == "view");
        Self { fitted: is_fitted && own.degree.is_some(), ..own }
    }

    /// Holds the view to the least figure that is required of its fit.
    ///
    /// # Errors
    /// `Usage` where there will be no figure to judge.
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

    /// With the figures of a comparison along directions. Colours that were not fitted are the
    /// model's own.
    pub fn measured(&mut self, errors: DirectionErrors) {
        self.clamped_share = errors.clamped_share;
        if self.fitted && !self.is_stated {
            // Equal colours have no finite figure, which JSON could not hold.
            self.held_out_psnr = errors.psnr.map(|psnr| psnr.min(EQUAL_PSNR));
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
            Some(found) => format!("{found:.2} dB along held-out directions"),
            None => "there was no visible colour along held-out directions".to_owned(),
        };
        Some(format!("{output}: not written: {found}, {least} dB required"))
    }

    /// For people; empty where nothing was measured.
    pub fn lines(&self) -> Vec<String> {
        let Some(degree) = self.degree else { return Vec::new() };
        let fitted = self.held_out_psnr.map(|psnr| {
            format!("  colours fitted by harmonics of degree {degree}: {psnr:.2} dB in held-out directions")
        });
        let clamped = self
            .clamped_share
            .map(|share| format!("  {:.2} % of the visible colour is clamped at 0", 100.0 * share));
        fitted.into_iter().chain(clamped).collect()
    }
}
