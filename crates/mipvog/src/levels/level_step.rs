//! Planes of one level on their way to the next. Each is made, premultiplied and filtered along y
//! in one pass, while it is in a processor's cache.

use std::ops::Range;

use super::axis_filter::{AxisFilter, Readers};
use super::brightness::MOMENTS;
use super::plane::PlanePool;
use super::premultiply::RowBand;
use super::{AlphaDomain, Visibility};
use crate::base::error::Result;
use crate::base::parallel;
use crate::model::directional::DIRECTIONAL;
use crate::model::field::ColorDomain;
use crate::model::grid::NodeMask;

/// Planes that were filtered along y, `[plane][channel]`.
pub(super) type Filtered = Vec<Vec<Vec<f32>>>;

/// The weights of colours of level 0, and the meaning of the colours.
#[derive(Debug, Clone, Copy)]
pub(super) struct VisibleColors<'a> {
    /// The share of alpha that weights colours.
    pub visibility: &'a Visibility,
    /// The meaning of colours.
    pub colors: ColorDomain,
    /// True if moments of brightness are filtered too.
    pub moments: bool,
}

/// The weights of a plane's colours.
struct Weights {
    /// Alpha, or its visible share.
    of_colors: Vec<f32>,
    /// Alpha, if moments of brightness need it beside visible alpha; else empty.
    alpha: Vec<f32>,
}

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
    /// Planes for reuse.
    pub pool: &'a PlanePool,
}

