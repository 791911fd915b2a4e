//! Values of a container's levels at points of the world.

use std::fmt::Debug;

use super::point::{Sample, on_faces, sample_at};
use super::sparse::Sparse;
use super::view::View;
use crate::base::error::{Error, Place, Result};
use crate::container::{Container, check_metadata};

/// Reads a container's levels at points of the world.
///
/// ```no_run
/// use mipvog_format::{Container, Limits, Sampler};
///
/// let container = Container::from_bytes(std::fs::read("scene.mipvog")?, &Limits::default())?;
/// let sampler = Sampler::of_container(&container)?;
/// let sample = sampler.sample([0.0, 0.0, 0.5], 0)?;
/// println!("opacity {}, colour {:?}", sample.opacity, sample.color);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Sampler {
    view: View,
    values: Box<dyn Values>,
    levels: usize,
}

/// Levels with any number of colour lanes.
trait Values: Debug + Send + Sync {
    fn sample(&self, view: &View, places: ([f64; 3], [f64; 3]), level: usize) -> Sample;
}

impl<const C: usize> Values for Sparse<C> {
    fn sample(&self, view: &View, places: ([f64; 3], [f64; 3]), level: usize) -> Sample {
        sample_at(view, self, places, level)
    }
}

impl Sampler {
    /// Decodes all levels of a container, within the limits that it was opened with.
    ///
    /// # Errors
    ///
    /// `Malformed` if its levels are damaged, `Unsupported` beyond 64 channels of colour and
    /// features, and `OverLimit` for more memory than the limits allow.
    pub fn of_container(container: &Container) -> Result<Self> {
        let limits = container.limits();
        let field = container.read()?;
        check_metadata(&field.metadata, limits, &Place::File)?;
        field.check()?;
        let values: Box<dyn Values> = match field.metadata.layout().color_channels() {
            0..=4 => Box::new(Sparse::<4>::new(&field, limits)?),
            5..=16 => Box::new(Sparse::<16>::new(&field, limits)?),
            _ => Box::new(Sparse::<64>::new(&field, limits)?),
        };
        Ok(Self { view: View::of_baked(&field), values, levels: field.levels.len() })
    }

    /// The container's rendering rules.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// Number of levels of the container; level 0 is the finest.
    pub fn levels(&self) -> usize {
        self.levels
    }

    /// The values at a `position` in world units, interpolated in one level. Opacity is 0 outside
    /// the box, outside the free-space mask and in blocks that are not stored.
    ///
    /// # Errors
    ///
    /// `InvalidOption` for a level that the container does not have, or a position that is not
    /// finite.
    pub fn sample(&self, position: [f64; 3], level: usize) -> Result<Sample> {
        check_level(level, self.levels)?;
        let places = self.view.places(position)?;
        Ok(self.values.sample(&self.view, places, level))
    }
}

/// Refuses a level that a field does not have.
pub fn check_level(level: usize, levels: usize) -> Result<()> {
    Error::require_option(level < levels, "level", level, &format!("a level below {levels}"))
}

impl View {
    /// A position, snapped to faces of the box that it lies on except for rounding, and its place
    /// as fractions of the box.
    ///
    /// # Errors
    ///
    /// `InvalidOption` for a position that is not finite.
    pub fn places(&self, position: [f64; 3]) -> Result<([f64; 3], [f64; 3])> {
        if position.iter().any(|value| !value.is_finite()) {
            let found = format!("{position:?}");
            return Err(Error::invalid_option("position", found, "finite numbers"));
        }
        let extent = self.bounds.extent();
        let world = on_faces(position, &self.bounds);
        let share = |axis: usize| (world[axis] - f64::from(self.bounds.min[axis])) / extent[axis];
        Ok((world, [0, 1, 2].map(share)))
    }
}
