//! torch-ngp's checkpoints.
//!
//! | key of `model` | meaning |
//! |---|---|
//! | `encoder.embeddings`, `encoder.offsets` | the table, and the first entry of each level |
//! | `sigma_net.N.weight`, `color_net.N.weight` | matrices; the second takes the direction first |
//! | `density_bitfield` | a bit for each cell, Morton order, cubes of growing size |
//! | `aabb_train` | the box that the table spans |
//!
//! Rays of scenes beyond -1 to 1, in its units, with `n` cubes of `SIDE` cells along an edge:
//!
//! ```text
//! step = t / 128, from 2 sqrt(3) / 1024 to 2 sqrt(3) 2^(n - 1) / SIDE
//! cell = that of the smallest cube that holds the sample and whose cells are longer than the step
//! ```

use super::file::{Growth, NgpFile, Rules, check_network};
use super::frame::Frame;
use super::occupancy::Occupancy;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::lazy::Lazy;
use crate::model::grid::Element;
use crate::model::harmonics::FUNCTIONS;
use crate::options::SourceOptions;
use crate::packets::{Matrix, Sizes, Values};
use crate::tensor::{Tensor, TensorFile, Value};

/// Nodes along an axis of the first level, and of the finest one for a box from -1 to 1.
const BASE: u64 = 16;
const FINEST: f64 = 2048.0;
/// Steps of a ray through the first cube along its diagonal.
const STEPS: f64 = 1024.0;
/// Default ratio of a step to the distance (`--dt_gamma`).
const GROWTH: f64 = 1.0 / 128.0;
/// Cubes around the first one, at most.
const MOST_CUBES: u32 = 10;
/// Cells along an edge.
const SIDE: usize = 128;
/// Matrices of a network, at most.
const MOST_LAYERS: usize = 16;

/// A tensor of the dictionary `model`, or of a flat file with that prefix.
pub(super) fn model<'a>(file: &'a TensorFile, name: &str) -> Option<&'a Tensor> {
    let flat = || file.root.get(&format!("model.{name}"));
    file.root.at(&["model", name]).or_else(flat).and_then(Value::tensor)
}

fn required<'a>(file: &'a TensorFile, name: &str) -> Result<&'a Tensor> {
    model(file, name).ok_or_else(|| {
        let place = Place::Tensor(format!("model.{name}"));
        Error::malformed(place, "no such tensor", "a tensor that training with --cuda_ray writes")
    })
}

