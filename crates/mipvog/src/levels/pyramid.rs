//! A field streamed through all its levels, plane by plane.
//!
//! Each plane of level 0 is read from the source, shown to the sink, and filtered along y while it
//! is in the caches. The result waits in the ring of the next level's [`AxisFilter`]. Once the ring
//! holds all planes under an output plane's window, their weighted sum along x, filtered along z,
//! is the output plane. This plane is filtered for the next level in turn. Sums along y and x run
//! over whole rows, so they are vectorized; a quarter of the work is along z, which is not. Memory
//! is a few planes per level, whatever the size of the grid.
//!
//! Only [`RequiredNodes`] are computed; others are skipped row by row and span by span. Skipped
//! nodes are zero, on level 0 if it is premultiplied, and on coarser levels.
//!
//! Sums run in f64 and are rounded to f32 twice per level (after y, after x and z). A constant
//! therefore keeps its bits: weights sum to 1 within 2e-16, far below half an f32 ulp.

use std::collections::VecDeque;
use std::ops::Range;

use super::axis_filter::AxisFilter;
use super::brightness::MOMENTS;
use super::level_step::{Filtered, LevelStep, VisibleColors};
use super::plane::PlanePool;
use super::unpremultiply::LevelFinisher;
use super::{
    AlphaDomain, Direction, LevelFilter, Plane, PlaneSink, PlaneSource, RequiredNodes, Visibility,
};
use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::model::field::{ColorDomain, RadianceField};
use crate::model::grid::NodeMask;

/// Default planes of a slab: enough work for several threads, and few enough to stay in the caches.
pub const SLAB: usize = 8;

/// The values that are filtered from level 0 to coarser levels.
#[derive(Debug, Clone)]
pub enum Content<'a> {
    /// These channels, as stored.
    Logits(Range<usize>),
    /// The alpha of density, the only channel. The sink gets coarser planes as alpha.
    Alpha(AlphaDomain),
    /// The alpha of density, the first channel, and all colours premultiplied by visible alpha. The
    /// sink gets coarser planes as stored.
    Colors {
        /// Density to alpha, and alpha to stored densities.
        domain: AlphaDomain,
        /// The meaning of colours.
        colors: ColorDomain,
        /// The share of alpha that weights colours.
        visibility: &'a Visibility,
        /// The nodes of each level that the sink gets, finest first. Nodes around them are
        /// required.
        retained: Vec<&'a NodeMask>,
        /// Directional terms of coarser planes, in further channels.
        direction: Option<Direction>,
    },
}

impl<'a> Content<'a> {
    /// The stored content of the levels that `filter` makes from `field`. `visibility` is given if
    /// the filter averages alpha, with bent normals if levels have a `direction`.
    pub fn of_levels(
        filter: &dyn LevelFilter,
        visibility: Option<&'a Visibility>,
        field: &RadianceField,
        retained: Vec<&'a NodeMask>,
        direction: Option<Direction>,
    ) -> Self {
        let colors = field.color_domain;
        match filter.alpha(&field.scene.activation).zip(visibility) {
            Some((domain, visibility)) => {
                Self::Colors { domain, colors, visibility, retained, direction }
            }
            None => Self::Logits(usize::from(!filter.has_density())..1 + field.color_channels()),
        }
    }

    /// Channels of filtered planes of a coarser `level` if level 0 has `channels`.
    fn channels(&self, level: usize, channels: usize) -> usize {
        let has_moments = self.moments().is_some_and(|moments| level > moments);
        match self {
            Self::Logits(range) => range.len(),
            Self::Alpha(_) => 1,
            Self::Colors { .. } => channels + 1 + if has_moments { MOMENTS } else { 0 },
        }
    }

    /// The level whose nodes give the moments of brightness.
    fn moments(&self) -> Option<usize> {
        match self {
            Self::Colors { direction, .. } => direction.and_then(|direction| direction.moments),
            _ => None,
        }
    }
}

