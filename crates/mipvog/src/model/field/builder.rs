//! Trained fields from arrays.

use std::sync::Arc;

use super::{
    Activation, ActivationOrder, ColorDomain, DensityFunction, FreeSpace, Grid, March,
    RadianceField, Scene, Volume,
};
use crate::base::bytes::Storage;
use crate::base::error::{Error, Place, Result};
use crate::model::grid::{Bounds, Element, Nodes};
use crate::model::harmonics::Harmonics;
use crate::model::view_dependence::ViewDependence;
use crate::model::view_mlp::ViewMlp;

/// Makes a [`RadianceField`] from arrays in memory.
///
/// Arrays are node-centred and in C order: channel slowest, then x, y, and z fastest. Nodes 0 and
/// `N - 1` lie on the faces of the box.
///
/// ```
/// use mipvog::RadianceField;
///
/// let nodes = [4, 5, 6];
/// let density = vec![2.0; 120];
/// let diffuse = vec![0.0; 3 * 120];
/// let field = RadianceField::builder(nodes, density, diffuse)
///     .bounds([-1.0; 3], [1.0; 3])
///     .stepsize(0.5)
///     .background([0.0; 3])
///     .build()?;
/// assert_eq!(field.color_channels(), 3);
/// # Ok::<(), mipvog::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct FieldBuilder {
    nodes: [usize; 3],
    density: Vec<f32>,
    diffuse: Vec<f32>,
    features: Vec<f32>,
    bounds: Bounds,
    shift: f32,
    stepsize: f32,
    near: f32,
    far: Option<f32>,
    background: [f32; 3],
    function: DensityFunction,
    color_domain: ColorDomain,
    view: Option<ViewDependence>,
    free_space: Option<FreeSpace>,
}

impl RadianceField {
    /// Starts a field with `nodes` along x, y and z, at least 2 each. `density` has one raw value
    /// per node, `diffuse` three colour logits.
    pub fn builder(nodes: [usize; 3], density: Vec<f32>, diffuse: Vec<f32>) -> FieldBuilder {
        FieldBuilder {
            nodes,
            density,
            diffuse,
            features: Vec::new(),
            bounds: Bounds { min: [-1.0; 3], max: [1.0; 3] },
            shift: 0.0,
            stepsize: 0.5,
            near: 0.0,
            far: None,
            background: [1.0; 3],
            function: DensityFunction::Softplus,
            color_domain: ColorDomain::Logit,
            view: None,
            free_space: None,
        }
    }
}

impl FieldBuilder {
    /// The corners of the box in world units. Default: -1 and 1 along each axis.
    #[must_use]
    pub fn bounds(mut self, min: [f32; 3], max: [f32; 3]) -> Self {
        self.bounds = Bounds { min, max };
        self
    }

    /// The number that is added to raw density before softplus. Default: 0.
    #[must_use]
    pub fn shift(mut self, shift: f32) -> Self {
        self.shift = shift;
        self
    }

    /// The step length along rays in voxels, above 0. Density is optical depth per voxel length.
    /// Default: 0.5.
    #[must_use]
    pub fn stepsize(mut self, stepsize: f32) -> Self {
        self.stepsize = stepsize;
        self
    }

    /// The distance at which rays start, and the farthest distance at which sampling may start,
    /// along the optical axis in world units. Default: 0 and unlimited.
    #[must_use]
    pub fn near_far(mut self, near: f32, far: Option<f32>) -> Self {
        (self.near, self.far) = (near, far);
        self
    }

    /// The colour behind the field, 0 to 1. Default: white.
    #[must_use]
    pub fn background(mut self, background: [f32; 3]) -> Self {
        self.background = background;
        self
    }

    /// Specular features, any number of channels of logits per node, and the network that turns
    /// them into view-dependent colour.
    #[must_use]
    pub fn view_dependence(mut self, features: Vec<f32>, network: ViewMlp) -> Self {
        (self.features, self.view) = (features, Some(ViewDependence::Network(network)));
        self
    }

    /// The function from raw density to density. Default: softplus. The shift is not used with
    /// relu.
    #[must_use]
    pub fn density_function(mut self, function: DensityFunction) -> Self {
        self.function = function;
        self
    }

    /// Colours are not logits, but linear values: 0 to 1, and beyond.
    #[must_use]
    pub fn linear_colors(mut self) -> Self {
        self.color_domain = ColorDomain::Linear;
        self
    }

    /// Colours are harmonics: the diffuse array holds the coefficients of band 0, `higher` those of
    /// the other functions in order, three channels each.
    #[must_use]
    pub fn harmonics(mut self, higher: Vec<f32>, harmonics: Harmonics) -> Self {
        (self.features, self.view) = (higher, Some(ViewDependence::Harmonics(harmonics)));
        self.linear_colors()
    }

    /// The free-space mask of the training. Default: none.
    #[must_use]
    pub fn free_space(mut self, mask: FreeSpace) -> Self {
        self.free_space = Some(mask);
        self
    }

    /// The field.
    ///
    /// # Errors
    ///
    /// An array whose length does not match the nodes, or a setting out of range. The place names
    /// it.
    pub fn build(self) -> Result<RadianceField> {
        let sizes = self.nodes;
        let count = sizes.iter().try_fold(1usize, |count, &size| count.checked_mul(size));
        let volume = |name: &str, values: Vec<f32>| {
            let channels = count.and_then(|count| values.len().checked_div(count)).unwrap_or(0);
            if Some(values.len()) != count.and_then(|count| count.checked_mul(channels)) {
                let found = format!("{} values", values.len());
                let expected = format!("a multiple of {sizes:?} nodes");
                return Err(Error::malformed(Place::Tensor(name.to_owned()), found, expected));
            }
            let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
            let [_, ny, nz] = sizes.map(|size| size as u64);
            Ok(Volume {
                nodes: Nodes(sizes),
                channels,
                element: Element::F32,
                storage: Storage::Memory(Arc::from(bytes)),
                first: 0,
                strides: [sizes[0] as u64 * ny * nz, ny * nz, nz],
            })
        };
        let diffuse = volume("diffuse", self.diffuse)?;
        if diffuse.channels != 3 {
            let found = format!("{} channels", diffuse.channels);
            return Err(Error::malformed(Place::Tensor("diffuse".to_owned()), found, "3 channels"));
        }
        let mut color = vec![diffuse];
        if !self.features.is_empty() {
            color.push(volume("features", self.features)?);
        }
        let edges = [0, 1, 2].map(|axis| f64::from(self.bounds.max[axis] - self.bounds.min[axis]));
        let volume_of_voxel = edges.iter().product::<f64>() / count.unwrap_or(1).max(1) as f64;
        let scene = Scene {
            bounds: self.bounds,
            nodes: Nodes(sizes),
            activation: Activation {
                shift: self.shift,
                interval: self.stepsize,
                order: ActivationOrder::Raw,
                function: self.function,
            },
            march: March {
                near: self.near,
                far: self.far,
                color_threshold: 1e-4,
                ..March::new(self.stepsize, libm::cbrt(volume_of_voxel) as f32)
            },
            background: self.background,
        };
        let field = RadianceField {
            scene,
            density: volume("density", self.density)?.into(),
            color: color.into_iter().map(Grid::from).collect(),
            color_domain: self.color_domain,
            view: self.view,
            free_space: self.free_space,
            shells: Vec::new(),
        };
        field.check()?;
        Ok(field)
    }
}
