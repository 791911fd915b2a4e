//! The level-of-detail rule under which fitted levels look best.
//!
//! Levels are fitted under the filter's rule. Another factor or bias may suit a scene better. Of
//! rules around the first, the search takes the one with the highest mean PSNR over all scales.

use super::context::{FitContext, psnr};
use super::gradient::Rays;
use super::level_fit::mean_square;
use crate::base::error::Result;
use crate::model::baked::LevelOfDetail;
use crate::view::render::View;
use crate::view::sample::Dense;

/// Steps of factor and bias, tried one after another.
const STEPS: [f32; 2] = [0.05, 0.025];
/// Rays of each scale that a rule is judged by.
const RAYS: usize = 2048;
/// Changes of factor and bias, at most, for each step length.
const MAX_CHANGES: usize = 4;

/// Searches around the first rule, uphill along factor and bias, and leaves the best rule in
/// `view`.
pub fn search<const C: usize>(
    view: &mut View,
    context: &FitContext,
    field: &Dense<C>,
    coarser: usize,
) -> Result<LevelOfDetail> {
    let FitContext { targets, start, progress, .. } = *context;
    let mut quality = |rule: LevelOfDetail| -> Result<f64> {
        view.level_of_detail = Some(rule);
        let mut sum = 0.0;
        for level in 1..=coarser {
            let rays = Rays { view, field, levels: coarser + 1, level, targets, numbers: &[] };
            sum += psnr(mean_square(&rays, RAYS, progress)?);
        }
        Ok(sum)
    };
    let (mut best, mut highest) = (start, quality(start)?);
    for step in STEPS {
        for _ in 0..MAX_CHANGES {
            let moved = |factor: f32, bias: f32| LevelOfDetail {
                factor: best.factor + factor,
                bias: best.bias + bias,
                ..best
            };
            let around = [moved(step, 0.0), moved(-step, 0.0), moved(0.0, step), moved(0.0, -step)];
            let mut found = None;
            for rule in around.into_iter().filter(|rule| rule.factor > 0.0) {
                let quality = quality(rule)?;
                if quality > highest {
                    highest = quality;
                    found = Some(rule);
                }
            }
            match found {
                Some(rule) => best = rule,
                None => break,
            }
        }
    }
    view.level_of_detail = Some(best);
    Ok(best)
}
