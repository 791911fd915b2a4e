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
//! lies outside is skipped row by row and span by span, and the slabs hold stale numbers there.
//!
//! Sums run in f64 and are rounded to f32 twice a level (after y, after x and z). A constant
//! therefore stays the same bits: weights sum to 1 within 2e-16, far below half an f32 ulp.

use std::collections::VecDeque;

use multiversion::multiversion;

use super::lift::{Lift, Lifted, spare_plane};
use super::regions::{Regions, Step};
use crate::error::Result;
use crate::grid::{NodeMask, row};
use crate::parallel;

/// Output nodes that nobody needs, but fewer than these in a row are made too: stopping costs more.
const GAP: usize = 16;

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

/// Planes on their way up from one level to the next.
struct Stage<'a> {
    step: &'a Step,
    outputs: &'a NodeMask,
    /// Number of the first plane in `ring`.
    ring_first: usize,
    /// Planes filtered along y, `[plane][channel]`.
    ring: VecDeque<Vec<Vec<f32>>>,
    /// Output planes already made.
    made: usize,
}

impl Stage<'_> {
    /// Planes that have come so far.
    fn fed(&self) -> usize {
        self.ring_first + self.ring.len()
    }

    /// Sums the ring along x, and then along z, into output plane `x` of one channel.
    fn sum_planes(&self, x: usize, channel: usize, out: &mut [f32]) {
        let [x_taps, _, z_taps] = &self.step.axes;
        let (first, weights) = x_taps.window(x);
        let nz = z_taps.inputs();
        let mut sums = vec![0.0; nz];
        for (y, out) in out.chunks_exact_mut(z_taps.outputs()).enumerate() {
            row::for_each_span(self.outputs.row(x, y), GAP, |start, end| {
                let (low, high) = z_taps.reach(start, end);
                let sums = &mut sums[low..high];
                let row = |plane: usize| {
                    let ring = &self.ring[first + plane - self.ring_first][channel];
                    &ring[y * nz + low..y * nz + high]
                };
                sum_rows(weights, row, sums);
                z_taps.apply(sums, low, start, &mut out[start..end]);
            });
        }
    }

    /// Filters one channel of a plane of the finer level along y, where output planes read it.
    fn filter_plane(&self, wanted: &[u64], plane: &[f32], out: &mut [f32]) {
        let [_, y_taps, z_taps] = &self.step.axes;
        let nz = z_taps.inputs();
        let words = self.outputs.row_words();
        let mut sums = vec![0.0; nz];
        for (y, wanted) in wanted.chunks_exact(words).enumerate() {
            let (first, weights) = y_taps.window(y);
            row::for_each_span(wanted, GAP, |start, end| {
                let (low, high) = z_taps.reach(start, end);
                let sums = &mut sums[low..high];
                let row = |row: usize| &plane[(first + row) * nz + low..(first + row) * nz + high];
                sum_rows(weights, row, sums);
                round_to_f32(sums, &mut out[y * nz + low..y * nz + high]);
            });
        }
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
        let count = (end - start) * channels;
        let mut planes: Vec<_> =
            (0..count).map(|_| spare_plane(&mut self.spare, ny * nz)).collect();
        let stages = &self.stages;
        parallel::map_mut(&mut planes, |i, plane| {
            fill(stages, start + i / channels, i % channels, plane)
        })?;
        self.feed(level, start, &planes)?;
        self.slabs[level].planes.append(&mut planes);
        Ok(())
    }

    /// Filters planes of a level, from plane `start` on, along y into the next level's ring.
    fn feed(&mut self, level: usize, start: usize, planes: &[Vec<f32>]) -> Result<()> {
        let Some(stage) = self.stages.get(level) else { return Ok(()) };
        let [_, _, nz] = self.regions.levels[level].nodes().0;
        let channels = self.slabs[level].channels;
        let count = planes.len() / channels;
        let wanted =
            parallel::map(count, |i| Ok(stage.step.wanted_rows(start + i, stage.outputs)))?;
        let lifted = match level {
            0 => {
                let region = &self.regions.levels[0];
                Lifted::new(&self.lift, region, start, planes, channels, &mut self.spare)?
            }
            _ => Lifted::AsTheyAre(0..channels),
        };
        let stage = &self.stages[level];
        let coarse_y = stage.outputs.nodes().0[1];
        let up = lifted.channels();
        let mut filtered: Vec<_> =
            (0..count * up).map(|_| spare_plane(&mut self.spare, coarse_y * nz)).collect();
        parallel::map_mut(&mut filtered, |task, filtered| {
            let (i, channel) = (task / up, task % up);
            let planes = &planes[i * channels..(i + 1) * channels];
            lifted.with_plane(start + i, i, channel, planes, |plane| {
                stage.filter_plane(&wanted[i], plane, filtered);
            });
            Ok(())
        })?;
        if let Some(stage) = self.stages.get_mut(level) {
            let mut filtered = filtered.into_iter();
            stage.ring.extend((0..count).map(|_| filtered.by_ref().take(up).collect()));
        }
        lifted.retire(&mut self.spare);
        Ok(())
    }
}

/// Sums rows times weights, in their order. Rows without weight may not be there.
fn sum_rows<'a>(weights: &[f64], row: impl Fn(usize) -> &'a [f32], sums: &mut [f64]) {
    sums.fill(0.0);
    let mut weighted =
        weights.iter().enumerate().filter(|(_, weight)| **weight != 0.0).map(|(i, &w)| (row(i), w));
    while let Some(first) = weighted.next() {
        // As many at once as the default filter has: sums then stay in registers.
        let [second, third, fourth] = [(); 3].map(|()| weighted.next());
        match (second, third, fourth) {
            (Some(second), Some(third), Some(fourth)) => {
                add_scaled([first, second, third, fourth], sums);
            }
            (Some(second), Some(third), None) => add_scaled([first, second, third], sums),
            (Some(second), ..) => add_scaled([first, second], sums),
            (None, ..) => add_scaled([first], sums),
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn add_scaled<const N: usize>(rows: [(&[f32], f64); N], sums: &mut [f64]) {
    let rows = rows.map(|(row, weight)| (&row[..sums.len()], weight));
    for (i, sum) in sums.iter_mut().enumerate() {
        let add = |sum, (row, weight): &(&[f32], f64)| sum + weight * f64::from(row[i]);
        *sum = rows.iter().fold(*sum, add);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn round_to_f32(sums: &[f64], out: &mut [f32]) {
    for (out, &sum) in out.iter_mut().zip(sums) {
        *out = sum as f32;
    }
}
