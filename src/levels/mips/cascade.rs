//! A field streamed through all its levels, plane by plane.
//!
//! Planes go by: whoever reads one of level 0, or is shown one of a coarser level, does with it what is to be done while it
//! is in the caches, and it is gone. Each is filtered along y as soon as it is there, and that
//! waits in the ring of the next level's [`Stage`]; once the planes under an output plane's window
//! have come, their weighted sum along x, filtered along z, is the output plane, which in turn is
//! filtered for the level after. Sums along y and x run over whole rows, so vectors do most of the
//! work before z, where they cannot, has a quarter of it left. Memory is a few planes a level, whatever the grid's size, and no
//! level is ever whole in memory.
//!
//! Only some nodes matter. [`Regions`] says which nodes of each level must come out right; what
//! lies outside is skipped row by row and span by span. There level 0 goes up as 0
//! where it is lifted, and coarser levels hold 0.
//!
//! Sums run in f64 and are rounded to f32 twice a level (after y, after x and z). A constant
//! therefore stays the same bits: weights sum to 1 within 2e-16, far below half an f32 ulp.

use std::collections::VecDeque;
use std::ops::Range;

use super::lift::Lift;
use super::pool::Pool;
use super::regions::Regions;
use super::rise::Rise;
use super::stage::Stage;
use crate::base::error::Result;
use crate::base::parallel;

/// Planes of a slab where nobody wants others: enough work for some threads, and few enough to stay in the caches.
pub const SLAB: usize = 8;

/// Streams channels through all levels.
pub struct Cascade<'a> {
    regions: &'a Regions,
    /// Channels of level 0.
    channels: usize,
    /// What goes up from there.
    lift: Lift<'a>,
    /// Planes of a slab.
    thickness: usize,
    /// Whether slabs are taken before the next ones are made.
    in_turn: bool,
    stages: Vec<Stage<'a>>,
    pool: Pool,
}

impl<'a> Cascade<'a> {
    /// For `channels` at level 0, of which `lift` says what goes up, in slabs of `thickness` planes.
    pub fn new(regions: &'a Regions, channels: usize, lift: Lift<'a>, thickness: usize) -> Self {
        let stages = regions.steps.iter().zip(&regions.levels[1..]).map(|(step, outputs)| Stage {
            step,
            outputs,
            ring_first: 0,
            ring: VecDeque::new(),
            made: 0,
        });
        let (stages, pool) = (stages.collect(), Pool::default());
        Self { regions, channels, lift, thickness, in_turn: false, stages, pool }
    }

    /// Takes slabs before the next ones are made, where `in_turn`: slower, with half as many in memory.
    pub fn in_turn(self, in_turn: bool) -> Self {
        Self { in_turn, ..self }
    }

    /// Streams the whole field. `read(x, channel, region, plane)` fills the nodes in `region` (rows
    /// of bits along z) of a level-0 plane; the others hold stale numbers. `pass(level, x, channel, plane)` sees each
    /// plane of coarser levels, from any thread; if it takes it away it leaves one as long. `take(level, planes)`
    /// is told which planes have gone by, a slab at a time, each level's in order, while the next ones are made.
    pub fn run(
        mut self,
        read: impl Fn(usize, usize, &[u64], &mut [f32]) -> Result<()> + Sync + Send,
        pass: impl Fn(usize, usize, usize, &mut Vec<f32>) -> Result<()> + Sync + Send,
        mut take: impl FnMut(usize, Range<usize>) -> Result<()> + Send,
    ) -> Result<()> {
        let planes = self.regions.levels[0].nodes().0[0];
        let mut full: Vec<(usize, Range<usize>)> = Vec::new();
        for start in (0..planes).step_by(self.thickness) {
            let end = planes.min(start + self.thickness);
            let mut take_all =
                || full.drain(..).try_for_each(|(level, planes)| take(level, planes));
            if self.in_turn {
                take_all()?;
                full = self.advance(start..end, &read, &pass)?;
                continue;
            }
            let (taken, made) = parallel::join(take_all, || self.advance(start..end, &read, &pass));
            // What was made first is wrong first.
            taken?;
            full = made?;
        }
        full.into_iter().try_for_each(|(level, planes)| take(level, planes))
    }

