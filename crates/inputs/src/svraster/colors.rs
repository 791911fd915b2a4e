//! Harmonics at the nodes of a plane of a box.
//!
//! A voxel has one colour; a field interpolates colours of nodes. A node first gets the mean of the
//! voxels around it, weighted by the light that they absorb within a cell. Interpolating such means
//! blurs a voxel with its neighbours. So a voxel's own colour is compared with the mean of its
//! eight nodes, and the mean of these differences is added to the nodes.

use super::density::{EvenDensities, between, density};
use super::loaded::Voxels;
use super::plan::BoxPlan;
use super::plane::Touching;

/// Stands for no slot.
const NO_SLOT: u32 = u32::MAX;
/// Added to the light that a voxel absorbs, so that every voxel has some weight.
const LEAST_WEIGHT: f64 = 1e-4;

/// Harmonics at the nodes of a plane that voxels touch, node after node.
#[derive(Debug, Clone)]
pub(super) struct NodeColors {
    /// The place of each node's numbers.
    slots: Vec<u32>,
    /// Nodes with numbers, ascending: few of the plane's nodes.
    nodes: Vec<u32>,
    values: Vec<f32>,
    width: usize,
}

impl NodeColors {
    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        let tables = [&self.slots, &self.nodes].map(|table| size_of_val(table.as_slice()));
        tables.iter().sum::<usize>() + size_of_val(self.values.as_slice())
    }

    /// The numbers of a node; none if no voxel touches it.
    fn node(&self, node: usize) -> &[f32] {
        match self.slots.get(node) {
            Some(&slot) if slot != NO_SLOT => {
                let first = slot as usize * self.width;
                self.values.get(first..first + self.width).unwrap_or_default()
            }
            _ => &[],
        }
    }

    /// Calls `visit` with each node and its number of a channel.
    pub(super) fn channel(&self, channel: usize, mut visit: impl FnMut(usize, f32)) {
        for &node in &self.nodes {
            let slot = self.slots.get(node as usize).copied().unwrap_or(NO_SLOT);
            let value = self.values.get(slot as usize * self.width + channel);
            visit(node as usize, value.copied().unwrap_or(0.0));
        }
    }
}

/// A box whose nodes get colours.
pub(super) struct Painted<'a> {
    pub(super) voxels: &'a Voxels,
    pub(super) even: &'a EvenDensities,
    pub(super) plan: &'a BoxPlan,
    /// The edge of the smallest voxels, in world units.
    pub(super) unit: f64,
}

