//! Interpolated values of a sample to its colour.

use super::view::View;
use crate::model::activate::lanes;
use crate::model::field::ColorDomain;
use crate::model::harmonics::{Basis, Harmonics, basis};
use crate::model::view_dependence::ViewDependence;

/// The colours of samples along rays of one direction.
#[derive(Debug, Clone, Copy)]
pub enum ColorRule<'a> {
    /// Values are logits.
    Logit,
    /// Values are colours.
    Linear,
    /// Values are coefficients of harmonics. Of the result only three lanes are not 0.
    Harmonics(&'a Harmonics, Basis),
}

impl<'a> ColorRule<'a> {
    /// Of rays with this unit direction.
    pub fn of(view: &'a View, direction: [f64; 3]) -> Self {
        match (&view.view_dependence, view.color_domain) {
            (Some(ViewDependence::Harmonics(rules)), _) => Self::Harmonics(rules, basis(direction)),
            (_, ColorDomain::Linear) => Self::Linear,
            (_, ColorDomain::Logit) => Self::Logit,
        }
    }

    /// Turns interpolated values into colours and features.
    #[inline(always)]
    pub fn activate<const C: usize>(&self, color: &mut [f32; C]) {
        match self {
            Self::Logit => color.iter_mut().for_each(|value| *value = lanes::sigmoid(*value)),
            Self::Linear => {}
            Self::Harmonics(rules, basis) => {
                let sums = rules.sample(basis, color);
                *color = [0.0; C];
                color.iter_mut().zip(sums).for_each(|(value, sum)| *value = sum);
            }
        }
    }

    /// Limits the sums of a ray whose counted samples weigh so much.
    pub fn finish<const C: usize>(&self, color: &mut [f32; C], weight: f32) {
        if let Self::Harmonics(rules, _) = self {
            let sums = [0, 1, 2].map(|channel| color[channel]);
            let limited = rules.ray(sums, weight);
            color.iter_mut().zip(limited).for_each(|(value, color)| *value = color);
        }
    }
}
