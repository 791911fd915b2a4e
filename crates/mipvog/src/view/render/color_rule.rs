//! Converts the interpolated values of a sample to its colour.

use crate::model::activate::lanes;
use crate::model::directional::{DIRECTIONAL, added_logit};
use crate::model::field::ColorDomain;
use crate::model::harmonics::{Basis, Evaluation, Harmonics, basis};
use crate::model::view_dependence::ViewDependence;
use crate::view::sample::View;
use crate::view::sample::brightness;

/// The rule for the colours of samples, for rays of one direction.
#[derive(Debug, Clone, Copy)]
pub enum ColorRule<'a> {
    /// Values are logits.
    Logit,
    /// Values are logits. The last lanes hold directional brightness; its dot product with this
    /// unit direction is added to the first three. The last lanes of the result are 0.
    Directional([f32; DIRECTIONAL]),
    /// Values are colours.
    Linear,
    /// Values are coefficients of harmonics. Only three lanes of the result are not 0.
    Harmonics(&'a Harmonics, Basis),
}

impl<'a> ColorRule<'a> {
    /// The rule for rays with this unit direction.
    pub fn of(view: &'a View, direction: [f64; 3]) -> Self {
        match (&view.view_dependence, view.color_domain) {
            (Some(ViewDependence::Harmonics(rules)), _) => Self::Harmonics(rules, basis(direction)),
            (_, ColorDomain::Linear) => Self::Linear,
            (_, ColorDomain::Logit) if view.directional => {
                Self::Directional(direction.map(|part| part as f32))
            }
            (_, ColorDomain::Logit) => Self::Logit,
        }
    }

    /// Converts interpolated values to colours and features.
    #[inline(always)]
    pub fn activate<const C: usize>(&self, color: &mut [f32; C]) {
        match self {
            Self::Logit => color.iter_mut().for_each(|value| *value = lanes::sigmoid(*value)),
            Self::Directional(direction) => {
                let added = added_logit(*direction, brightness(color));
                color.iter_mut().take(3).for_each(|value| *value += added);
                color.iter_mut().for_each(|value| *value = lanes::sigmoid(*value));
                color.iter_mut().skip(C - DIRECTIONAL).for_each(|value| *value = 0.0);
            }
            Self::Linear => {}
            Self::Harmonics(rules, basis) => {
                let sums = rules.sample(basis, color);
                *color = [0.0; C];
                color.iter_mut().zip(sums).for_each(|(value, sum)| *value = sum);
            }
        }
    }

    /// Clamps the sums of a ray.
    pub fn finish<const C: usize>(&self, color: &mut [f32; C]) {
        if let Self::Harmonics(rules, _) = self {
            let limited = rules.ray([0, 1, 2].map(|channel| color[channel]));
            color.iter_mut().zip(limited).for_each(|(value, color)| *value = color);
        }
    }

    /// Converts `by_color`, the derivative by a ray's clamped colour, into that by its sums.
    pub fn by_sums<const C: usize>(&self, color: &[f32; C], by_color: &mut [f32; C]) {
        if let Self::Harmonics(rules, _) = self
            && rules.evaluation == Evaluation::Ray
        {
            for (by_color, color) in by_color.iter_mut().zip(color).take(3) {
                *by_color *= rules.slope(*color);
            }
        }
    }

    /// Converts `by_color`, the derivative by the `activated` colours, to the derivative by the
    /// interpolated values.
    #[inline(always)]
    pub fn by_values<const C: usize>(&self, activated: &[f32; C], by_color: &[f32; C]) -> [f32; C] {
        match self {
            Self::Logit => by_logits(activated, by_color),
            Self::Directional(direction) => {
                let mut by_values = by_logits(activated, by_color);
                let by_added = by_values[0] + by_values[1] + by_values[2];
                let last = by_values.iter_mut().skip(C - DIRECTIONAL);
                last.zip(direction).for_each(|(by, part)| *by = by_added * part);
                by_values
            }
            Self::Linear => *by_color,
            Self::Harmonics(rules, basis) => {
                let by_sum: [f32; 3] = [0, 1, 2].map(|channel| match rules.evaluation {
                    Evaluation::Ray => by_color[channel],
                    Evaluation::Sample => by_color[channel] * rules.slope(activated[channel]),
                });
                let mut by_values = [0.0; C];
                let functions = by_values.as_chunks_mut::<3>().0.iter_mut();
                for (by_values, value) in functions.zip(&basis[..rules.functions()]) {
                    *by_values = by_sum.map(|by_sum| by_sum * value);
                }
                by_values
            }
        }
    }
}

/// Converts `by_color`, the derivative by the `activated` values, to the derivative by the logits.
#[inline(always)]
fn by_logits<const C: usize>(activated: &[f32; C], by_color: &[f32; C]) -> [f32; C] {
    std::array::from_fn(|lane| by_color[lane] * activated[lane] * (1.0 - activated[lane]))
}