impl Painted<'_> {
    fn weight(&self, density: f64) -> f64 {
        LEAST_WEIGHT - libm::expm1(-density * self.unit * f64::from(self.plan.edge))
    }

    /// Means of the voxels around each node.
    pub(super) fn means(&self, x: u32) -> NodeColors {
        let Self { voxels, plan, .. } = *self;
        let touching = Touching::find(voxels, plan, x);
        let mut sums = Sums::new(plan, voxels.width());
        for touch in &touching.large {
            let row = voxels.harmonics(touch.voxel);
            touch.nodes(plan, |node, [y, z]| {
                let (count, middle) = touch.eighths([x, y, z], plan.edge);
                let own = density(voxels.raw(touch.voxel, middle));
                sums.add(node, count * self.weight(own), row);
            });
        }
        for small in &touching.small {
            let share = 2.0 * f64::from(small.cube.edge) / f64::from(plan.edge);
            let own = self.weight(self.even.mean(small.voxel));
            sums.add(small.node, share * share * share * own, voxels.harmonics(small.voxel));
        }
        sums.finish()
    }

    /// The shares of a voxel's absorbed light in its eighths, x slowest.
    fn light(&self, voxel: u32) -> [f32; 8] {
        let raw = self.voxels.corners(voxel);
        let mut shares = [0.0; 8];
        let mut sum = 0.0;
        for (number, share) in shares.iter_mut().enumerate() {
            let at = [2, 1, 0].map(|bit| if number >> bit & 1 == 1 { 0.75 } else { 0.25 });
            *share = self.weight(density(between(&raw, at)));
            sum += *share;
        }
        #[expect(clippy::cast_possible_truncation, reason = "shares of harmonics in float32")]
        shares.map(|share| (share / sum) as f32)
    }

    /// The colours of a plane, from the means of its own nodes and of the planes before and behind
    /// it.
    pub(super) fn sharpened(
        &self,
        x: u32,
        own: &NodeColors,
        [before, behind]: [Option<&NodeColors>; 2],
    ) -> NodeColors {
        let Self { voxels, plan, .. } = *self;
        let touching = Touching::find(voxels, plan, x);
        let mut sums = Sums::new(plan, voxels.width());
        let mut difference = vec![0.0; voxels.width()];
        for touch in &touching.large {
            let [low_x, ..] = touch.cube.corner;
            // Other voxels are mostly far from the blur, or are averages themselves.
            if touch.cube.edge != plan.edge {
                continue;
            }
            let planes = match low_x == x {
                true => [Some(own), behind],
                false => [before, Some(own)],
            };
            let shares = self.light(touch.voxel);
            difference.copy_from_slice(voxels.harmonics(touch.voxel));
            let corners = planes.into_iter().zip(shares.chunks_exact(4));
            for (plane, shares) in corners {
                for (node, share) in touch.corners(plan).into_iter().zip(shares) {
                    let values = plane.map(|plane| plane.node(node)).unwrap_or_default();
                    let terms = difference.iter_mut().zip(values);
                    terms.for_each(|(sum, value)| *sum -= share * value);
                }
            }
            touch.nodes(plan, |node, [y, z]| {
                let (count, middle) = touch.eighths([x, y, z], plan.edge);
                let light = density(voxels.raw(touch.voxel, middle));
                sums.add(node, count * self.weight(light), &difference);
            });
        }
        // Nodes with only larger voxels keep their means.
        let mut sharpened = own.clone();
        sums.finish().add_to(&mut sharpened);
        sharpened
    }
}

impl NodeColors {
    /// Adds the numbers to those of the same nodes.
    fn add_to(&self, others: &mut Self) {
        for &node in &self.nodes {
            let slots = [&self.slots, &others.slots].map(|slots| slots.get(node as usize).copied());
            let [Some(slot), Some(other)] = slots else { continue };
            if other == NO_SLOT {
                continue;
            }
            let [from, to] = [slot, other].map(|slot| slot as usize * self.width);
            let from = self.values.get(from..from + self.width).unwrap_or_default();
            let to = others.values.get_mut(to..to + self.width).unwrap_or_default();
            to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
        }
    }
}

/// Weighted sums at nodes.
struct Sums {
    /// The slot of each node.
    slots: Vec<u32>,
    /// Sums of a slot, then its weight.
    sums: Vec<f32>,
    width: usize,
}

impl Sums {
    fn new(plan: &BoxPlan, width: usize) -> Self {
        Self { slots: vec![NO_SLOT; plan.nodes * plan.nodes], sums: Vec::new(), width }
    }

    #[expect(clippy::cast_possible_truncation, reason = "harmonics are float32")]
    fn add(&mut self, node: usize, weight: f64, row: &[f32]) {
        let all = self.width + 1;
        let Some(slot) = self.slots.get_mut(node) else { return };
        if *slot == NO_SLOT {
            *slot = u32::try_from(self.sums.len() / all).unwrap_or(NO_SLOT);
            self.sums.resize(self.sums.len() + all, 0.0);
        }
        let first = *slot as usize * all;
        let Some(sums) = self.sums.get_mut(first..first + all) else { return };
        let weight = weight as f32;
        let Some((of_weight, sums)) = sums.split_last_mut() else { return };
        *of_weight += weight;
        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
    }

    fn finish(self) -> NodeColors {
        let Self { slots, sums, width } = self;
        let rows = sums.chunks_exact(width + 1).filter_map(<[f32]>::split_last);
        let values = rows.flat_map(|(weight, row)| row.iter().map(move |sum| sum / weight));
        let values = values.collect();
        let with_slot = (0u32..).zip(&slots).filter(|(_, slot)| **slot != NO_SLOT);
        let nodes = with_slot.map(|(node, _)| node).collect();
        NodeColors { slots, nodes, values, width }
    }
}
