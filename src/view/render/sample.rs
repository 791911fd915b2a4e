//! A field's values at points of the world.

use super::packet::optical_depth;
use super::renderer::{Content, Renderer, with_values};
use super::view::View;
use crate::base::error::{Error, Result};
use crate::model::activate::lanes;
use crate::model::field::ColorDomain;
use crate::model::harmonics::{BAND_0, FUNCTIONS, Harmonics};
use crate::model::trained_model::TrainedModel;
use crate::model::view_dependence::ViewDependence;
use crate::view::sample::Sample as Values;

/// A field's activated values at a point of one level.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Sample {
    /// Opacity over one interval, 0 to 1.
    pub opacity: f32,
    /// Optical depth per world unit, from 0.
    pub density: f32,
    /// Diffuse colour in the colour space of training: 0 to 1 for logits. Of harmonics, that of
    /// band 0 alone; of a model with rules of its own, that seen from above, along -z.
    pub color: [f32; 3],
    /// Specular features, 0 to 1, as the view network takes them; empty without one.
    pub features: Vec<f32>,
    /// All coefficients of harmonics, function by function, each red, green and blue; empty without
    /// them.
    pub coefficients: Vec<f32>,
}

impl Renderer {
    /// Levels of the field; 0 is the finest.
    pub fn levels(&self) -> usize {
        self.level_count()
    }

    /// Refuses a level that the field does not have.
    pub(super) fn check_level(&self, level: usize) -> Result<()> {
        let levels = self.levels();
        let expected = format!("a level below {levels}");
        Error::require_option(level < levels, "level", level, &expected)
    }

    /// The field's values at a `position` in world units, interpolated in one level. Outside the
    /// box, outside the free-space mask and where nothing is stored, opacity is 0.
    ///
    /// ```
    /// use mipvog_bake::{RadianceField, Renderer};
    ///
    /// let field = RadianceField::builder([4; 3], vec![9.0; 64], vec![0.0; 192]).build()?;
    /// let renderer = Renderer::of_field(&field)?;
    /// let inside = renderer.sample([0.2, 0.0, -0.4], 0)?;
    /// assert_eq!(inside.color, [0.5; 3]);
    /// assert_eq!(renderer.sample([5.0; 3], 0)?.opacity, 0.0, "outside the box");
    /// assert!(renderer.sample([0.0; 3], 1).is_err(), "there is one level");
    /// # Ok::<(), mipvog_bake::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// A level that the field does not have, or a position that is not finite.
    pub fn sample(&self, position: [f64; 3], level: usize) -> Result<Sample> {
        self.check_level(level)?;
        if position.iter().any(|value| !value.is_finite()) {
            let found = format!("{position:?}");
            return Err(Error::invalid_option("position", found, "finite numbers"));
        }
        let lanes = match self.content() {
            Content::Values(lanes) => lanes,
            Content::Model(model) => return Ok(of_model(&**model, self.view(), position)),
        };
        Ok(with_values!(lanes, values => sample(self.view(), values, position, level)))
    }
}

/// Of a model that is evaluated by its own rules.
fn of_model(model: &dyn TrainedModel, view: &View, position: [f64; 3]) -> Sample {
    let density = model.density(position);
    let seen = model.colors(position, &[[0.0, 0.0, -1.0]]);
    Sample {
        opacity: lanes::opacity(density * view.march.stepsize * view.march.voxel_size),
        density,
        color: seen.first().copied().unwrap_or_default(),
        features: Vec::new(),
        coefficients: Vec::new(),
    }
}

fn sample<const C: usize>(
    view: &View,
    values: &impl Values<C>,
    world: [f64; 3],
    level: usize,
) -> Sample {
    let share = [0, 1, 2].map(|axis| {
        let [min, max] = [view.bounds.min[axis], view.bounds.max[axis]].map(f64::from);
        (world[axis] - min) / (max - min)
    });
    let is_free = view.free_space.as_ref().is_none_or(|mask| mask.contains(world));
    let sampled = share.iter().zip(view.march.sampled_shares(&view.bounds));
    let inside = is_free && sampled.into_iter().all(|(at, [low, high])| (low..=high).contains(at));
    let cell = |level| if inside { values.locate(level, share) } else { None };
    // A level without density has level 0's.
    let owner = if values.density_level(level) { level } else { 0 };
    let depth = cell(owner).map_or(0.0, |cell| {
        let density = values.density(owner, &cell);
        optical_depth(density, values.density_domain(owner), view)
    });
    let mut values =
        cell(level).map_or_else(|| values.empty_color(level), |cell| values.color(level, &cell));
    let channels = 3 + view.features;
    let harmonics = view.view_dependence.as_ref().and_then(ViewDependence::harmonics);
    let coefficients = harmonics.map_or_else(Vec::new, |_| values[..channels].to_vec());
    match (harmonics, view.color_domain) {
        (Some(rules), _) => {
            let band_0 = Harmonics { degree: 0, ..*rules };
            let color = band_0.color(&[BAND_0; FUNCTIONS], &values[..3]);
            values[..3].copy_from_slice(&color);
        }
        (None, ColorDomain::Linear) => {}
        (None, ColorDomain::Logit) => values = values.map(lanes::sigmoid),
    }
    let features = if harmonics.is_some() { &[] } else { &values[3..channels] };
    let interval_world = view.march.stepsize * view.march.voxel_size;
    Sample {
        opacity: lanes::opacity(depth),
        density: depth / interval_world,
        color: [values[0], values[1], values[2]],
        features: features.to_vec(),
        coefficients,
    }
}
