//! Planes of a level to what they give to the next one: each is filled, lifted and filtered along y in one go, while it
//! is still in a processor's cache.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use super::cascade::spare_plane;
use super::lift::Part;
use super::stage::Stage;
use super::{Matter, Visibility};
use crate::error::Result;
use crate::grid::NodeMask;
use crate::parallel;

/// Consecutive planes of a level that go up.
pub struct Rise<'a, 's> {
    /// The step that they take.
    pub stage: &'a Stage<'s>,
    /// What must come out right of their level.
    pub region: &'a NodeMask,
    /// The first one's number.
    pub start: usize,
    /// Channels of each.
    pub channels: usize,
    /// Of each the output nodes that read it.
    pub wanted: Vec<Vec<u64>>,
}

impl Rise<'_, '_> {
    /// Fills `planes`, `[plane][channel]`, by `fill(plane, channel, values)`, and filters the channels in `rising` as they
    /// are into `risen`.
    pub fn raw(
        &self,
        rising: &Range<usize>,
        fill: impl Fn(usize, usize, &mut [f32]) -> Result<()> + Sync + Send,
        planes: &mut [Vec<f32>],
        risen: &mut [Vec<f32>],
    ) -> Result<()> {
        let mut risen = risen.iter_mut();
        let with_risen = |(i, plane)| {
            let rises = rising.contains(&(i % self.channels));
            (plane, rises.then(|| risen.next()).flatten())
        };
        let mut work: Vec<_> = planes.iter_mut().enumerate().map(with_risen).collect();
        parallel::map_mut(&mut work, |task, (plane, risen)| {
            let i = task / self.channels;
            fill(i, task % self.channels, plane)?;
            if let Some(risen) = risen {
                self.stage.filter_plane(&self.wanted[i], plane, risen, |_, _| ());
            }
            Ok(())
        })?;
        Ok(())
    }

    /// Fills `planes`, and filters into `risen` the amounts of density, the first channel; with `visibility` how much of
    /// them is seen, and all colours weighted by that. Planes between come from `spare`, and go back.
    pub fn matter(
        &self,
        (matter, visibility): (&Matter, Option<&Visibility>),
        fill: impl Fn(usize, usize, &mut [f32]) -> Result<()> + Sync + Send,
        planes: &mut [Vec<f32>],
        risen: &mut [Vec<f32>],
        spare: &mut Vec<Vec<f32>>,
    ) -> Result<()> {
        let Self { stage, region, start, channels, ref wanted } = *self;
        let [_, ny, nz] = region.nodes().0;
        let part = |i: usize, rows| Part { region, x: start + i, rows };
        let kinds = if visibility.is_some() { 2 } else { 1 };
        let (count, up) = (wanted.len(), risen.len() / wanted.len());
        let mut weights: Vec<_> = (0..count * kinds).map(|_| spare_plane(spare, ny * nz)).collect();
        let used = spare.extract_if(.., |plane| plane.len() == ny * nz);
        let scratch: Mutex<Vec<Vec<f32>>> = Mutex::new(used.collect());
        let (mut densities, mut colors) = (Vec::new(), Vec::new());
        let of_plane = planes.chunks_exact_mut(channels).zip(risen.chunks_exact_mut(up));
        for ((planes, risen), weights) in of_plane.zip(weights.chunks_exact_mut(kinds)) {
            let (density, others) = planes.split_at_mut(1);
            let (of_weights, of_others) = risen.split_at_mut(kinds);
            densities.push((&mut density[0], weights.split_at_mut(1), of_weights));
            colors.extend(others.iter_mut().zip(of_others));
        }
        parallel::map_mut(&mut densities, |i, (density, (amounts, seen), risen)| {
            fill(i, 0, density)?;
            let amounts = &mut amounts[0];
            stage.filter_plane(&wanted[i], amounts, &mut risen[0], |rows, amounts| {
                part(i, rows).weigh(matter, density, amounts);
            });
            if let (Some(visibility), [seen]) = (visibility, &mut **seen) {
                let weigher = visibility.weigher(region.nodes(), start + i);
                stage.filter_plane(&wanted[i], seen, &mut risen[1], |rows, seen| {
                    part(i, rows).see(&weigher, amounts, seen);
                });
            }
            Ok(())
        })?;
        parallel::map_mut(&mut colors, |task, (color, risen)| {
            let (i, channel) = (task / (channels - 1), 1 + task % (channels - 1));
            fill(i, channel, color)?;
            let scratch = || scratch.lock().unwrap_or_else(PoisonError::into_inner);
            let used = scratch().pop();
            let mut weighted = used.unwrap_or_else(|| vec![0.0; ny * nz]);
            let seen = &weights[i * kinds + kinds - 1];
            stage.filter_plane(&wanted[i], &mut weighted, risen, |rows, weighted| {
                part(i, rows).color(matter, color, seen, weighted);
            });
            scratch().push(weighted);
            Ok(())
        })?;
        spare.extend(scratch.into_inner().unwrap_or_else(PoisonError::into_inner));
        spare.append(&mut weights);
        Ok(())
    }
}
