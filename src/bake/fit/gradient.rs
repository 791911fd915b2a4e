//! One ray, and the derivatives of its colour by the values of coarser levels.
//!
//! With the samples' optical depths `t_i` and colours `c_i`, light `T_i` before and `T_(i+1)`
//! behind a sample, weights `w_i = T_i - T_(i+1)`, accumulated `A = sum w_i c_i` and light left
//! `T`:
//!
//! ```text
//! dL/dc_i = w_i dL/dA
//! dL/dt_i = T_(i+1) dL/dA . c_i - (sum over j > i of w_j dL/dA . c_j + T dL/dT)
//! ```

use super::target::{Target, Targets};
use crate::model::activate::lanes;
use crate::model::field::{ActivationOrder, DensityFunction};
use crate::model::view_dependence::ViewDependence;
use crate::view::render::{ColorRule, Route, View};
use crate::view::sample::{Cell, Dense, Sample};

/// Marks nodes that are not fitted.
pub const NOT_FITTED: u32 = u32::MAX;
/// Optical depth from which a ray ends.
const OPAQUE_DEPTH: f32 = 9.0;

/// Sums of derivatives by fitted node of one level.
#[derive(Debug)]
pub struct Sums<const C: usize> {
    /// By the stored density.
    pub density: Vec<f32>,
    /// By the stored colours.
    pub color: Vec<[f32; C]>,
}

/// Sums of derivatives.
#[derive(Debug)]
pub struct Gradient<const C: usize> {
    /// From level 1 on.
    pub levels: Vec<Sums<C>>,
    samples: Vec<Sampled<C>>,
}

impl<const C: usize> Gradient<C> {
    /// Zeros for this many nodes of each level.
    pub fn new(nodes: &[usize]) -> Self {
        let zeros =
            |&nodes: &usize| Sums { density: vec![0.0; nodes], color: vec![[0.0; C]; nodes] };
        Self { levels: nodes.iter().map(zeros).collect(), samples: Vec::new() }
    }
}

/// Rays through all levels.
pub struct Rays<'a, const C: usize> {
    /// The rules.
    pub view: &'a View,
    /// All levels as they are now.
    pub field: &'a Dense<C>,
    /// The colours that the rays should have.
    pub targets: &'a Targets,
    /// From level 1 on, the number of each node among those that are fitted.
    pub numbers: &'a [&'a [u32]],
}

/// A sample's share of one level.
#[derive(Debug, Clone, Copy)]
struct Part<const C: usize> {
    level: usize,
    /// Its share of the sample.
    share: f32,
    cell: Cell,
    /// Interpolated density.
    density: f32,
    /// Activated colour.
    color: [f32; C],
}

/// A sample that was composited.
#[derive(Debug, Clone, Copy)]
struct Sampled<const C: usize> {
    parts: [Option<Part<C>>; 2],
    intervals: f32,
    weight: f32,
    /// Light left behind it.
    left: f32,
    /// Its colour, none where its weight is too small to add any.
    color: Option<[f32; C]>,
}

/// A ray's squared error and what it follows from.
#[derive(Debug, Clone, Copy)]
struct Traced<const C: usize> {
    /// Derivative of half the squared error by the accumulated colour.
    by_color: [f32; C],
    /// Derivative by the light left.
    by_left: f32,
    /// Light left.
    left: f32,
    /// The squared error, over three channels.
    square: f32,
}

