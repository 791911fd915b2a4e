//! Planes of one level on their way to the next. Each is made, premultiplied and filtered along y
//! in one go, while it is in a processor's cache.

use std::ops::Range;

use super::axis_filter::{AxisFilter, Readers};
use super::plane::PlanePool;
use super::premultiply::RowBand;
use super::{AlphaDomain, Visibility};
use crate::base::error::Result;
use crate::base::parallel;
use crate::model::field::ColorDomain;
use crate::model::grid::NodeMask;

/// Planes that were filtered along y, `[plane][channel]`.
pub(super) type Filtered = Vec<Vec<Vec<f32>>>;

/// Consecutive planes of one level.
pub(super) struct LevelStep<'a, 'f> {
    /// The filter to the next level; the last level has none.
    pub filter: Option<&'a AxisFilter<'f>>,
    /// The required nodes of the level.
    pub required: &'a NodeMask,
    /// The planes' numbers.
    pub planes: Range<usize>,
    /// Channels of each.
    pub channels: usize,
    /// Planes to use again.
    pub pool: &'a PlanePool,
}

impl LevelStep<'_, '_> {
    /// Makes planes by `make(x, channel, plane)`, filters the `rising` channels as they are, and
    /// shows all to `show`.
    pub fn as_they_are(
        &self,
        rising: &Range<usize>,
        make: impl Fn(usize, usize, &mut [f32]) -> Result<()> + Sync + Send,
        show: impl Fn(usize, usize, &mut Vec<f32>) -> Result<()> + Sync + Send,
    ) -> Result<Filtered> {
        let readers = self.readers()?;
        let mut filtered = self.output_planes(rising.len());
        let mut outputs = filtered.iter_mut().flatten();
        let output = |task| {
            let rises = rising.contains(&(task % self.channels));
            rises.then(|| outputs.next()).flatten()
        };
        let mut tasks: Vec<_> = (0..self.planes.len() * self.channels).map(output).collect();
        parallel::map_mut(&mut tasks, |task, output| {
            let (i, channel) = (task / self.channels, task % self.channels);
            let x = self.planes.start + i;
            let mut plane = self.plane();
            make(x, channel, &mut plane)?;
            if let (Some(filter), Some(output)) = (self.filter, output) {
                filter.filter_plane(&readers[i], &mut plane, output, |_, _| ());
            }
            show(x, channel, &mut plane)?;
            self.pool.give([plane]);
            Ok(())
        })?;
        Ok(filtered)
    }

    /// Makes planes of level 0 and filters the alpha of density, the first channel. With
    /// `visible_colors` also the visible alpha, and all colours premultiplied by it.
    pub fn premultiplied(
        &self,
        domain: &AlphaDomain,
        visible_colors: Option<(&Visibility, ColorDomain)>,
        make: impl Fn(usize, usize, &mut [f32]) -> Result<()> + Sync + Send,
    ) -> Result<Filtered> {
        let Some(filter) = self.filter else {
            return self.as_they_are(&(0..0), make, |_, _, _| Ok(()));
        };
        let readers = self.readers()?;
        let (required, pool, colors) = (self.required, self.pool, self.channels - 1);
        let band = |i: usize, rows| RowBand {
            required,
            read: &readers[i].read,
            x: self.planes.start + i,
            rows,
        };
        let alphas = if visible_colors.is_some() { 2 } else { 1 };
        let mut filtered = self.output_planes(alphas + colors);
        let (mut alpha_outputs, mut color_outputs) = (Vec::new(), Vec::new());
        for plane in &mut filtered {
            let (alpha, color) = plane.split_at_mut(alphas);
            alpha_outputs.push(alpha);
            color_outputs.extend(color);
        }
        let weights = parallel::map_mut(&mut alpha_outputs, |i, outputs| {
            let x = self.planes.start + i;
            let (mut density, mut alpha) = (self.plane(), self.plane());
            make(x, 0, &mut density)?;
            filter.filter_plane(&readers[i], &mut alpha, &mut outputs[0], |rows, alpha| {
                band(i, rows).density_to_alpha(domain, &density, alpha);
            });
            let (Some((visibility, _)), Some(output)) = (visible_colors, outputs.get_mut(1)) else {
                pool.give([density]);
                return Ok(alpha);
            };
            let sampler = visibility.sampler(required.nodes(), x);
            let mut visible = density;
            filter.filter_plane(&readers[i], &mut visible, output, |rows, visible| {
                band(i, rows).attenuate(&sampler, &alpha, visible);
            });
            pool.give([alpha]);
            Ok(visible)
        })?;
        let meaning = visible_colors.map_or(ColorDomain::Logit, |(_, colors)| colors);
        parallel::map_mut(&mut color_outputs, |task, output| {
            let (i, channel) = (task / colors, 1 + task % colors);
            let x = self.planes.start + i;
            let (mut color, mut premultiplied) = (self.plane(), self.plane());
            make(x, channel, &mut color)?;
            filter.filter_plane(&readers[i], &mut premultiplied, output, |rows, premultiplied| {
                band(i, rows).premultiply(meaning, &color, &weights[i], premultiplied);
            });
            pool.give([color, premultiplied]);
            Ok(())
        })?;
        pool.give(weights);
        Ok(filtered)
    }

    /// Planes for filtered values of so many channels.
    fn output_planes(&self, channels: usize) -> Filtered {
        let Some(filter) = self.filter else { return Vec::new() };
        let length = filter.outputs.nodes().0[1] * self.required.nodes().0[2];
        let plane = |_| (0..channels).map(|_| self.pool.take(length)).collect();
        self.planes.clone().map(plane).collect()
    }

    /// The output nodes that read each plane.
    fn readers(&self) -> Result<Vec<Readers>> {
        let Some(filter) = self.filter else { return Ok(Vec::new()) };
        parallel::map(self.planes.len(), |i| Ok(filter.readers(self.planes.start + i)))
    }

    /// A plane of the level with any values.
    fn plane(&self) -> Vec<f32> {
        let [_, ny, nz] = self.required.nodes().0;
        self.pool.take(ny * nz)
    }
}
