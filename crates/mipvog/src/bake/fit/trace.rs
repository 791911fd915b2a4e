//! One ray: its samples in packets, and its squared error.
//!
//! All densities of a packet are read before any colour, so that cache misses overlap.

use multiversion::multiversion;

use super::curve::Curve;
use super::finest::Finest;
use super::target::{Target, Targets};
use crate::model::activate::lanes;
use crate::model::anisotropy::ANISOTROPY;
use crate::model::camera::Ray;
use crate::model::field::{Activation, ActivationOrder};
use crate::model::view_dependence::ViewDependence;
use crate::model::view_mlp::Workspace;
use crate::view::render::{ColorRule, Path, Route, RouteSample, View};
use crate::view::sample::{Cell, Dense, SampleLevels};

/// Optical depth at which a ray ends: 1/400 of the light is left.
const OPAQUE_DEPTH: f32 = 6.0;
/// Samples of a packet.
const PACKET: usize = 16;

/// Rays through all levels.
pub struct Rays<'a, const C: usize> {
    /// The rules.
    pub view: &'a View,
    /// All levels in their current state, except the colours of level 0.
    pub field: &'a Dense<C>,
    /// The colours of level 0.
    pub finest: &'a Finest<C>,
    /// The colours that the rays should have.
    pub targets: &'a Targets,
    /// From level 1 on, the number of each node among those that are fitted.
    pub numbers: &'a [&'a [u32]],
    /// The rule of levels.
    pub curve: &'a Curve,
    /// One of this many samples is used, and stands for the intervals of all.
    pub every: u32,
}

/// A sample's part of one level.
#[derive(Debug, Clone, Copy, Default)]
pub struct Part {
    pub level: usize,
    /// Its share of the sample; 0 if the sample does not read the level.
    pub share: f32,
    pub cell: Cell,
    /// Interpolated density in the direction of the ray.
    pub density: f32,
}

/// A sample that was composited.
#[derive(Debug, Clone, Copy)]
pub struct Sampled {
    pub parts: [Part; 2],
    pub intervals: f32,
    pub weight: f32,
    /// Optical depth over one interval of the coarser part, less that of the finer part.
    pub deeper: f32,
    /// Light left behind it.
    pub left: f32,
    /// The index of its colours; none if its weight is too small.
    pub colors: Option<usize>,
}

/// A sample's activated colours.
#[derive(Debug, Clone, Copy)]
pub struct SampledColors<const C: usize> {
    /// Of the two parts.
    pub parts: [[f32; C]; 2],
    /// Of both together.
    pub mixed: [f32; C],
}

/// The samples of a ray, front to back.
#[derive(Debug, Default)]
pub struct Samples<const C: usize> {
    pub list: Vec<Sampled>,
    pub colors: Vec<SampledColors<C>>,
    /// Memory of the view network.
    network: Workspace,
}

/// A ray's squared error and its intermediate results.
#[derive(Debug, Clone, Copy)]
pub struct Traced<'a, const C: usize> {
    /// Derivative of half the squared error by the accumulated colour.
    pub by_color: [f32; C],
    /// Derivative by the light left.
    pub by_left: f32,
    /// Light left.
    pub left: f32,
    /// The squared error, over three channels.
    pub square: f32,
    /// The activation of the colours.
    pub rule: ColorRule<'a>,
    /// Values of the functions of anisotropy.
    pub along: [f32; ANISOTROPY],
}

/// Samples that wait to be read together.
struct Packet {
    count: usize,
    k: [f64; PACKET],
    /// Levels of detail.
    lambda: [f32; PACKET],
    intervals: [f32; PACKET],
}

/// Sums over a ray's packets.
struct Sums<const C: usize> {
    depth: f32,
    /// Light left.
    left: f32,
    color: [f32; C],
}

/// [`Rays::follow`] in the processor's widest vectors.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn follow<'a, const C: usize>(
    rays: &Rays<'a, C>,
    target: &Target,
    samples: &mut Samples<C>,
) -> Option<Traced<'a, C>> {
    rays.follow(target, samples)
}

/// [`Rays::composite`] in the processor's widest vectors.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn composite<const C: usize>(
    rays: &Rays<C>,
    rule: &ColorRule,
    path: &Path,
    packet: &mut Packet,
    sums: &mut Sums<C>,
    samples: &mut Samples<C>,
) {
    rays.composite(rule, path, packet, sums, samples);
}