impl LevelStep<'_, '_> {
    /// Makes planes by `make(x, channel, plane)`, filters the `rising` channels without weights,
    /// and passes all planes to `observe`.
    pub fn unweighted(
        &self,
        rising: &Range<usize>,
        make: impl Fn(usize, usize, &mut [f32]) -> Result<()> + Sync + Send,
        observe: impl Fn(usize, usize, &mut Vec<f32>) -> Result<()> + Sync + Send,
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
            observe(x, channel, &mut plane)?;
            self.pool.give([plane]);
            Ok(())
        })?;
        Ok(filtered)
    }

    /// Makes planes of level 0 and filters the alpha of density, the first channel. With
    /// `visible_colors`, also visible alpha, all colours premultiplied by it, and moments of
    /// brightness if requested.
    pub fn premultiplied(
        &self,
        domain: &AlphaDomain,
        visible_colors: Option<VisibleColors>,
        make: impl Fn(usize, usize, &mut [f32]) -> Result<()> + Sync + Send,
    ) -> Result<Filtered> {
        if self.filter.is_none() {
            return self.unweighted(&(0..0), make, |_, _, _| Ok(()));
        }
        let alphas = if visible_colors.is_some() { 2 } else { 1 };
        let mut filtered = self.output_planes(alphas + self.channels - 1);
        let (mut alpha_outputs, mut color_outputs) = (Vec::new(), Vec::new());
        for plane in &mut filtered {
            let (alpha, color) = plane.split_at_mut(alphas);
            alpha_outputs.push(alpha);
            color_outputs.extend(color);
        }
        let weights = self.filter_alphas(domain, visible_colors, &make, &mut alpha_outputs)?;
        let keeps = visible_colors.is_some_and(|visible| visible.moments);
        let meaning = visible_colors.map_or(ColorDomain::Logit, |visible| visible.colors);
        let colors = self.filter_colors(meaning, &weights, keeps, &make, &mut color_outputs)?;
        if let Some(VisibleColors { visibility, .. }) = visible_colors.filter(|_| keeps) {
            let sums = |i: usize| {
                let Weights { of_colors, alpha } = &weights[i];
                let [red, green, blue] =
                    [0, 1, 2].map(|channel| &colors[i * (self.channels - 1) + channel]);
                [alpha, of_colors, red, green, blue].map(Vec::as_slice)
            };
            self.add_moments(visibility, sums, &mut filtered)?;
        }
        let weights = weights.into_iter().flat_map(|own| [own.of_colors, own.alpha]);
        self.pool.give(weights.chain(colors).filter(|plane| !plane.is_empty()));
        Ok(filtered)
    }

    /// Makes the density of each plane, and filters its alpha and its visible alpha to `outputs`.
    fn filter_alphas(
        &self,
        domain: &AlphaDomain,
        visible_colors: Option<VisibleColors>,
        make: &(impl Fn(usize, usize, &mut [f32]) -> Result<()> + Sync + Send),
        outputs: &mut [&mut [Vec<f32>]],
    ) -> Result<Vec<Weights>> {
        let Some(filter) = self.filter else { return Ok(Vec::new()) };
        let readers = self.readers()?;
        parallel::map_mut(outputs, |i, outputs| {
            let x = self.planes.start + i;
            let (mut density, mut alpha) = (self.plane(), self.plane());
            make(x, 0, &mut density)?;
            filter.filter_plane(&readers[i], &mut alpha, &mut outputs[0], |rows, alpha| {
                self.band(x, &readers[i], rows).density_to_alpha(domain, &density, alpha);
            });
            let (Some(visible_colors), Some(output)) = (visible_colors, outputs.get_mut(1)) else {
                self.pool.give([density]);
                return Ok(Weights { of_colors: alpha, alpha: Vec::new() });
            };
            let sampler = visible_colors.visibility.sampler(self.required.nodes(), x);
            let mut visible = density;
            filter.filter_plane(&readers[i], &mut visible, output, |rows, visible| {
                self.band(x, &readers[i], rows).multiply(&sampler, &alpha, visible);
            });
            if !visible_colors.moments {
                self.pool.give([std::mem::take(&mut alpha)]);
            }
            Ok(Weights { of_colors: visible, alpha })
        })
    }

    /// Makes the colours of each plane, and filters them to `outputs`, premultiplied by `weights`.
    /// Returns the premultiplied planes, `[plane][channel]`: diffuse colours if it `keeps` them,
    /// and empty ones.
    fn filter_colors(
        &self,
        meaning: ColorDomain,
        weights: &[Weights],
        keeps: bool,
        make: &(impl Fn(usize, usize, &mut [f32]) -> Result<()> + Sync + Send),
        outputs: &mut [&mut Vec<f32>],
    ) -> Result<Vec<Vec<f32>>> {
        let Some(filter) = self.filter else { return Ok(Vec::new()) };
        let (readers, colors) = (self.readers()?, self.channels - 1);
        parallel::map_mut(outputs, |task, output| {
            let (i, channel) = (task / colors, 1 + task % colors);
            let x = self.planes.start + i;
            let (mut color, mut premultiplied) = (self.plane(), self.plane());
            make(x, channel, &mut color)?;
            let weight = &weights[i].of_colors;
            filter.filter_plane(&readers[i], &mut premultiplied, output, |rows, premultiplied| {
                let band = self.band(x, &readers[i], rows);
                band.premultiply(meaning, &color, weight, premultiplied);
            });
            self.pool.give([color]);
            if !(keeps && channel <= 3) {
                self.pool.give([std::mem::take(&mut premultiplied)]);
            }
            Ok(premultiplied)
        })
    }

    /// Makes the moments of [`super::brightness`] of each plane, and adds them to the `filtered`
    /// channels, filtered too. `sums(i)` are alpha, visible alpha and the three diffuse colours of
    /// plane `i`, premultiplied.
    pub fn add_moments<'s>(
        &self,
        visibility: &Visibility,
        sums: impl Fn(usize) -> [&'s [f32]; 5] + Sync + Send,
        filtered: &mut Filtered,
    ) -> Result<()> {
        let Some(filter) = self.filter else { return Ok(()) };
        let (readers, nodes, pool) = (self.readers()?, self.required.nodes(), self.pool);
        let mut moments = self.output_planes(MOMENTS);
        parallel::map_mut(&mut moments, |i, outputs| {
            let [alpha, visible, red, green, blue] = sums(i);
            let x = self.planes.start + i;
            let band = |rows| self.band(x, &readers[i], rows);
            let mut means = self.plane();
            band(0..nodes.0[1]).mean_color([red, green, blue], visible, &mut means);
            let (plain, bright) = outputs.split_at_mut(DIRECTIONAL);
            for (axis, (plain, bright)) in plain.iter_mut().zip(bright).enumerate() {
                let sampler = visibility.bent_sampler(nodes, x, axis);
                let (mut bent, mut products) = (self.plane(), self.plane());
                filter.filter_plane(&readers[i], &mut bent, plain, |rows, bent| {
                    band(rows).multiply(&sampler, alpha, bent);
                });
                filter.filter_plane(&readers[i], &mut products, bright, |rows, products| {
                    band(rows).premultiply(ColorDomain::Linear, &means, &bent, products);
                });
                pool.give([bent, products]);
            }
            pool.give([means]);
            Ok(())
        })?;
        for (channels, moments) in filtered.iter_mut().zip(moments) {
            channels.extend(moments);
        }
        Ok(())
    }

    /// Rows of plane `x`.
    fn band<'r>(&'r self, x: usize, readers: &'r Readers, rows: Range<usize>) -> RowBand<'r> {
        RowBand { required: self.required, read: &readers.read, x, rows }
    }

    /// Planes for filtered values of this many channels.
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

    /// A plane of the level with unspecified values.
    fn plane(&self) -> Vec<f32> {
        let [_, ny, nz] = self.required.nodes().0;
        self.pool.take(ny * nz)
    }
}
