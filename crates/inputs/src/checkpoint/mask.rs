//! The free-space mask: the region in which training kept samples.
//!
//! Three generations: the coarse stage's raw density, already max-pooled, which is interpolated and
//! compared with a threshold (`mask_cache.density`); a boolean mask with an affine index map
//! (`mask_cache.mask`); a boolean mask on the fine nodes alone (`nonempty_mask`).
//!
//! A point is inside the first where its opacity, with the *coarse* model's shift and ratio and
//! one whole voxel's step, reaches `mask_cache_thres`:
//!
//! ```text
//! 1 - exp(-softplus(raw + shift) * ratio) >= t
//! raw >= ln(expm1(-ln(1 - t) / ratio)) - shift
//! ```

use super::coarse::{self, Coarse};
use super::contracted::Inner;
use super::march;
use super::names::NamedValues;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::model::field::{FreeSpace, Lookup};
use crate::model::grid::{Bounds, Nodes};
use crate::options::SourceOptions;
use crate::source::Assumption;
use crate::tensor::Tensor;

/// Default opacity that the coarse model must reach.
const THRESHOLD: f64 = 1e-3;

/// A mask that was found; its values are not yet read.
pub(super) struct Mask<'a> {
    /// Its values.
    pub(super) tensor: &'a Tensor,
    /// Nodes of the mask.
    pub(super) nodes: Nodes,
    scale: [f64; 3],
    shift: [f64; 3],
    /// Raw density to reach; none for boolean values.
    pub(super) threshold: Option<f32>,
    /// The coarse checkpoint with the threshold.
    pub(super) coarse: Option<Coarse>,
    /// The inner box of a contracted scene; the mask is stored in its half sizes.
    pub(super) inner: Option<Inner>,
}

impl<'a> Mask<'a> {
    /// The mask of a checkpoint, if it has one.
    pub(super) fn find(
        names: &NamedValues<'a>,
        bounds: &Bounds,
        nodes: Nodes,
        checkpoint: &std::path::Path,
        options: &SourceOptions,
        limits: &Limits,
        assumptions: &mut Vec<Assumption>,
    ) -> Result<Option<Self>> {
        if let Some(tensor) = names.tensor("mask_cache.mask") {
            let nodes = sizes(tensor, limits)?;
            let scale = names.vector3("mask_cache.xyz2ijk_scale")?;
            let shift = names.vector3("mask_cache.xyz2ijk_shift")?;
            let (scale, shift) = match (scale, shift) {
                (Some(scale), Some(shift)) => (scale, shift),
                _ => index_map(&own_box(names, bounds)?, nodes),
            };
            let finite = scale.iter().chain(&shift).all(|value| value.is_finite());
            if !finite {
                let found = format!("scale {scale:?} and shift {shift:?}");
                let place = Place::Key("mask_cache.xyz2ijk_scale".into());
                return Err(Error::malformed(place, found, "finite numbers"));
            }
            return Ok(Some(Self {
                tensor,
                nodes,
                scale,
                shift,
                threshold: None,
                coarse: None,
                inner: None,
            }));
        }
        if let Some(tensor) = names.tensor("mask_cache.density") {
            let nodes = sizes(tensor, limits)?;
            let (scale, shift) = index_map(&own_box(names, bounds)?, nodes);
            let coarse = coarse::find(names, checkpoint, options, limits, assumptions)?;
            let opacity = names.number("mask_cache_thres")?.unwrap_or_else(|| {
                assumptions.push(Assumption {
                    key: "mask_cache_thres",
                    value: THRESHOLD.to_string(),
                    message: format!(
                        "mask_cache_thres is not stored: assuming that the free-space mask ends \
                         at an opacity of {THRESHOLD}; add it to the file to set it"
                    ),
                });
                THRESHOLD
            });
            let threshold = raw_threshold(opacity, coarse.shift, coarse.ratio)?;
            let (threshold, coarse) = (Some(threshold), Some(coarse));
            return Ok(Some(Self { tensor, nodes, scale, shift, threshold, coarse, inner: None }));
        }
        let Some(tensor) = names.tensor("nonempty_mask") else { return Ok(None) };
        let found = sizes(tensor, limits)?;
        if found != nodes {
            let expected = format!("{:?}, as density has", nodes.0);
            return Err(Error::malformed(tensor.place(), format!("{:?} nodes", found.0), expected));
        }
        let (scale, shift) = index_map(bounds, nodes);
        Ok(Some(Self { tensor, nodes, scale, shift, threshold: None, coarse: None, inner: None }))
    }

