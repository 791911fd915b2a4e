//! Unbounded scenes of DirectVoxGO, whose space is contracted beyond an inner box.
//!
//! The grid spans `-1 - bg_len` to `1 + bg_len` along each axis, in half sizes of the inner box
//! about its centre. Positions with a norm of at most 1 are not contracted: there the grid is a
//! plain one. The rest holds all of the outer space, which is either sampled at the nodes of more
//! boxes or dropped on request.

use super::names::NamedValues;
use crate::base::error::{Error, Place, Result};
use crate::model::field::{FreeSpace, Lookup};
use crate::model::grid::Bounds;
use crate::options::SourceOptions;
use crate::source::Assumption;
use crate::tensor::Value;

/// Edges of the inner box that differ by up to this share are those of a rounded cube.
const ROUNDED: f64 = 1e-4;

/// The inner box of a contracted scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Inner {
    /// Its centre in the world.
    pub center: [f64; 3],
    /// Half its edge.
    pub radius: f64,
    /// True for the Euclidean norm, with a ball as the inner space; false for the maximum norm,
    /// with the whole box.
    pub ball: bool,
}

impl Inner {
    /// The inner box of a contracted scene; none for other scenes.
    ///
    /// # Errors
    /// `Unsupported` unless the surroundings are dropped, `Malformed` for a box that is not a cube.
    pub fn find(names: &NamedValues<'_>, options: &SourceOptions) -> Result<Option<Self>> {
        let settings = ["bg_len", "contracted_norm"];
        let stated = settings.iter().find(|name| names.setting(name).is_some());
        let weights = ["scene_center", "scene_radius"];
        let weight = weights.iter().find(|name| names.weight(name).is_some());
        let Some(name) = weight.or(stated) else { return Ok(None) };
        if !options.drop_background {
            let found = "an unbounded scene in contracted space, whose rays are not straight in \
                         the grid beyond its inner box";
            let expected = "a dense grid in a box, or option --drop-background, which keeps only \
                            the inner box";
            return Err(Error::unsupported(Place::Key((*name).to_owned()), found, expected));
        }
        let vector = |name: &str| {
            let found = names.vector3(name)?;
            found.filter(|at| at.iter().all(|value| value.is_finite())).ok_or_else(|| {
                let expected = "the inner box of a contracted scene";
                Error::malformed(Place::Key(name.to_owned()), "no three numbers", expected)
            })
        };
        let (center, radii) = (vector("scene_center")?, vector("scene_radius")?);
        let [radius, others @ ..] = radii;
        let cube = others.into_iter().all(|other| (other - radius).abs() <= ROUNDED * radius);
        if !(radius > 0.0 && cube) {
            let place = Place::Key("scene_radius".to_owned());
            return Err(Error::malformed(place, format!("{radii:?}"), "half the edge of a cube"));
        }
        let ball = match names.setting("contracted_norm") {
            // The first version had only the Euclidean norm.
            None => true,
            Some(Value::Text(norm)) if norm == "l2" => true,
            Some(Value::Text(norm)) if norm == "inf" => false,
            Some(other) => {
                let place = Place::Key("contracted_norm".to_owned());
                return Err(Error::unsupported(place, other.describe(), "inf or l2"));
            }
        };
        if ball && names.tensor("mask_cache.mask").is_none() {
            let place = Place::Tensor("mask_cache.mask".to_owned());
            let expected = "the mask that all contracted scenes have";
            return Err(Error::malformed(place, "no such tensor", expected));
        }
        Ok(Some(Self { center, radius, ball }))
    }

    /// The world's box of one that is stated in half sizes of the inner box.
    ///
    /// # Errors
    /// `Malformed` if it does not contain the inner box.
    pub fn to_world(&self, stored: Bounds) -> Result<Bounds> {
        let corners = stored.min.into_iter().zip(stored.max);
        if !corners.clone().all(|(low, high)| low <= -1.0 && high >= 1.0) {
            let place = Place::Key("xyz_min".to_owned());
            let found = format!("{:?} to {:?}", stored.min, stored.max);
            return Err(Error::malformed(place, found, "a box around -1 to 1"));
        }
        let bounds = Bounds { min: self.world(stored.min), max: self.world(stored.max) };
        bounds.check_model(&Place::Key("scene_radius".to_owned()))?;
        Ok(bounds)
    }

    /// The inner box in the world.
    pub fn bounds(&self) -> Bounds {
        Bounds { min: self.world([-1.0; 3]), max: self.world([1.0; 3]) }
    }

    #[expect(clippy::cast_possible_truncation, reason = "a field's box is float32")]
    fn world(&self, stored: [f32; 3]) -> [f32; 3] {
        let mut world = stored;
        let axes = world.iter_mut().zip(self.center);
        axes.for_each(|(at, center)| *at = (center + self.radius * f64::from(*at)) as f32);
        world
    }

    /// The mask in the world, without nodes with contracted neighbourhoods.
    pub fn crop(&self, mut mask: FreeSpace) -> FreeSpace {
        let ([_, ny, nz], scale, shift) = (mask.nodes.0, mask.scale, mask.shift);
        if let (Lookup::Nearest(inside), true) = (&mut mask.lookup, self.ball) {
            for (number, inside) in inside.iter_mut().enumerate() {
                let node = [number / (ny * nz), number / nz % ny, number % nz];
                let axes = node.into_iter().zip(scale).zip(shift);
                // The corner of the node's surroundings that is farthest out.
                let squares = axes.map(|((node, scale), shift)| {
                    (((node as f64 - shift) / scale).abs() + 0.5 / scale).powi(2)
                });
                *inside &= squares.sum::<f64>() <= 1.0;
            }
        }
        mask.scale = scale.map(|per_unit| per_unit / self.radius);
        let axes = mask.shift.iter_mut().zip(self.center).zip(mask.scale);
        axes.for_each(|((shift, center), scale)| *shift -= center * scale);
        mask
    }

    /// The warning about what is lost.
    pub fn assumption(&self) -> Assumption {
        let [x, y, z] = self.center;
        let part = if self.ball { "ball" } else { "box" };
        Assumption {
            key: "scene_radius",
            value: format!("{}", self.radius),
            message: format!(
                "option drop-background: the scene is contracted outside the {part} of radius {} \
                 around ({x}, {y}, {z}); everything outside it is left out",
                self.radius
            ),
        }
    }
}
