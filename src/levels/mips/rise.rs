//! Planes of a level to what they give to the next one: each is filled, lifted and filtered along y in one go, while it
//! is still in a processor's cache.

use std::ops::Range;

use super::lift::Part;
use super::pool::Pool;
use super::stage::Stage;
use super::{Matter, Visibility};
use crate::base::error::Result;
use crate::base::parallel;
use crate::model::grid::NodeMask;

/// Consecutive planes of a level that go up.
pub struct Rise<'a, 's> {
    /// The step that they take, unless theirs is the last level.
    pub stage: Option<&'a Stage<'s>>,
    /// What must come out right of their level.
    pub region: &'a NodeMask,
    /// Their numbers.
    pub planes: Range<usize>,
    /// Channels of each.
    pub channels: usize,
    /// Where planes come from that nobody keeps.
    pub pool: &'a Pool,
}

impl Rise<'_, '_> {
    /// Fills planes by `fill(x, channel, plane)`, filters the channels in `rising` as they are, and shows all to `pass`.
    /// Returns what goes up, `[plane][channel]`.
    pub fn raw(
        &self,
        rising: &Range<usize>,
        fill: impl Fn(usize, usize, &mut [f32]) -> Result<()> + Sync + Send,
        pass: impl Fn(usize, usize, &mut Vec<f32>) -> Result<()> + Sync + Send,
    ) -> Result<Vec<Vec<Vec<f32>>>> {
        let wanted = self.wanted()?;
        let mut risen = self.room_above(rising.len());
        let mut above = risen.iter_mut().flatten();
        let of_task = |task| {
            let rises = rising.contains(&(task % self.channels));
            rises.then(|| above.next()).flatten()
        };
        let mut work: Vec<_> = (0..self.planes.len() * self.channels).map(of_task).collect();
        parallel::map_mut(&mut work, |task, risen| {
            let (i, channel) = (task / self.channels, task % self.channels);
            let x = self.planes.start + i;
            let mut plane = self.plane();
            fill(x, channel, &mut plane)?;
            if let (Some(stage), Some(risen)) = (self.stage, risen) {
                stage.filter_plane(&wanted[i], &mut plane, risen, |_, _| ());
            }
            pass(x, channel, &mut plane)?;
            self.pool.give([plane]);
            Ok(())
        })?;
        Ok(risen)
    }

    /// Fills planes of level 0, and filters the amounts of density, the first channel; with `visibility` how much of
    /// them is seen, and all colours weighted by that. Returns what goes up, `[plane][channel]`.
    pub fn matter(
        &self,
        (matter, visibility): (&Matter, Option<&Visibility>),
        fill: impl Fn(usize, usize, &mut [f32]) -> Result<()> + Sync + Send,
    ) -> Result<Vec<Vec<Vec<f32>>>> {
        let Some(stage) = self.stage else { return self.raw(&(0..0), fill, |_, _, _| Ok(())) };
        let wanted = self.wanted()?;
        let (region, pool, others) = (self.region, self.pool, self.channels - 1);
        let part = |x, rows| Part { region, x, rows };
        let kinds = if visibility.is_some() { 2 } else { 1 };
        let mut risen = self.room_above(kinds + others);
        let (mut densities, mut colors) = (Vec::new(), Vec::new());
        for risen in &mut risen {
            let (of_weights, of_colors) = risen.split_at_mut(kinds);
            densities.push(of_weights);
            colors.extend(of_colors);
        }
        // What colours are weighted by.
        let weights = parallel::map_mut(&mut densities, |i, risen| {
            let x = self.planes.start + i;
            let (mut density, mut amounts) = (self.plane(), self.plane());
            fill(x, 0, &mut density)?;
            stage.filter_plane(&wanted[i], &mut amounts, &mut risen[0], |rows, amounts| {
                part(x, rows).weigh(matter, &density, amounts);
            });
            let (Some(visibility), Some(risen)) = (visibility, risen.get_mut(1)) else {
                pool.give([density]);
                return Ok(amounts);
            };
            let weigher = visibility.weigher(region.nodes(), x);
            let mut seen = density;
            stage.filter_plane(&wanted[i], &mut seen, risen, |rows, seen| {
                part(x, rows).see(&weigher, &amounts, seen);
            });
            pool.give([amounts]);
            Ok(seen)
        })?;
        parallel::map_mut(&mut colors, |task, risen| {
            let (i, channel) = (task / others, 1 + task % others);
            let x = self.planes.start + i;
            let (mut color, mut weighted) = (self.plane(), self.plane());
            fill(x, channel, &mut color)?;
            stage.filter_plane(&wanted[i], &mut weighted, risen, |rows, weighted| {
                part(x, rows).color(matter, &color, &weights[i], weighted);
            });
            pool.give([color, weighted]);
            Ok(())
        })?;
        pool.give(weights);
        Ok(risen)
    }

    /// Planes for what goes up, so many channels of each.
    fn room_above(&self, channels: usize) -> Vec<Vec<Vec<f32>>> {
        let Some(stage) = self.stage else { return Vec::new() };
        let length = stage.outputs.nodes().0[1] * self.region.nodes().0[2];
        let of_plane = |_| (0..channels).map(|_| self.pool.take(length)).collect();
        self.planes.clone().map(of_plane).collect()
    }

    /// Of each plane the output nodes that read it.
    fn wanted(&self) -> Result<Vec<Vec<u64>>> {
        let Some(stage) = self.stage else { return Ok(Vec::new()) };
        let of_plane = |i| Ok(stage.step.wanted_rows(self.planes.start + i, stage.outputs));
        parallel::map(self.planes.len(), of_plane)
    }

    /// A plane of the level, whatever it holds.
    fn plane(&self) -> Vec<f32> {
        let [_, ny, nz] = self.region.nodes().0;
        self.pool.take(ny * nz)
    }
}
