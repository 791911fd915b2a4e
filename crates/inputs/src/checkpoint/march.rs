//! Opacity of raw density and the step of rays, from settings and options.
//!
//! ```text
//! shift      = act_shift as stored, else ln(1 / (1 - alpha_init) - 1)
//! voxel_size = (prod(max - min) / num_voxels)^(1/3)
//! interval   = stepsize * voxel_size / voxel_size_base
//! ```

use super::names::NamedValues;
use crate::base::error::{Error, Place, Result};
use crate::model::field::{Activation, ActivationOrder, DensityFunction, March};
use crate::model::grid::{Bounds, Nodes};
use crate::options::SourceOptions;
use crate::source::{Assumption, Family};
use crate::tensor::Value;

/// Default step length in voxels: DirectVoxGO's.
const STEPSIZE: f32 = 0.5;
/// Initial opacity of training, if the checkpoint does not state it.
const ALPHA_INIT: f64 = 1e-2;
/// Default weight up to which samples add no colour.
const COLOR_THRESHOLD: f32 = 1e-4;

/// The density shift that makes a raw value of 0 an opacity of `alpha_init`.
pub(super) fn shift(alpha_init: f64, place: &Place) -> Result<f64> {
    if alpha_init > 0.0 && alpha_init < 1.0 {
        // ln(1 / (1 - a) - 1) = ln(a / (1 - a)), without the cancellation for small a.
        return Ok(libm::log(alpha_init / (1.0 - alpha_init)));
    }
    let found = format!("alpha_init {alpha_init}");
    Err(Error::malformed(place.clone(), found, "an opacity between 0 and 1"))
}

/// Raw density to opacity, and the steps along a ray.
pub(super) fn find(
    names: &NamedValues<'_>,
    family: Family,
    bounds: &Bounds,
    nodes: Nodes,
    options: &SourceOptions,
    recorded: &Recorded,
    assumptions: &mut Vec<Assumption>,
) -> Result<(Activation, March)> {
    let stepsize = options.stepsize.or(recorded.stepsize).unwrap_or_else(|| {
        assumptions.push(Assumption {
            key: "stepsize",
            value: STEPSIZE.to_string(),
            message: format!(
                "the step length is not stored in checkpoints: assuming {STEPSIZE} voxels, \
                 DirectVoxGO's; option stepsize sets the trained one (0.25 in Mip-VoG's \
                 configurations)"
            ),
        });
        STEPSIZE
    });
    let (voxel_size, ratio) = voxels(names, bounds, nodes, assumptions)?;
    let order = match (names.flag("pre_act_density")?, names.flag("in_act_density")?) {
        (false, false) => ActivationOrder::Raw,
        (true, false) => ActivationOrder::Opacity,
        (false, true) => ActivationOrder::Density,
        (true, true) => {
            return Err(Error::malformed(
                Place::Key("model_kwargs.pre_act_density".into()),
                "both pre_act_density and in_act_density",
                "one order of activation",
            ));
        }
    };
    let stored = recorded.color_threshold;
    let color_threshold = options.color_threshold.or(stored).unwrap_or(COLOR_THRESHOLD);
    let shift = narrow("act_shift", own_shift(names, assumptions)?)?;
    let interval = narrow("interval", f64::from(stepsize) * ratio)?;
    let march = March {
        stepsize,
        voxel_size: narrow("voxel size", voxel_size)?,
        near: options.near.or(recorded.near).unwrap_or(0.0),
        far: options.far.or(recorded.far),
        color_threshold,
        // Mip-VoG keeps faint samples, because their opacity counts.
        alpha_threshold: stored.filter(|_| family == Family::Dvgo).unwrap_or(0.0),
        sampled: None,
        voxel: None,
    };
    march.check(nodes).map_err(|error| match options.stepsize {
        Some(given) if *error.place() == Place::Key("march.stepsize".to_owned()) => {
            let most = March::MAX_SAMPLES;
            let expected = format!("steps such that a ray takes at most {most}");
            Error::invalid_option("stepsize", given.to_string(), expected)
        }
        _ => error,
    })?;
    let function = DensityFunction::Softplus;
    Ok((Activation { shift, interval, order, function }, march))
}

/// Settings of rays that the checkpoint records.
pub(super) struct Recorded {
    stepsize: Option<f32>,
    near: Option<f32>,
    far: Option<f32>,
    /// The colour behind the field.
    pub(super) background: Option<[f32; 3]>,
    color_threshold: Option<f32>,
}

impl Recorded {
    /// Finds them, and refuses impossible values.
    pub(super) fn find(names: &NamedValues<'_>) -> Result<Self> {
        let number = |name: &str| -> Result<Option<f32>> {
            names.recorded(name)?.map(|value| narrow(name, value)).transpose()
        };
        let background = names.recorded_background()?;
        #[expect(clippy::cast_possible_truncation, reason = "the range is checked below")]
        let background = background.map(|color| color.map(|value| value as f32));
        let recorded = SourceOptions {
            stepsize: number("stepsize")?,
            near: number("near")?,
            far: number("far")?,
            background,
            ..SourceOptions::default()
        };
        recorded.check().map_err(|error| {
            let expected = "settings that a scene can have";
            Error::malformed(Place::File, error.kind().to_string(), expected)
        })?;
        let SourceOptions { stepsize, near, far, background, .. } = recorded;
        Ok(Self { stepsize, near, far, background, color_threshold: threshold(names)? })
    }

