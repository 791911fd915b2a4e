//! Colours along given rays, and colours of points along given directions.

use super::march::march;
use super::renderer::{Content, Renderer, with_values};
use super::shade::view_colors;
use super::trained::ray_rules;
use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::model::camera::Ray;
use crate::model::harmonics::basis;
use crate::model::trained_model::{RayColor, TrainedModel};
use crate::model::view_dependence::ViewDependence;
use crate::model::view_mlp::RAYS;
use crate::view::sample::SampleLevels;
use crate::view::sample::View;

/// Number of rays per task of a thread.
const CHUNK: usize = 256;

impl Renderer {
    /// The light along rays, with all samples from one `level`. [`Step::Render`] advances by rays.
    ///
    /// # Errors
    ///
    /// A missing level, rules out of range, and `Cancelled`.
    pub fn ray_colors(
        &self,
        rays: &[Ray],
        level: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<RayColor>> {
        self.check_level(level)?;
        self.view().check()?;
        match self.content() {
            Content::Values(lanes) => {
                with_values!(lanes, values => follow(self.view(), values, rays, level, progress))
            }
            Content::Model(model) => of_model(&**model, self.view(), rays, progress),
        }
    }

    /// The colours at a `position` seen along unit `directions`: 0 to 1, or more if the view
    /// network adds light.
    ///
    /// # Errors
    ///
    /// As [`Self::sample`].
    pub fn point_colors(
        &self,
        position: [f64; 3],
        directions: &[[f64; 3]],
        level: usize,
    ) -> Result<Vec<[f32; 3]>> {
        if let Content::Model(model) = self.content() {
            return Ok(model.colors(position, directions));
        }
        let sample = self.sample(position, level)?;
        let network = match &self.view().view_dependence {
            Some(ViewDependence::Network(network)) => network,
            Some(ViewDependence::Harmonics(rules)) => {
                let color = |&direction| rules.color(&basis(direction), &sample.coefficients);
                return Ok(directions.iter().map(color).collect());
            }
            None => {
                let color = |&direction| sample.diffuse_from(direction);
                return Ok(directions.iter().map(color).collect());
            }
        };
        let mut colors = Vec::with_capacity(directions.len());
        for directions in directions.chunks(RAYS) {
            let values: Vec<Vec<f32>> =
                directions.iter().map(|&direction| sample.values_from(direction)).collect();
            let values: Vec<&[f32]> = values.iter().map(Vec::as_slice).collect();
            let added = network.colors(directions, &values);
            let color = |(own, added): (&&[f32], [f32; 3])| {
                [0, 1, 2].map(|channel| own[channel] + added[channel])
            };
            colors.extend(values.iter().zip(added).map(color));
        }
        Ok(colors)
    }
}

/// The light along rays, by a model's own rules.
fn of_model(
    model: &dyn TrainedModel,
    view: &View,
    rays: &[Ray],
    progress: &dyn Progress,
) -> Result<Vec<RayColor>> {
    let (rules, chunks) = (ray_rules(view), rays.chunks(CHUNK).collect::<Vec<_>>());
    let colors = parallel::map(chunks.len(), |number| {
        let follow = |ray| model.follow(ray, &rules, progress);
        let colors: Result<Vec<RayColor>> = chunks[number].iter().map(follow).collect();
        progress.advance(Step::Render, chunks[number].len() as u64);
        colors
    })?;
    Ok(colors.concat())
}

fn follow<const C: usize>(
    view: &View,
    values: &impl SampleLevels<C>,
    rays: &[Ray],
    level: usize,
    progress: &dyn Progress,
) -> Result<Vec<RayColor>> {
    let chunks: Vec<&[Ray]> = rays.chunks(CHUNK).collect();
    let colors = parallel::map(chunks.len(), |number| {
        let rays = chunks[number];
        let mut gathered = Vec::with_capacity(rays.len());
        for ray in rays {
            // A ray may have a million samples.
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
            gathered.push(march(view, values, ray, None, Some(level)));
        }
        let unit = |ray: &Ray| (ray.direction / ray.direction.length()).to_array();
        let directions: Vec<[f64; 3]> = rays.iter().map(unit).collect();
        let view_colors = view_colors(view, &gathered, &directions);
        progress.advance(Step::Render, rays.len() as u64);
        let colors = gathered.iter().zip(view_colors).map(|(ray, view_color)| RayColor {
            color: ray.over_background(view, view_color),
            transmittance: ray.transmittance,
            distance: ray.expected_distance(view),
        });
        Ok(colors.collect::<Vec<_>>())
    })?;
    Ok(colors.concat())
}
