//! The settings and arrays of a file.

use super::mask::MaskFile;
use super::read::{corners, key, malformed, tensor};
use super::shading::ShadingFile;
use std::ops::Range;

use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::factors::{FactorArrays, Mix, Part, Terms};
use crate::model::grid::{Bounds, Nodes};
use crate::tensor::{Tensor, TensorFile, Value};

/// The axes of the columns and rows of a plane, and the axis of its line.
const AXES: [([usize; 2], usize); 3] = [([0, 1], 2), ([0, 2], 1), ([1, 2], 0)];

/// Settings of the renderer.
#[derive(Debug, Clone)]
pub(super) struct Settings {
    pub(super) bounds: Bounds,
    pub(super) nodes: Nodes,
    /// Added to density before softplus; none for relu.
    pub(super) shift: Option<f64>,
    /// Optical depth of a world unit of density 1.
    pub(super) distance_scale: f64,
    /// Samples of at most this weight have no colour.
    pub(super) threshold: f64,
    pub(super) near: f64,
    pub(super) far: Option<f64>,
    /// Step length in voxels.
    pub(super) step_ratio: f64,
    /// For nerfstudio's rays instead of TensoRF's: the intervals of the first and second pass.
    pub(super) two_passes: Option<[usize; 2]>,
}

/// The unread arrays of a model.
#[derive(Debug, Clone)]
pub(super) struct Arrays {
    pub(super) settings: Settings,
    pub(super) density: FactorArrays,
    /// Number of colour features.
    pub(super) features: FactorArrays,
    pub(super) shading: ShadingFile,
    pub(super) mask: Option<MaskFile>,
}

/// True for a file with the keys of TensoRF.
pub(super) fn knows(file: &TensorFile) -> bool {
    let has = |key: &str| file.root.at(&["state_dict", key]).is_some();
    let old = has("line_coef") && has("plane_coef");
    file.root.at(&["kwargs", "aabb"]).is_some() && (has("density_line.0") || old)
}

impl Settings {
    /// The edge of a voxel, the mean of the three axes.
    pub(super) fn voxel_size(&self) -> f64 {
        self.nodes.spacing(&self.bounds).into_iter().sum::<f64>() / 3.0
    }

    fn find(kwargs: &Value, limits: &Limits) -> Result<Self> {
        let setting = |name: &str| {
            kwargs.get(name).ok_or_else(|| malformed(name, "no such setting", "TensoRF's settings"))
        };
        let number = |name: &str| -> Result<f64> {
            let value = setting(name)?.number(name)?;
            let finite = value.is_finite() && value.abs() < 1e30;
            if finite {
                return Ok(value);
            }
            Err(malformed(name, value.to_string(), "a finite number"))
        };
        let positive = |name: &str| -> Result<f64> {
            let value = number(name)?;
            if value > 0.0 {
                return Ok(value);
            }
            Err(malformed(name, value.to_string(), "a number above 0"))
        };
        let bounds = corners(kwargs.get("aabb"), "kwargs.aabb")?;
        let sizes = setting("gridSize")?.vector3("gridSize")?;
        if !sizes.into_iter().all(|size| (2.0..=1e6).contains(&size) && size.fract() == 0.0) {
            let expected = "three numbers of nodes, at least 2 each";
            return Err(malformed("gridSize", format!("{sizes:?}"), expected));
        }
        #[expect(clippy::cast_possible_truncation, reason = "checked above")]
        let nodes = Nodes::checked(sizes.map(|size| size as u64), limits, &key("gridSize"))?;
        let shift = match setting("fea2denseAct")? {
            Value::Text(name) if name == "softplus" => Some(number("density_shift")?),
            Value::Text(name) if name == "relu" => None,
            other => {
                let place = key("fea2denseAct");
                return Err(Error::unsupported(place, other.describe(), "softplus or relu"));
            }
        };
        let near_far = match setting("near_far")?.numbers("near_far")?.as_slice() {
            &[near, far] if near >= 0.0 && far >= near && far.is_finite() => [near, far],
            other => {
                let expected = "two distances, near and far";
                return Err(malformed("near_far", format!("{other:?}"), expected));
            }
        };
        if near_far == [0.0, 1.0] {
            let found = "near 0 and far 1: a scene in normalised device coordinates, whose rays \
                         are not straight in the world";
            let expected = "a scene in world coordinates";
            return Err(Error::unsupported(key("near_far"), found, expected));
        }
        let threshold = number("rayMarch_weight_thres")?;
        if !(0.0..1.0).contains(&threshold) {
            let found = threshold.to_string();
            return Err(malformed("rayMarch_weight_thres", found, "a weight from 0 to below 1"));
        }
        let (distance_scale, step_ratio) = (positive("distance_scale")?, positive("step_ratio")?);
        let ([near, far], two_passes) = (near_far, None);
        let far = Some(far);
        Ok(Self {
            bounds,
            nodes,
            shift,
            distance_scale,
            threshold,
            near,
            far,
            step_ratio,
            two_passes,
        })
    }
}