    /// Reads planes of level 0 and makes what follows from them. Returns the slabs that have now gone by.
    fn advance(
        &mut self,
        planes: Range<usize>,
        read: &(impl Fn(usize, usize, &[u64], &mut [f32]) -> Result<()> + Sync + Send),
        pass: &(impl Fn(usize, usize, usize, &mut Vec<f32>) -> Result<()> + Sync + Send),
    ) -> Result<Vec<(usize, Range<usize>)>> {
        let region = &self.regions.levels[0];
        let rise = self.rise_of(0, planes.clone());
        let fill = |x, channel, plane: &mut [f32]| read(x, channel, region.plane(x), plane);
        let risen = match &self.lift {
            Lift::Raw(range) => rise.raw(range, fill, |_, _, _| Ok(()))?,
            Lift::Amounts(matter) => rise.matter((matter, None), fill)?,
            Lift::Seen(matter, seen) => rise.matter((matter, Some(seen)), fill)?,
        };
        self.feed(0, risen);
        let mut full = vec![(0, planes)];
        self.rise(0, pass, &mut full)?;
        Ok(full)
    }

    /// Makes all planes of the levels above `level` that can be.
    fn rise(
        &mut self,
        level: usize,
        pass: &(impl Fn(usize, usize, usize, &mut Vec<f32>) -> Result<()> + Sync + Send),
        full: &mut Vec<(usize, Range<usize>)>,
    ) -> Result<()> {
        let Some(stage) = self.stages.get(level) else { return Ok(()) };
        let count = stage.outputs.nodes().0[0];
        let ready = stage.step.axes[0].ready(stage.fed());
        let (mut made, next) = (stage.made, level + 1);
        while made < ready {
            let slab = made / self.thickness * self.thickness;
            let end = ready.min(slab + self.thickness);
            let stage = &self.stages[level];
            let sum = |x, channel, plane: &mut [f32]| {
                stage.sum_planes(x, channel, plane);
                Ok(())
            };
            let all = 0..self.lift.count(self.channels);
            let pass_on = |x, channel, plane: &mut Vec<f32>| pass(next, x, channel, plane);
            let risen = self.rise_of(next, made..end).raw(&all, sum, pass_on)?;
            self.feed(next, risen);
            made = end;
            self.retire(level, made);
            if made == count || made == slab + self.thickness {
                full.push((next, slab..made));
            }
            self.rise(next, pass, full)?;
        }
        Ok(())
    }

    /// Planes of a level that are to be made.
    fn rise_of(&self, level: usize, planes: Range<usize>) -> Rise<'_, 'a> {
        let channels = if level == 0 { self.channels } else { self.lift.count(self.channels) };
        let (stage, region) = (self.stages.get(level), &self.regions.levels[level]);
        Rise { stage, region, planes, channels, pool: &self.pool }
    }

    /// Puts what planes of a level gave into the next level's ring.
    fn feed(&mut self, level: usize, risen: Vec<Vec<Vec<f32>>>) {
        if let Some(stage) = self.stages.get_mut(level) {
            stage.ring.extend(risen);
        }
    }

    /// Frees the planes of a ring that no further output plane reads.
    fn retire(&mut self, level: usize, made: usize) {
        let stage = &mut self.stages[level];
        stage.made = made;
        let taps = &stage.step.axes[0];
        let first = if made < taps.outputs() { taps.window(made).0 } else { taps.inputs() };
        // Without a low-pass some planes are read by nobody, and may be yet to come.
        while stage.ring_first < first
            && let Some(planes) = stage.ring.pop_front()
        {
            self.pool.give(planes);
            stage.ring_first += 1;
        }
    }
}
