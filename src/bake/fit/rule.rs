//! The level-of-detail rule that fitted levels look best with.
//!
//! Levels are fitted under one rule, the filter's. A finer factor or bias may suit a scene better: of
//! rules around the first, that one is taken whose pictures at all scales have the highest mean PSNR.

use super::context::psnr;
use super::course::mean_square;
use super::gradient::Rays;
use super::target::Targets;
use crate::base::error::Result;
use crate::model::baked::LevelOfDetail;
use crate::view::render::View;
use crate::view::sample::Dense;

/// Steps of factor and bias, tried one after another.
const STEPS: [f32; 2] = [0.05, 0.025];
/// Rays of each scale that a rule is judged by.
const RAYS: usize = 2048;
/// Changes of factor and bias, at most, for each step length.
const MOST_CHANGES: usize = 4;

/// Searches around `start`, downhill along factor and bias; leaves what it found in `view`.
pub fn search<const C: usize>(
    view: &mut View,
    start: LevelOfDetail,
    field: &Dense<C>,
    targets: &Targets,
    coarser: usize,
) -> Result<LevelOfDetail> {
    let mut quality = |rule: LevelOfDetail| -> Result<f64> {
        view.level_of_detail = Some(rule);
        let mut sum = 0.0;
        for level in 1..=coarser {
            let rays = Rays { view, field, levels: coarser + 1, level, targets, numbers: &[] };
            sum += psnr(mean_square(&rays, RAYS)?);
        }
        Ok(sum)
    };
    let (mut best, mut highest) = (start, quality(start)?);
    for step in STEPS {
        for _ in 0..MOST_CHANGES {
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