impl<'a, const C: usize> Rays<'a, C> {
    /// Composites a ray, leaving its samples in `samples`. None if it misses the box.
    pub fn trace(&self, target: &Target, samples: &mut Samples<C>) -> Option<Traced<'a, C>> {
        follow(self, target, samples)
    }

    #[inline(always)]
    fn follow(&self, target: &Target, samples: &mut Samples<C>) -> Option<Traced<'a, C>> {
        let Target { ray, aside, color, .. } = target;
        let route = Route::new(self.view, self.field.levels(), ray, Some(*aside), None)?;
        samples.list.clear();
        samples.colors.clear();
        let unit = (ray.direction / ray.direction.length()).to_array();
        let rule = ColorRule::of(self.view, unit);
        let mut sums = Sums { depth: 0.0, left: 1.0, color: [0.0; C] };
        let (k, lambda, intervals) = ([0.0; PACKET], [0.0; PACKET], [0.0; PACKET]);
        let mut packet = Packet { count: 0, k, lambda, intervals };
        let taken = [as_good_as_random(ray) % self.every, self.every].map(f64::from);
        route.walk(
            self.view,
            |number| self.field.skip(number),
            taken,
            |sample| {
                let RouteSample { k, lambda, intervals, .. } = sample;
                let at = packet.count;
                (packet.k[at], packet.lambda[at], packet.intervals[at]) = (k, lambda, intervals);
                packet.count += 1;
                if packet.count == PACKET {
                    composite(self, &rule, &route.path, &mut packet, &mut sums, samples);
                }
                sums.depth < OPAQUE_DEPTH
            },
        );
        composite(self, &rule, &route.path, &mut packet, &mut sums, samples);
        let left = sums.left;
        rule.finish(&mut sums.color);
        let network = &mut samples.network;
        let along = route.path.along;
        let mut traced =
            self.by_accumulated((rule, along), unit, (&sums.color, left), *color, network);
        rule.by_sums(&sums.color, &mut traced.by_color);
        Some(traced)
    }

    /// Reads, composites and empties a packet. Samples behind opaque ones are skipped.
    #[inline(always)]
    fn composite(
        &self,
        rule: &ColorRule,
        path: &Path,
        packet: &mut Packet,
        sums: &mut Sums<C>,
        samples: &mut Samples<C>,
    ) {
        let count = std::mem::take(&mut packet.count);
        let first = samples.list.len();
        for i in 0..count {
            let (position, lambda) = (path.position(packet.k[i]), packet.lambda[i]);
            let level = lambda as usize;
            let blend = lambda - level as f32;
            let parts = [
                self.part((level, 1.0 - blend), position, path),
                self.part((level + 1, blend), position, path),
            ];
            samples.list.push(Sampled {
                parts,
                intervals: packet.intervals[i],
                weight: 0.0,
                deeper: 0.0,
                left: 0.0,
                colors: None,
            });
        }
        let [mut optical, deeper] = self.optical_depths(&samples.list[first..]);
        let mut left = [0.0f32; PACKET];
        let mut depth = sums.depth;
        let mut visible = 0;
        for (left, optical) in left.iter_mut().zip(optical).take(count) {
            if depth >= OPAQUE_DEPTH {
                break;
            }
            depth += optical;
            *left = depth;
            visible += 1;
        }
        left.iter_mut().for_each(|left| *left = lanes::exp(-*left));
        optical.iter_mut().for_each(|optical| *optical = lanes::opacity(*optical));
        samples.list.truncate(first + visible);
        sums.depth = depth;
        for (i, sample) in samples.list[first..].iter_mut().enumerate() {
            let left = left[i];
            sample.weight = sums.left * optical[i];
            sample.deeper = deeper[i];
            (sample.left, sums.left) = (left, left);
            if sample.weight > self.view.march.color_threshold {
                sample.colors = Some(samples.colors.len());
                let colors = self.colors(rule, &sample.parts);
                for (sum, color) in sums.color.iter_mut().zip(colors.mixed) {
                    *sum += sample.weight * color;
                }
                samples.colors.push(colors);
            }
        }
    }

    /// A sample's part of a level.
    #[inline(always)]
    fn part(&self, (level, share): (usize, f32), position: [f64; 3], path: &Path) -> Part {
        if share == 0.0 {
            return Part::default();
        }
        let cell = self.field.locate(level, position).unwrap_or_default();
        Part { level, share, cell, density: self.field.density(level, &cell, &path.along) }
    }

    /// The colours of a sample.
    #[inline(always)]
    fn colors(&self, rule: &ColorRule, parts: &[Part; 2]) -> SampledColors<C> {
        let mut colors = SampledColors { parts: [[0.0; C]; 2], mixed: [0.0; C] };
        for (part, color) in parts.iter().zip(&mut colors.parts) {
            if part.share == 0.0 {
                continue;
            }
            *color = match part.level {
                0 => self.finest.color(&part.cell),
                level => self.field.color(level, &part.cell),
            };
            rule.activate(color);
            for (mixed, color) in colors.mixed.iter_mut().zip(*color) {
                *mixed += part.share * color;
            }
        }
        colors
    }

    /// Optical depths of a packet's samples, and for each the optical depth of the coarser part
    /// minus that of the finer part, over one interval.
    #[inline(always)]
    fn optical_depths(&self, samples: &[Sampled]) -> [[f32; PACKET]; 2] {
        let (mut density, mut share) = ([[0.0f32; PACKET]; 2], [[0.0f32; PACKET]; 2]);
        let (mut intervals, mut is_finest) = ([0.0f32; PACKET], [false; PACKET]);
        for (i, sample) in samples.iter().enumerate().take(PACKET) {
            for (part, of) in sample.parts.iter().enumerate() {
                (density[part][i], share[part][i]) = (of.density, of.share);
            }
            (intervals[i], is_finest[i]) = (sample.intervals, sample.parts[0].level == 0);
        }
        let finest = self.finest_depths(&density[0]);
        let (mut optical, mut deeper) = ([0.0f32; PACKET], [0.0f32; PACKET]);
        for i in 0..PACKET {
            let [fine, coarse] = [density[0][i], density[1][i]];
            let fine = if is_finest[i] { finest[i] } else { fine * fine };
            let coarse = coarse * coarse;
            optical[i] = (share[0][i] * fine + share[1][i] * coarse) * intervals[i];
            deeper[i] = coarse - fine;
        }
        [optical, deeper]
    }

    /// Optical depths over one interval of level 0's densities.
    #[inline(always)]
    fn finest_depths(&self, density: &[f32; PACKET]) -> [f32; PACKET] {
        let Activation { shift, interval, order, function } = self.view.activation;
        let mut depths = *density;
        match order {
            ActivationOrder::Raw => {
                let depth = |at| lanes::density(at + shift, function) * interval;
                depths.iter_mut().for_each(|at| *at = depth(*at));
            }
            ActivationOrder::Density => depths.iter_mut().for_each(|at| *at *= interval),
            ActivationOrder::Opacity => {
                depths.iter_mut().for_each(|at| *at = -libm::log1pf(-at.min(1.0 - f32::EPSILON)));
            }
        }
        depths
    }

    /// Derivatives of half the squared error of the ray's colour.
    fn by_accumulated(
        &self,
        (rule, along): (ColorRule<'a>, [f32; ANISOTROPY]),
        unit: [f64; 3],
        (accumulated, left): (&[f32; C], f32),
        target: [f32; 3],
        workspace: &mut Workspace,
    ) -> Traced<'a, C> {
        let background = self.view.background;
        let channels = 3 + self.view.features;
        let network = self.view.view_dependence.as_ref().and_then(ViewDependence::network);
        let mut by_color = [0.0; C];
        let error = |specular: [f32; 3]| {
            [0, 1, 2].map(|c| accumulated[c] + specular[c] + left * background[c] - target[c])
        };
        let errors = match network {
            Some(network) => {
                let by_color = &mut by_color[..channels];
                network.differentiate(unit, &accumulated[..channels], error, by_color, workspace)
            }
            None => error([0.0; 3]),
        };
        for (by_color, error) in by_color.iter_mut().zip(errors) {
            *by_color += error;
        }
        let by_left = (0..3).map(|c| errors[c] * background[c]).sum();
        let square = errors.iter().map(|error| error * error).sum();
        Traced { by_color, by_left, left, square, rule, along }
    }
}

/// Pseudo-random bits from the direction.
fn as_good_as_random(ray: &Ray) -> u32 {
    (ray.direction.x.to_bits() ^ ray.direction.y.to_bits()) as u32 >> 8
}