    /// Names of the settings that are recorded.
    pub(super) fn names(&self) -> Vec<&'static str> {
        let stated = [
            ("stepsize", self.stepsize.is_some()),
            ("near", self.near.is_some()),
            ("far", self.far.is_some()),
            ("background", self.background.is_some()),
            ("color_threshold", self.color_threshold.is_some()),
        ];
        stated.into_iter().filter(|&(_, stated)| stated).map(|(name, _)| name).collect()
    }
}

/// The shift of this checkpoint's own density: as stored, because training may have changed it.
fn own_shift(names: &NamedValues<'_>, assumptions: &mut Vec<Assumption>) -> Result<f64> {
    if let Some(stored) = names.weight("act_shift") {
        return stored.number("act_shift");
    }
    if let Some(alpha_init) = names.number("alpha_init")? {
        return shift(alpha_init, &Place::Key("model_kwargs.alpha_init".into()));
    }
    if let Some(stored) = names.own_mask_number("act_shift")? {
        return Ok(stored);
    }
    assumptions.push(Assumption {
        key: "alpha_init",
        value: ALPHA_INIT.to_string(),
        message: format!(
            "neither act_shift nor alpha_init is stored: assuming alpha_init {ALPHA_INIT}, as in \
             every published configuration of the fine stage; add either to the file to set it"
        ),
    });
    shift(ALPHA_INIT, &Place::File)
}

/// Voxel size in world units, and its ratio to the base voxel size.
fn voxels(
    names: &NamedValues<'_>,
    bounds: &Bounds,
    nodes: Nodes,
    assumptions: &mut Vec<Assumption>,
) -> Result<(f64, f64)> {
    let volume: f64 = bounds.extent().iter().product();
    let edge = |count: f64| libm::cbrt(volume / count);
    let count = match names.number("num_voxels")? {
        Some(count) => positive("num_voxels", count)?,
        None => {
            let count = nodes.count();
            assumptions.push(Assumption {
                key: "num_voxels",
                value: count.to_string(),
                message: format!(
                    "num_voxels is not stored: assuming {count}, the number of nodes; it sets the \
                     voxel size that option stepsize counts in"
                ),
            });
            count as f64
        }
    };
    let voxel_size = edge(count);
    let stored = |name: &'static str| {
        let value = match names.weight(name) {
            Some(value) => Some(value.number(name)?),
            None => names.number(name)?,
        };
        value.map(|value| positive(name, value)).transpose()
    };
    let ratio = if let Some(base) = stored("num_voxels_base")? {
        voxel_size / edge(base)
    } else if let Some(base) = stored("voxel_size_base")? {
        voxel_size / base
    } else if let Some(ratio) = stored("voxel_size_ratio")? {
        ratio
    } else if let Some(ratio) = names.own_mask_number("voxel_size_ratio")? {
        positive("voxel_size_ratio", ratio)?
    } else {
        assumptions.push(Assumption {
            key: "voxel_size_ratio",
            value: "1".into(),
            message: "num_voxels_base is not stored: assuming that it equals num_voxels, so that \
                      an interval is the step length in voxels"
                .into(),
        });
        1.0
    };
    Ok((voxel_size, ratio))
}

/// The threshold that DirectVoxGO stores: it drops samples of at most this opacity, and those of
/// at most this weight.
fn threshold(names: &NamedValues<'_>) -> Result<Option<f32>> {
    let value = match names.setting("fast_color_thres") {
        // Forks change it during training: thresholds by starting step.
        Some(schedule @ Value::Dict(_)) => last_of_schedule(schedule)?,
        _ => names.number("fast_color_thres")?,
    };
    let Some(value) = value else { return Ok(None) };
    if (0.0..1.0).contains(&value) {
        return narrow("fast_color_thres", value).map(Some);
    }
    let place = Place::Key("model_kwargs.fast_color_thres".into());
    Err(Error::malformed(place, value.to_string(), "an opacity from 0 to 1"))
}

/// The final value of a schedule by steps.
fn last_of_schedule(schedule: &Value) -> Result<Option<f64>> {
    let steps = schedule.entries().iter().filter_map(|(step, value)| {
        Some((step.parse::<f64>().ok().filter(|step| step.is_finite())?, value))
    });
    let last = steps.max_by(|(one, _), (other, _)| one.total_cmp(other));
    last.map(|(_, value)| value.number("fast_color_thres")).transpose()
}

/// A setting that must be above 0.
pub(super) fn positive(name: &str, value: f64) -> Result<f64> {
    if value > 0.0 && value.is_finite() {
        return Ok(value);
    }
    Err(Error::malformed(Place::Key(name.into()), value.to_string(), "a number above 0"))
}

/// A number as float32, still finite.
pub(super) fn narrow(name: &str, value: f64) -> Result<f32> {
    #[expect(clippy::cast_possible_truncation, reason = "checked on the next line")]
    let narrow = value as f32;
    if narrow.is_finite() {
        return Ok(narrow);
    }
    Err(Error::malformed(Place::Key(name.into()), value.to_string(), "a finite number"))
}