/// A field and the levels that are made of it.
#[derive(Clone)]
pub struct Pyramid<'a> {
    /// Level 0.
    pub source: &'a dyn PlaneSource,
    /// The nodes whose values must be exact.
    pub required: &'a RequiredNodes,
    /// The values that go up.
    pub content: Content<'a>,
    /// Planes of a slab, at least 1.
    pub slab: usize,
    /// True if the sink works on slabs while the next ones are made, which is faster but holds
    /// twice as many in memory.
    pub pipelined: bool,
}

impl Pyramid<'_> {
    /// Streams all levels into `sink`. Progress counts planes of level 0.
    ///
    /// # Errors
    ///
    /// Errors of source and sink, and [`Error::cancelled`] if `progress` requests a stop.
    pub fn run(&self, sink: &dyn PlaneSink, step: Step, progress: &dyn Progress) -> Result<()> {
        let finishers = self.finishers();
        let mut flow = Flow::new(self, &finishers, sink);
        let planes = self.required.levels[0].nodes().0[0];
        let finish = |(level, planes): (usize, Range<usize>)| {
            if level == 0 {
                progress.advance(step, planes.len() as u64);
            }
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
            match &finishers[level] {
                Some(finisher) => finisher.finish(planes, sink),
                None => sink.slab(level, planes),
            }
        };
        let mut complete = Vec::new();
        for start in (0..planes).step_by(self.slab) {
            let slab = start..planes.min(start + self.slab);
            let mut finish_all = || complete.drain(..).try_for_each(finish);
            if self.pipelined {
                let (finished, advanced) = parallel::join(finish_all, || flow.advance(slab));
                // An earlier plane's error comes first.
                finished?;
                complete = advanced?;
            } else {
                finish_all()?;
                complete = flow.advance(slab)?;
            }
        }
        complete.into_iter().try_for_each(finish)
    }

    /// The finishers of levels whose planes are premultiplied.
    fn finishers(&self) -> Vec<Option<LevelFinisher<'_>>> {
        let finisher = |level: usize| match &self.content {
            Content::Colors { domain, colors, retained, direction, .. } if level > 0 => {
                let channels = self.source.channels();
                let meaning = (*domain, *colors, *direction);
                Some(LevelFinisher::new(level, meaning, channels, retained[level]))
            }
            _ => None,
        };
        (0..self.required.levels.len()).map(finisher).collect()
    }
}

/// A pyramid at work.
struct Flow<'a> {
    pyramid: &'a Pyramid<'a>,
    finishers: &'a [Option<LevelFinisher<'a>>],
    sink: &'a dyn PlaneSink,
    filters: Vec<AxisFilter<'a>>,
    pool: PlanePool,
}

