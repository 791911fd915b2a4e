//! A field streamed through all its levels, plane by plane.
//!
//! Level 0 arrives in slabs of x planes. Each plane is filtered along y as soon as it is there and
//! waits in the ring of the next level's [`Stage`]; once the planes under an output plane's window
//! have come, their weighted sum along x, filtered along z, is the output plane, which in turn is
//! filtered for the level after. Sums along y and x run over whole rows, so vectors do most of the
//! work before z, where they cannot, has a quarter of it left. Memory is a few planes a level, whatever the grid's size, and no
//! level is ever whole in memory.
//!
//! Only some nodes matter. [`Regions`] says which nodes of each level must come out right; what
//! lies outside is skipped row by row and span by span. There level 0 holds stale numbers, but goes up as 0
//! where it is lifted, and coarser levels hold 0.
//!
//! Sums run in f64 and are rounded to f32 twice a level (after y, after x and z). A constant
//! therefore stays the same bits: weights sum to 1 within 2e-16, far below half an f32 ulp.

use std::collections::VecDeque;

use super::lift::Lift;
use super::regions::Regions;
use super::rise::Rise;
use super::stage::Stage;
use crate::error::Result;
use crate::parallel;

/// Consecutive x planes of a level, all channels.
#[derive(Debug)]
pub struct Slab {
    /// The first plane.
    pub first: usize,
    /// Channels of a plane.
    pub channels: usize,
    /// `planes[i * channels + c]` is channel `c` of plane `first + i`, `ny * nz` values.
    pub planes: Vec<Vec<f32>>,
}

impl Slab {
    /// Planes in the slab.
    pub fn count(&self) -> usize {
        self.planes.len() / self.channels
    }

    /// One channel of one plane, counted from the slab's first.
    pub fn plane(&self, index: usize, channel: usize) -> &[f32] {
        &self.planes[index * self.channels + channel]
    }
}

/// Streams channels through all levels.
pub struct Cascade<'a> {
    regions: &'a Regions,
    /// What goes up from level 0.
    lift: Lift<'a>,
    /// Planes of a full slab.
    thickness: usize,
    /// Whether slabs are taken before the next ones are made.
    in_turn: bool,
    stages: Vec<Stage<'a>>,
    slabs: Vec<Slab>,
    /// Planes to be used again: touching fresh memory costs more than filtering it.
    spare: Vec<Vec<f32>>,
}

impl<'a> Cascade<'a> {
    /// For `channels` at level 0, of which `lift` says what goes up, in slabs of `thickness` planes.
    pub fn new(regions: &'a Regions, channels: usize, lift: Lift<'a>, thickness: usize) -> Self {
        let above = lift.count(channels);
        let stages = regions.steps.iter().zip(&regions.levels[1..]).map(|(step, outputs)| Stage {
            step,
            outputs,
            ring_first: 0,
            ring: VecDeque::new(),
            made: 0,
        });
        let slabs = regions.levels.iter().enumerate().map(|(level, _)| Slab {
            first: 0,
            channels: if level == 0 { channels } else { above },
            planes: Vec::new(),
        });
        let (stages, slabs) = (stages.collect(), slabs.collect());
        Self { regions, lift, thickness, in_turn: false, stages, slabs, spare: Vec::new() }
    }

    /// Takes slabs before the next ones are made, where `in_turn`: slower, with half as many in memory.
    pub fn in_turn(self, in_turn: bool) -> Self {
        Self { in_turn, ..self }
    }

    /// Streams the whole field. `read(x, channel, region, plane)` fills the nodes in `region` (rows
    /// of bits along z) of a level-0 plane; `take(level, slab)` gets every slab of every level,
    /// each level's in order, while the next ones are made.
    pub fn run(
        mut self,
        read: impl Fn(usize, usize, &[u64], &mut [f32]) -> Result<()> + Sync + Send,
        mut take: impl FnMut(usize, &Slab) -> Result<()> + Send,
    ) -> Result<()> {
        let planes = self.regions.levels[0].nodes().0[0];
        let mut full: Vec<(usize, Slab)> = Vec::new();
        for start in (0..planes).step_by(self.thickness) {
            let end = planes.min(start + self.thickness);
            let mut take_all = || full.iter().try_for_each(|(level, slab)| take(*level, slab));
            if self.in_turn {
                take_all()?;
                full.drain(..).for_each(|(_, slab)| self.spare.extend(slab.planes));
                full = self.advance(start, end, &read)?;
                continue;
            }
            let (taken, made) = parallel::join(take_all, || self.advance(start, end, &read));
            // What was made first is wrong first.
            taken?;
            let used = std::mem::replace(&mut full, made?);
            used.into_iter().for_each(|(_, slab)| self.spare.extend(slab.planes));
        }
        full.iter().try_for_each(|(level, slab)| take(*level, slab))
    }