/// Reads everything but the parameters.
pub(super) fn read(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<NgpFile> {
    let mut budget = Budget::new(limits);
    let bound = bound(required(file, "aabb_train")?, &mut budget)?;
    let embeddings = required(file, "encoder.embeddings")?;
    let offsets = required(file, "encoder.offsets")?;
    let stated = match offsets.count() {
        2..=65 => offsets.read_f64(&mut budget)?,
        count => {
            let found = format!("{count} offsets of levels");
            return Err(Error::malformed(offsets.place(), found, "2 to 65"));
        }
    };
    let &[entries, features] = embeddings.shape() else {
        let found = format!("shape {:?}", embeddings.shape());
        return Err(Error::malformed(embeddings.place(), found, "[entries, features]"));
    };
    let largest = stated.windows(2).filter_map(|pair| match pair {
        [from, to] => Some(to - from),
        _ => None,
    });
    let largest = largest.fold(1.0, f64::max);
    #[expect(clippy::cast_possible_truncation, reason = "small")]
    let log2_entries = libm::ceil(libm::log2(largest)) as u64;
    let count = offsets.count() - 1;
    let sizes = Sizes { levels: count, features, log2_entries, base: BASE, more: 1 };
    sizes.check(&embeddings.place())?;
    let steps = count.saturating_sub(1).max(1) as f64;
    #[expect(clippy::cast_possible_truncation, reason = "evaluated in float32")]
    let log2_ratio = (libm::log2(FINEST * bound / BASE as f64) / steps) as f32;
    let levels = sizes.levels(log2_ratio, &embeddings.place())?;
    let same = levels.offsets().zip(&stated).all(|(own, stated)| own as f64 == *stated);
    if !same || levels.entries() != entries {
        let found = format!("levels from {stated:?}");
        let own: Vec<u64> = levels.offsets().collect();
        let expected = format!("{own:?}, as {count} levels in this box have");
        return Err(Error::unsupported(offsets.place(), found, expected));
    }
    let density = matrices(file, "sigma_net")?;
    let color = matrices(file, "color_net")?;
    let geometry = density.last().map_or(0, |matrix| matrix.outputs);
    let place = |name: &str| Place::Tensor(format!("model.{name}"));
    check_network(&density, levels.width(), 2, &place("sigma_net"))?;
    check_network(&color, FUNCTIONS + geometry - 1, 3, &place("color_net"))?;
    // The unit cube of cells spans the box, at most -1 to 1.
    let half = bound.min(1.0);
    let frame = Frame { scale: 0.5 / half, offset: [0.5; 3] };
    let step = libm::sqrt(3.0) / STEPS / half;
    let span = if options.drop_background { 1.0 } else { bound / half };
    let cubes = 1 + (0..MOST_CUBES).take_while(|cube| span > libm::exp2(f64::from(*cube))).count();
    let growth = match cubes {
        1 => Growth::None,
        _ => Growth::Share {
            share: GROWTH,
            longest: libm::sqrt(3.0) * libm::exp2(cubes as f64 - 1.0) / SIDE as f64,
        },
    };
    Ok(NgpFile {
        levels,
        table: Values::all(embeddings)?,
        density,
        color,
        direction_first: true,
        reach: bound / half,
        span,
        per_edge: 2.0 * half,
        frame,
        occupancy: occupancy(required(file, "density_bitfield")?, cubes, span, limits)?,
        rules: Rules { step, growth, min_transmittance: 1e-4, divides: false },
        limits: limits.clone(),
        loaded: Lazy::default(),
    })
}

/// Half the edge of a box around 0.
fn bound(tensor: &Tensor, budget: &mut Budget) -> Result<f64> {
    let corners = if tensor.count() == 6 { tensor.read_f64(budget)? } else { Vec::new() };
    match corners.as_slice() {
        &[a, b, c, x, y, z] if x > 0.0 && x < 1e3 && [a, b, c] == [-x; 3] && [y, z] == [x; 2] => {
            Ok(x)
        }
        _ => {
            let found = format!("{corners:?}");
            Err(Error::unsupported(tensor.place(), found, "a cube around 0"))
        }
    }
}

/// The matrices of a network, first to last.
fn matrices(file: &TensorFile, name: &str) -> Result<Vec<Matrix>> {
    let mut found = Vec::new();
    for number in 0..MOST_LAYERS {
        let Some(tensor) = model(file, &format!("{name}.{number}.weight")) else { break };
        let &[outputs @ 1..=1024, inputs @ 1..=1024] = tensor.shape() else {
            let shape = format!("shape {:?}", tensor.shape());
            return Err(Error::malformed(tensor.place(), shape, "[outputs, inputs], 1 to 1024"));
        };
        let [outputs, inputs] = [outputs, inputs].map(|n| usize::try_from(n).unwrap_or(0));
        found.push(Matrix { values: Values::all(tensor)?, outputs, inputs });
    }
    Ok(found)
}

/// The cells of the cubes.
fn occupancy(tensor: &Tensor, cubes: usize, span: f64, limits: &Limits) -> Result<Occupancy> {
    let bytes = SIDE.pow(3) / 8;
    let all = cubes * bytes;
    if tensor.element() != Element::U8 || tensor.count() < all as u64 {
        let found = format!("{} {} numbers", tensor.count(), tensor.element().name());
        let expected = format!("at least {all} bytes");
        return Err(Error::malformed(tensor.place(), found, expected));
    }
    let mut budget = Budget::new(limits);
    let mut bits: Vec<u8> = budget.zeroed(all, "bytes of cells", &tensor.place())?;
    tensor.storage(&mut budget)?.read_into(0, &mut bits)?;
    let cells = |bytes: &[u8]| {
        bytes.iter().flat_map(|byte| (0..8).map(move |bit| byte >> bit & 1 == 1)).collect()
    };
    Ok(Occupancy::new(SIDE, span, bits.chunks(bytes).map(cells).collect()))
}