impl<const C: usize> Rays<'_, C> {
    /// Adds the derivatives of half of ray `number`'s squared error, times `worth`.
    pub fn differentiate(
        &self,
        scale: usize,
        number: usize,
        worth: f32,
        gradient: &mut Gradient<C>,
    ) {
        let target = self.targets.draw(scale, number, false);
        let Some((traced, rule)) = target.and_then(|target| self.trace(&target, gradient)) else {
            return;
        };
        let by_color = traced.by_color.map(|by| by * worth);
        let (by_left, left) = (traced.by_left * worth, traced.left);
        let samples = std::mem::take(&mut gradient.samples);
        // Back to front: the derivative by the light behind a sample.
        let mut behind = left * by_left;
        for sample in samples.iter().rev() {
            let worth = sample.color.map_or(0.0, |color| dot(&by_color, &color));
            let by_depth = (sample.left * worth - behind) * sample.intervals;
            for part in sample.parts.iter().flatten().filter(|part| part.level > 0) {
                self.add(part, by_depth, sample, (&rule, &by_color), gradient);
            }
            behind += sample.weight * worth;
        }
        gradient.samples = samples;
    }

    /// The squared error of ray `number` of validation, or of steps, over three channels.
    pub fn square(
        &self,
        scale: usize,
        number: usize,
        validates: bool,
        gradient: &mut Gradient<C>,
    ) -> f32 {
        let Some(target) = self.targets.draw(scale, number, validates) else { return 0.0 };
        match self.trace(&target, gradient) {
            Some((traced, _)) => traced.square,
            None => 0.0,
        }
    }

    /// Composites a ray, leaving its samples in `gradient`.
    fn trace(
        &self,
        target: &Target,
        gradient: &mut Gradient<C>,
    ) -> Option<(Traced<C>, ColorRule<'_>)> {
        let Target { ray, aside, color } = target;
        let route = Route::new(self.view, self.field.levels(), ray, Some(*aside), None)?;
        let samples = &mut gradient.samples;
        samples.clear();
        let unit = (ray.direction / ray.direction.length()).to_array();
        let rule = ColorRule::of(self.view, unit);
        let mut accumulated = [0.0f32; C];
        let mut depth = 0.0f32;
        route.walk(self.view, self.field.skip(), |k, lambda, intervals| {
            let position = route.path.position(k);
            let sums = (&mut depth, &mut accumulated);
            self.composite(&rule, position, lambda, intervals, sums, samples);
            depth < OPAQUE_DEPTH
        });
        let left = lanes::exp(-depth);
        rule.finish(&mut accumulated);
        let mut traced = self.by_accumulated(unit, &accumulated, left, *color);
        rule.by_sums(&accumulated, &mut traced.by_color);
        Some((traced, rule))
    }

    /// Interpolates and composites one sample.
    #[inline(always)]
    fn composite(
        &self,
        rule: &ColorRule,
        position: [f64; 3],
        lambda: f32,
        intervals: f32,
        (depth, accumulated): (&mut f32, &mut [f32; C]),
        samples: &mut Vec<Sampled<C>>,
    ) {
        let level = lambda as usize;
        let blend = lambda - level as f32;
        let mut sample =
            Sampled { parts: [None; 2], intervals, weight: 0.0, left: 0.0, color: None };
        let mut optical = 0.0;
        let shares = [(level, 1.0 - blend), (level + 1, blend)];
        for (slot, (level, share)) in sample.parts.iter_mut().zip(shares) {
            if share == 0.0 {
                continue;
            }
            let Some(cell) = self.field.locate(level, position) else { continue };
            let density = self.field.density(level, &cell);
            optical += share * self.optical_depth(level, density);
            *slot = Some(Part { level, share, cell, density, color: [0.0; C] });
        }
        optical *= intervals;
        let before = lanes::exp(-*depth);
        *depth += optical;
        sample.weight = before * lanes::opacity(optical);
        sample.left = lanes::exp(-*depth);
        if sample.weight > self.view.march.color_threshold {
            let mut mixed = [0.0; C];
            for part in sample.parts.iter_mut().flatten() {
                part.color = self.field.color(part.level, &part.cell);
                rule.activate(&mut part.color);
                for (mixed, color) in mixed.iter_mut().zip(part.color) {
                    *mixed += part.share * color;
                }
            }
            for (sum, color) in accumulated.iter_mut().zip(mixed) {
                *sum += sample.weight * color;
            }
            sample.color = Some(mixed);
        }
        if optical > 0.0 {
            samples.push(sample);
        }
    }

    /// Optical depth over one interval of a level's interpolated density.
    fn optical_depth(&self, level: usize, density: f32) -> f32 {
        let activation = &self.view.activation;
        match (level, activation.order) {
            (0, ActivationOrder::Raw) => match activation.function {
                DensityFunction::Softplus => {
                    lanes::softplus(density + activation.shift) * activation.interval
                }
                DensityFunction::Relu => density.max(0.0) * activation.interval,
            },
            (0, ActivationOrder::Density) => density * activation.interval,
            (0, ActivationOrder::Opacity) => -libm::log1pf(-density.min(1.0 - f32::EPSILON)),
            _ => density * density,
        }
    }

    /// Derivatives of half the squared error of the ray's colour.
    fn by_accumulated(
        &self,
        unit: [f64; 3],
        accumulated: &[f32; C],
        left: f32,
        target: [f32; 3],
    ) -> Traced<C> {
        let background = self.view.background;
        let channels = 3 + self.view.features;
        let network = self.view.view_dependence.as_ref().and_then(ViewDependence::network);
        let mut by_color = [0.0; C];
        let error = |specular: [f32; 3]| {
            [0, 1, 2].map(|c| accumulated[c] + specular[c] + left * background[c] - target[c])
        };
        let errors = match network {
            Some(network) => {
                let (sample, by_input) =
                    network.differentiate(unit, &accumulated[..channels], error);
                by_color[..channels].copy_from_slice(&by_input);
                sample
            }
            None => error([0.0; 3]),
        };
        for (by_color, error) in by_color.iter_mut().zip(errors) {
            *by_color += error;
        }
        let by_left = (0..3).map(|c| errors[c] * background[c]).sum();
        let square = errors.iter().map(|error| error * error).sum();
        Traced { by_color, by_left, left, square }
    }

    /// Adds a sample's part to the derivatives of the level's nodes around it.
    fn add(
        &self,
        part: &Part<C>,
        by_depth: f32,
        sample: &Sampled<C>,
        (rule, by_color): (&ColorRule, &[f32; C]),
        gradient: &mut Gradient<C>,
    ) {
        // depth = density^2
        let by_density = by_depth * part.share * 2.0 * part.density;
        let mut by_raw = [0.0; C];
        if sample.color.is_some() {
            let by_part = by_color.map(|by_color| sample.weight * by_color * part.share);
            by_raw = rule.by_values(&part.color, &by_part);
        }
        for (node, weight) in self.field.corners(part.level, &part.cell) {
            let number = self.numbers[part.level - 1][node];
            if number == NOT_FITTED {
                continue;
            }
            let sums = &mut gradient.levels[part.level - 1];
            sums.density[number as usize] += weight * by_density;
            for (sum, by_raw) in sums.color[number as usize].iter_mut().zip(by_raw) {
                *sum += weight * by_raw;
            }
        }
    }
}

fn dot<const C: usize>(a: &[f32; C], b: &[f32; C]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