    /// Reads its values.
    pub(super) fn load(&self, limits: &Limits) -> Result<FreeSpace> {
        let mut budget = Budget::new(limits);
        let lookup = match self.threshold {
            None => Lookup::Nearest(self.tensor.read_bool(&mut budget)?),
            Some(threshold) => {
                let values = self.tensor.read_f32(&mut budget)?;
                if let Some(value) = values.iter().find(|value| !value.is_finite()) {
                    let found = format!("the value {value}");
                    return Err(Error::malformed(self.tensor.place(), found, "finite numbers"));
                }
                Lookup::Trilinear { values, threshold }
            }
        };
        let (nodes, scale, shift) = (self.nodes, self.scale, self.shift);
        let mask = FreeSpace { nodes, scale, shift, lookup };
        Ok(match &self.inner {
            Some(inner) => inner.crop(mask),
            None => mask,
        })
    }
}

/// The raw density at which opacity over one voxel reaches `opacity`.
fn raw_threshold(opacity: f64, shift: f64, ratio: f64) -> Result<f32> {
    if !(0.0..1.0).contains(&opacity) {
        let place = Place::Key("model_kwargs.mask_cache_thres".into());
        return Err(Error::malformed(place, opacity.to_string(), "an opacity from 0 to 1"));
    }
    if opacity == 0.0 {
        // Every finite density reaches it, and a container can hold it.
        return Ok(f32::MIN);
    }
    let depth = -libm::log1p(-opacity) / ratio;
    // If expm1 would overflow, its logarithm is its argument.
    let raw = if depth > 700.0 { depth } else { libm::log(libm::expm1(depth)) };
    march::narrow("mask_cache_thres", raw - shift)
}

/// The box of the mask: its own, or else the scene's.
fn own_box(names: &NamedValues<'_>, bounds: &Bounds) -> Result<Bounds> {
    let (min, max) = (names.vector3("mask_cache.xyz_min")?, names.vector3("mask_cache.xyz_max")?);
    let (Some(min), Some(max)) = (min, max) else { return Ok(*bounds) };
    #[expect(clippy::cast_possible_truncation, reason = "stored as float32")]
    let own = Bounds { min: min.map(|v| v as f32), max: max.map(|v| v as f32) };
    own.check(&Place::Key("mask_cache.xyz_min".into()))?;
    Ok(own)
}

/// World position to index space, for nodes that span a box.
fn index_map(bounds: &Bounds, nodes: Nodes) -> ([f64; 3], [f64; 3]) {
    let scale = nodes.spacing(bounds).map(f64::recip);
    let shift = std::array::from_fn(|axis| -f64::from(bounds.min[axis]) * scale[axis]);
    (scale, shift)
}

/// Sizes of a mask `[x, y, z]` or `[1, 1, x, y, z]`.
fn sizes(tensor: &Tensor, limits: &Limits) -> Result<Nodes> {
    match *tensor.shape() {
        [x, y, z] | [1, x, y, z] | [1, 1, x, y, z] => {
            Nodes::checked([x, y, z], limits, &tensor.place())
        }
        _ => Err(Error::malformed(
            tensor.place(),
            format!("shape {:?}", tensor.shape()),
            "a mask [x, y, z] or [1, 1, x, y, z]",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_invert_opacity() {
        for (opacity, shift, ratio) in [(1e-3, -13.8155, 1.0), (0.5, -4.595, 2.0), (1e-9, 0.0, 0.1)]
        {
            let raw = f64::from(raw_threshold(opacity, shift, ratio).expect("in range"));
            let x: f64 = raw + shift;
            let sigma = x.max(0.0) + (-x.abs()).exp().ln_1p();
            let found = -(-sigma * ratio).exp_m1();
            assert!((found / opacity - 1.0).abs() < 1e-5, "{found} for {opacity}");
        }
        assert_eq!(raw_threshold(0.0, 0.0, 1.0).expect("everything"), f32::MIN);
        assert!(raw_threshold(1.0, 0.0, 1.0).is_err());
        assert!(raw_threshold(f64::NAN, 0.0, 1.0).is_err());
    }
}