impl<'a> Flow<'a> {
    fn new(
        pyramid: &'a Pyramid<'a>,
        finishers: &'a [Option<LevelFinisher<'a>>],
        sink: &'a dyn PlaneSink,
    ) -> Self {
        let RequiredNodes { steps, levels } = pyramid.required;
        let filter = |(taps, outputs)| AxisFilter {
            taps,
            outputs,
            ring_first: 0,
            ring: VecDeque::new(),
            made: 0,
        };
        let filters = steps.iter().zip(&levels[1..]).map(filter).collect();
        Self { pyramid, finishers, sink, filters, pool: PlanePool::default() }
    }

    /// Reads planes of level 0 and makes all planes that depend on them alone. Returns the slabs
    /// that are now complete.
    fn advance(&mut self, planes: Range<usize>) -> Result<Vec<(usize, Range<usize>)>> {
        let Pyramid { source, required, content, .. } = self.pyramid;
        let step = self.step(0, planes.clone());
        let read = |x, channel, values: &mut [f32]| {
            source.read(channel, x, required.levels[0].plane(x), values)?;
            self.sink.plane(Plane { level: 0, x, channel, values })
        };
        let filtered = match content {
            Content::Logits(range) => step.unweighted(range, read, |_, _, _| Ok(()))?,
            Content::Alpha(domain) => step.premultiplied(domain, None, read)?,
            Content::Colors { domain, colors, visibility, .. } => {
                let moments = content.moments() == Some(0);
                let colors = VisibleColors { visibility, colors: *colors, moments };
                step.premultiplied(domain, Some(colors), read)?
            }
        };
        self.feed(0, filtered);
        let mut complete = vec![(0, planes)];
        self.make_above(0, &mut complete)?;
        Ok(complete)
    }

    /// Makes all planes of the levels above `level` whose inputs are complete.
    fn make_above(
        &mut self,
        level: usize,
        complete: &mut Vec<(usize, Range<usize>)>,
    ) -> Result<()> {
        let Some(filter) = self.filters.get(level) else { return Ok(()) };
        let count = filter.outputs.nodes().0[0];
        let ready = filter.taps.axes[0].ready(filter.fed());
        let (mut made, next) = (filter.made, level + 1);
        let thickness = self.pyramid.slab;
        while made < ready {
            let slab = made / thickness * thickness;
            let end = ready.min(slab + thickness);
            let filter = &self.filters[level];
            let sum = |x, channel, values: &mut [f32]| {
                filter.sum_planes(x, channel, values);
                Ok(())
            };
            let observe = |x, channel, values: &mut Vec<f32>| match &self.finishers[next] {
                Some(finisher) => {
                    finisher.keep(x, channel, values);
                    Ok(())
                }
                None => self.sink.plane(Plane { level: next, x, channel, values }),
            };
            let all = 0..self.channels(next);
            let step = self.step(next, made..end);
            let mut filtered = step.unweighted(&all, sum, observe)?;
            if let Some((visibility, finisher)) = self.moments_of(next) {
                let kept: Vec<_> = (made..end).map(|x| finisher.kept(x)).collect();
                let sums = |i: usize| std::array::from_fn(|channel| kept[i][channel].as_slice());
                step.add_moments(visibility, sums, &mut filtered)?;
            }
            self.feed(next, filtered);
            made = end;
            self.retire(level, made);
            if made == count || made == slab + thickness {
                complete.push((next, slab..made));
            }
            self.make_above(next, complete)?;
        }
        Ok(())
    }

    /// The inputs of moments of brightness, if the nodes of `level` give them.
    fn moments_of(&self, level: usize) -> Option<(&'a Visibility, &'a LevelFinisher<'a>)> {
        match &self.pyramid.content {
            Content::Colors { visibility, .. } if self.pyramid.content.moments() == Some(level) => {
                Some(visibility).copied().zip(self.finishers[level].as_ref())
            }
            _ => None,
        }
    }

    /// Channels of a level's planes on their way up.
    fn channels(&self, level: usize) -> usize {
        let channels = self.pyramid.source.channels();
        if level == 0 { channels } else { self.pyramid.content.channels(level, channels) }
    }

    /// Planes of a level that remain to be made.
    fn step(&self, level: usize, planes: Range<usize>) -> LevelStep<'_, 'a> {
        let (filter, required) = (self.filters.get(level), &self.pyramid.required.levels[level]);
        LevelStep { filter, required, planes, channels: self.channels(level), pool: &self.pool }
    }

    /// Puts filtered planes of a level into the next level's ring.
    fn feed(&mut self, level: usize, filtered: Filtered) {
        if let Some(filter) = self.filters.get_mut(level) {
            filter.ring.extend(filtered);
        }
    }

    /// Frees the planes of a ring that no further output plane reads.
    fn retire(&mut self, level: usize, made: usize) {
        let filter = &mut self.filters[level];
        filter.made = made;
        let taps = &filter.taps.axes[0];
        let first = if made < taps.outputs() { taps.window(made).0 } else { taps.inputs() };
        // Without a low-pass, some planes have no reader, and may not have been made yet.
        while filter.ring_first < first
            && let Some(planes) = filter.ring.pop_front()
        {
            self.pool.give(planes);
            filter.ring_first += 1;
        }
    }
}
