//! A container without its finest levels.
//!
//! Level `n` becomes level 0, and pictures that read no finer level do not change:
//!
//! * **Level of detail.** A footprint is measured in voxels of level 0. Those are now about `2^n`
//!   times as long, so `log2(rho)` falls by `n`: bends move, and the bias makes up for the rest.
//! * **Steps that grow with the level.** A sample of level `n` stood for `2^n` intervals. The new
//!   interval is that, so voxel size and interval grow, and the step length in voxels stays. A
//!   stored square root of optical depth over one interval grows by `sqrt(2^n)`: its codes stay,
//!   their values are scaled. Opacity over one interval has no such scale.
//! * **Steps of constant length.** Step and interval stay. The step is a smaller part of a voxel.
//!
//! The opacity of blocks that were dropped was counted over the step of each level, and stays.

use crate::base::error::{Error, Result};
use crate::container::OtherChunk;
use crate::model::baked::{DensityDomain, Encoding, LevelMetadata, Metadata, NumberType, StepRule};
use crate::model::field::Activation;
use crate::quantize::{Bits, density_encoding};
use crate::unpacked::Unpacked;

/// The axes' shrink factors may differ by this much. More would be visible, because one bias serves
/// all axes.
const LARGEST_SPREAD: f64 = 1.25;

/// Opacity by which three roundings to f32 of a square root of optical depth may move.
const ROUNDING: f64 = 2.5e-7;

/// Drops the `count` finest levels.
///
/// # Errors
///
/// [`crate::base::error::ErrorKind::InvalidOption`] where no level would stay, and where the format
/// cannot represent the result.
pub fn drop_finest(unpacked: &mut Unpacked, count: usize) -> Result<()> {
    let scales = drop_from_metadata(&mut unpacked.metadata, count)?;
    unpacked.levels.drain(..count);
    keep_from(&mut unpacked.others, count);
    for (level, scale) in unpacked.levels.iter_mut().zip(scales) {
        level.density_scale *= scale;
    }
    Ok(())
}

/// Drops unknown chunks of the first `count` levels, and numbers those of the others anew.
fn keep_from(chunks: &mut Vec<OtherChunk>, count: usize) {
    let Ok(count) = u32::try_from(count) else { return chunks.clear() };
    chunks.retain(|chunk| chunk.level.is_none_or(|level| level >= count));
    chunks.iter_mut().filter_map(|chunk| chunk.level.as_mut()).for_each(|level| *level -= count);
}

/// As [`drop_finest`], of the metadata alone. Returns the scale of each remaining level's
/// densities. Integer codes are the same after it.
///
/// # Errors
///
/// Those of [`drop_finest`].
pub fn drop_from_metadata(metadata: &mut Metadata, count: usize) -> Result<Vec<f32>> {
    if count == 0 {
        return Ok(vec![1.0; metadata.levels.len()]);
    }
    let levels = metadata.levels.len();
    let refuse = |expected: String| {
        Err(Error::invalid_option("without_finest", count.to_string(), expected))
    };
    let Some(finest) = metadata.levels.get(count) else {
        return refuse(format!("at most {}: there are {levels} levels", levels - 1));
    };
    if finest.density.is_none() {
        return refuse("0: coarser levels take their density from level 0".to_owned());
    }
    let (from, to) = (metadata.levels[0].dimensions, finest.dimensions);
    let ratios = [0, 1, 2].map(|axis| to[axis] as f64 / from[axis] as f64);
    let [least, most] = [f64::min, f64::max].map(|end| ratios.into_iter().reduce(end));
    if most > least.map(|least| least * LARGEST_SPREAD) {
        return refuse(format!(
            "fewer: the axes shrink by different shares, from {from:?} to {to:?} nodes, and \
             the level-of-detail rule has one for all"
        ));
    }
    let grows = metadata.step_rule == StepRule::LevelOfDetail;
    let domains: Vec<DensityDomain> =
        metadata.levels[count..].iter().map(|level| level.density_domain()).collect();
    if grows && domains.contains(&DensityDomain::Opacity) {
        return refuse(format!(
            "0: levels of filter {} hold opacity over one interval of level 0",
            metadata.filter
        ));
    }
    let times = libm::exp2(count as f64);
    let rule = &mut metadata.level_of_detail;
    let shrunk = ratios.into_iter().map(libm::log2).sum::<f64>() / 3.0;
    let bias = f64::from(rule.bias) - count as f64 - f64::from(rule.factor) * shrunk;
    rule.bias = bias as f32;
    rule.bends.as_mut_slice().iter_mut().for_each(|[at, _]| *at += shrunk as f32);
    rule.bound = rule.bound.map(|bound| (bound - count as f32).max(0.0));
    let march = &mut metadata.march;
    march.voxel_size *= times as f32;
    march.voxel.iter_mut().flatten().for_each(|edge| *edge *= times as f32);
    if grows {
        metadata.activation.interval *= times as f32;
    } else {
        march.stepsize /= times as f32;
    }
    metadata.levels.drain(..count);
    let activation = metadata.activation;
    let scale = |(level, domain): (&mut LevelMetadata, DensityDomain)| {
        let mut scale = 1.0;
        let own = [level.density.as_mut(), level.anisotropy.as_mut()];
        for own in own.into_iter().flatten().filter(|_| grows) {
            // The same for both.
            scale = over_longer_interval(own, domain, times, &activation);
        }
        scale
    };
    Ok(metadata.levels.iter_mut().zip(domains).map(scale).collect())
}

/// Makes an encoding of density or its anisotropy one over an interval that is `times` as long, and
/// returns the scale of values. With `T` the transmittance over an interval, `T^times` moves by at
/// most `times` as much as `T`.
fn over_longer_interval(
    density: &mut Encoding,
    domain: DensityDomain,
    times: f64,
    activation: &Activation,
) -> f32 {
    let mut error = f64::from(density.max_error) * times;
    let mut scale = 1.0;
    if domain == DensityDomain::SqrtOpticalDepth {
        scale = times.sqrt() as f32;
        let scaled = [&mut density.center, &mut density.step, &mut density.curve];
        scaled.into_iter().for_each(|number| *number *= scale);
        density.empty *= scale;
        error += ROUNDING;
        if density.number == NumberType::F16 {
            error += f64::from(density_encoding(Bits::F16, domain, activation).max_error);
        }
    }
    density.max_error = ((error * (1.0 + 1e-6)) as f32).min(1.0);
    scale
}