    /// Reads planes `start..end` of level 0 and makes what follows from them. Returns the slabs that are
    /// now full.
    fn advance(
        &mut self,
        start: usize,
        end: usize,
        read: &(impl Fn(usize, usize, &[u64], &mut [f32]) -> Result<()> + Sync + Send),
    ) -> Result<Vec<(usize, Slab)>> {
        let mut full = Vec::new();
        self.make(0, start, end, |_, x, channel, plane| {
            read(x, channel, self.regions.levels[0].plane(x), plane)
        })?;
        self.rise(0, &mut full)?;
        Ok(full)
    }

    /// Hands out the slab of `level` if it is full, then makes all coarser planes that can be.
    fn rise(&mut self, level: usize, full: &mut Vec<(usize, Slab)>) -> Result<()> {
        let slab = &mut self.slabs[level];
        let next = slab.first + slab.count();
        if slab.count() == self.thickness || next == self.regions.levels[level].nodes().0[0] {
            let empty = Slab { first: next, channels: slab.channels, planes: Vec::new() };
            full.push((level, std::mem::replace(slab, empty)));
        }
        let Some(stage) = self.stages.get(level) else { return Ok(()) };
        let ready = stage.step.axes[0].ready(stage.fed());
        let mut made = stage.made;
        while made < ready {
            let end = ready.min((made / self.thickness + 1) * self.thickness);
            self.make(level + 1, made, end, |stages, x, channel, plane| {
                stages[level].sum_planes(x, channel, plane);
                Ok(())
            })?;
            made = end;
            self.retire(level, made);
            self.rise(level + 1, full)?;
        }
        Ok(())
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
            self.spare.extend(planes);
            stage.ring_first += 1;
        }
    }

    /// Makes planes `start..end` of a level, and what they give to the next level's ring.
    fn make(
        &mut self,
        level: usize,
        start: usize,
        end: usize,
        fill: impl Fn(&[Stage<'a>], usize, usize, &mut [f32]) -> Result<()> + Sync + Send,
    ) -> Result<()> {
        let [_, ny, nz] = self.regions.levels[level].nodes().0;
        let channels = self.slabs[level].channels;
        let lift = if level == 0 { &self.lift } else { &Lift::Raw(0..channels) };
        let (count, up) = (end - start, lift.count(channels));
        let mut planes: Vec<_> =
            (0..count * channels).map(|_| spare_plane(&mut self.spare, ny * nz)).collect();
        let stages = &self.stages;
        let fill = |i: usize, channel, plane: &mut [f32]| fill(stages, start + i, channel, plane);
        let Some(stage) = stages.get(level) else {
            parallel::map_mut(&mut planes, |i, plane| fill(i / channels, i % channels, plane))?;
            self.slabs[level].planes.append(&mut planes);
            return Ok(());
        };
        let coarse_y = stage.outputs.nodes().0[1];
        let mut risen: Vec<_> =
            (0..count * up).map(|_| spare_plane(&mut self.spare, coarse_y * nz)).collect();
        let wanted =
            parallel::map(count, |i| Ok(stage.step.wanted_rows(start + i, stage.outputs)))?;
        let rise = Rise { stage, region: &self.regions.levels[level], start, channels, wanted };
        let (own, above, spare) = (&mut planes, &mut risen, &mut self.spare);
        match lift {
            Lift::Raw(range) => rise.raw(range, fill, own, above)?,
            Lift::Amounts(matter) => rise.matter((matter, None), fill, own, above, spare)?,
            Lift::Seen(matter, visibility) => {
                rise.matter((matter, Some(visibility)), fill, own, above, spare)?;
            }
        }
        if let Some(stage) = self.stages.get_mut(level) {
            let mut risen = risen.into_iter();
            stage.ring.extend((0..count).map(|_| risen.by_ref().take(up).collect()));
        }
        self.slabs[level].planes.append(&mut planes);
        Ok(())
    }
}

/// A plane to be written, used before where there is one.
pub(super) fn spare_plane(spare: &mut Vec<Vec<f32>>, length: usize) -> Vec<f32> {
    match spare.iter().rposition(|plane| plane.len() == length) {
        Some(i) => spare.swap_remove(i),
        None => vec![0.0; length],
    }
}