impl Arrays {
    /// Finds the arrays and checks their shapes.
    pub(super) fn find(file: &TensorFile, limits: &Limits) -> Result<Self> {
        let none = Value::None;
        let (kwargs, state) = (file.root.get("kwargs"), file.root.get("state_dict"));
        let (kwargs, state) = (kwargs.unwrap_or(&none), state.unwrap_or(&none));
        let settings = Settings::find(kwargs, limits)?;
        let nodes = settings.nodes;
        let (density, color) = match state.get("plane_coef") {
            Some(_) => joint_terms(kwargs, state)?,
            None => (terms(state, "density")?, terms(state, "app")?),
        };
        let density = FactorArrays::new(density, nodes, None)?;
        let basis = tensor(state, "basis_mat.weight")?.clone();
        let basis = Mix { tensor: basis, by_component: false };
        let features = FactorArrays::new(color, nodes, Some(basis))?;
        let shading = ShadingFile::find(kwargs, state, features.channels)?;
        let mask = MaskFile::find(&file.root, limits)?;
        Ok(Self { settings, density, features, shading, mask })
    }
}

/// The factors of density or of colours; a CP model has only lines.
fn terms(state: &Value, of: &str) -> Result<Terms> {
    let line = |number: usize, axis: usize| -> Result<Part> {
        let tensor = tensor(state, &format!("{of}_line.{number}"))?.clone();
        Ok(Part { tensor, axes: (axis, None) })
    };
    let axes = AXES.iter().enumerate();
    if state.get(&format!("{of}_plane.0")).is_none() {
        let lines = axes.map(|(number, (_, axis))| line(number, *axis));
        return Ok(vec![lines.collect::<Result<_>>()?]);
    }
    let terms = axes.map(|(number, ([columns, rows], axis))| {
        let plane = tensor(state, &format!("{of}_plane.{number}"))?.clone();
        let plane = Part { tensor: plane, axes: (*rows, Some(*columns)) };
        Ok(vec![plane, line(number, *axis)?])
    });
    terms.collect()
}

/// The factors of density and of colours of the first TensorVM, whose arrays hold the components of
/// colours before those of density.
fn joint_terms(kwargs: &Value, state: &Value) -> Result<(Terms, Terms)> {
    let count = |name: &str| -> Result<u64> {
        let counts = kwargs.get(name).map(|value| value.numbers(name)).transpose()?;
        match counts.unwrap_or_default().as_slice() {
            #[expect(clippy::cast_possible_truncation, reason = "a whole number up to 4096")]
            &[count, ..] if (1.0..=4096.0).contains(&count) && count.fract() == 0.0 => {
                Ok(count as u64)
            }
            other => Err(malformed(name, format!("{other:?}"), "a number of components")),
        }
    };
    let (planes, lines) = (tensor(state, "plane_coef")?, tensor(state, "line_coef")?);
    let (color, density) = (count("appearance_n_comp")?, count("density_n_comp")?);
    let held = planes.shape().get(1).copied().unwrap_or(0);
    if held != color + density {
        let found = format!("{held} components");
        let expected = format!("{color} of colours and {density} of density");
        return Err(Error::malformed(planes.place(), found, expected));
    }
    let terms = |components| stacked_terms(Some(planes), lines, components);
    Ok((terms(color..held)?, terms(0..color)?))
}

/// Some components of the three planes and three lines, which are one array each; a CP model has
/// only lines.
pub(super) fn stacked_terms(
    planes: Option<&Tensor>,
    lines: &Tensor,
    components: Range<u64>,
) -> Result<Terms> {
    for array in planes.iter().copied().chain([lines]) {
        if array.shape().first() != Some(&3) {
            let found = format!("shape {:?}", array.shape());
            return Err(Error::malformed(array.place(), found, "[3, components, rows, columns]"));
        }
    }
    let line = |number, axis| Part::of(lines, number, components.clone(), (axis, None));
    let axes = (0..).zip(AXES);
    let Some(planes) = planes else {
        return Ok(vec![
            axes.map(|(number, (_, axis))| line(number, axis)).collect::<Result<_>>()?,
        ]);
    };
    let terms = axes.map(|(number, ([columns, rows], axis))| {
        let plane = Part::of(planes, number, components.clone(), (rows, Some(columns)))?;
        Ok(vec![plane, line(number, axis)?])
    });
    terms.collect()
}
