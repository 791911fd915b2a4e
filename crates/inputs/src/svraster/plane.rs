//! The voxels that touch a plane of a box, and densities at its nodes.
//!
//! A voxel at least as large as the cells around a node gives the node's raw density; of several,
//! the smallest one, which has the node as its own corner. If the voxels around a node are smaller,
//! the density is a mean over the node's cell, which reaches half way to the next nodes. Cells are
//! halved along each axis: an eighth of a cell lies within one voxel, or consists of smaller ones.

use super::density::{EvenDensities, between, density};
use super::even::logit;
use super::loaded::Voxels;
use super::octree::{Cube, Part};
use super::plan::BoxPlan;

/// Nodes of a plane that a voxel touches.
pub(super) struct Touch {
    pub(super) voxel: u32,
    pub(super) cube: Cube,
    /// The first and last node along y and z.
    y: [usize; 2],
    z: [usize; 2],
}

/// A voxel smaller than a cell, and the node of its cell.
pub(super) struct Small {
    pub(super) voxel: u32,
    pub(super) cube: Cube,
    pub(super) node: usize,
}

/// The voxels that touch a plane.
pub(super) struct Touching {
    pub(super) large: Vec<Touch>,
    pub(super) small: Vec<Small>,
}

impl Touching {
    /// For the plane of nodes at this x, in edges of the smallest voxels.
    pub(super) fn find(voxels: &Voxels, plan: &BoxPlan, x: u32) -> Self {
        let mut found = Self { large: Vec::new(), small: Vec::new() };
        found.visit(voxels, plan, x, voxels.tree.root());
        found
    }

    fn visit(&mut self, voxels: &Voxels, plan: &BoxPlan, x: u32, (part, cube): (Part, Cube)) {
        let [low_x, low_y, low_z] = cube.corner;
        let touches = |low: u32, from: u32, to: u32| low <= to && from <= low + cube.edge;
        let (first, last) = (plan.first, plan.last());
        if !(touches(low_x, x, x) && touches(low_y, first, last) && touches(low_z, first, last)) {
            return;
        }
        match part {
            Part::Empty => {}
            Part::Leaf(voxel) => {
                let nodes = |low: u32| {
                    let ends = [low.max(first), (low + cube.edge).min(last)];
                    ends.map(|at| ((at - first) / plan.edge) as usize)
                };
                let (y, z) = (nodes(low_y), nodes(low_z));
                self.large.push(Touch { voxel, cube, y, z });
            }
            Part::Node(node) => {
                for (part, child) in voxels.tree.children(node, cube) {
                    if cube.edge > plan.edge {
                        self.visit(voxels, plan, x, (part, child));
                        continue;
                    }
                    // The node of an eighth is its corner of the cell.
                    let mut at = child.corner;
                    let axes = at.iter_mut().zip(cube.corner);
                    axes.for_each(|(at, low)| *at = if *at > low { low + cube.edge } else { low });
                    let [node_x, node_y, node_z] = at;
                    let within = |at: u32| (first..=last).contains(&at);
                    if node_x == x && within(node_y) && within(node_z) {
                        let node = [node_y, node_z].map(|at| ((at - first) / plan.edge) as usize);
                        let [y, z] = node;
                        self.gather(voxels, y * plan.nodes + z, (part, child));
                    }
                }
            }
        }
    }

    fn gather(&mut self, voxels: &Voxels, node: usize, (part, cube): (Part, Cube)) {
        match part {
            Part::Empty => {}
            Part::Leaf(voxel) => self.small.push(Small { voxel, cube, node }),
            Part::Node(number) => {
                for child in voxels.tree.children(number, cube) {
                    self.gather(voxels, node, child);
                }
            }
        }
    }
}

/// The share of a voxel's edge at a place, 0 to 1.
fn share(low: u32, edge: u32, at: f64) -> f64 {
    ((at - f64::from(low)) / f64::from(edge)).clamp(0.0, 1.0)
}

impl Touch {
    /// Calls `visit` with each node and its place in edges of the smallest voxels.
    pub(super) fn nodes(&self, plan: &BoxPlan, mut visit: impl FnMut(usize, [u32; 2])) {
        let ([low_y, high_y], [low_z, high_z]) = (self.y, self.z);
        let [mut at_y, first_z] =
            [low_y, low_z].map(|node| plan.first + u32::try_from(node).unwrap_or(0) * plan.edge);
        for y in low_y..=high_y {
            let mut at_z = first_z;
            for z in low_z..=high_z {
                visit(y * plan.nodes + z, [at_y, at_z]);
                at_z += plan.edge;
            }
            at_y += plan.edge;
        }
    }

    /// The nodes at the corners of a voxel as large as a cell.
    pub(super) fn corners(&self, plan: &BoxPlan) -> [usize; 4] {
        let ([low_y, high_y], [low_z, high_z]) = (self.y, self.z);
        let node = |y: usize, z: usize| y * plan.nodes + z;
        [node(low_y, low_z), node(low_y, high_z), node(high_y, low_z), node(high_y, high_z)]
    }

    /// The eighths of a node's cell in the voxel, and the place of one of them.
    pub(super) fn eighths(&self, at: [u32; 3], edge: u32) -> (f64, [f64; 3]) {
        let (mut count, mut middle) = (1.0, [0.0; 3]);
        let quarter = 0.25 * f64::from(edge);
        for ((middle, at), low) in middle.iter_mut().zip(at).zip(self.cube.corner) {
            let inward = match at {
                _ if at == low => 1.0,
                _ if at == low + self.cube.edge => -1.0,
                _ => {
                    count *= 2.0;
                    0.0
                }
            };
            *middle = share(low, self.cube.edge, f64::from(at) + inward * quarter);
        }
        (count, middle)
    }
}

/// Passes logits of densities at the nodes of a plane that voxels touch to `out`.
pub(super) fn densities(
    voxels: &Voxels,
    even: &EvenDensities,
    plan: &BoxPlan,
    x: u32,
    mut out: impl FnMut(usize, f64),
) {
    let touching = Touching::find(voxels, plan, x);
    let count = plan.nodes * plan.nodes;
    let means = (!touching.small.is_empty()).then(|| means(voxels, even, plan, x, &touching));
    let is_mean = |node: usize| {
        let means = means.as_ref();
        means.and_then(|means| means.get(node)).is_some_and(|mean| *mean >= 0.0)
    };
    // Edges of the voxels that gave nodes their values.
    let mut smallest = vec![u32::MAX; count];
    for touch in &touching.large {
        let [low_x, low_y, low_z] = touch.cube.corner;
        let edge = touch.cube.edge;
        let corners = voxels.at_corners(&even.logits, touch.voxel);
        let share_x = share(low_x, edge, f64::from(x));
        touch.nodes(plan, |node, [y, z]| {
            let Some(smallest) = smallest.get_mut(node).filter(|own| edge < **own) else { return };
            *smallest = edge;
            if !is_mean(node) {
                let shares = [share_x, share(low_y, edge, y.into()), share(low_z, edge, z.into())];
                out(node, between(&corners, shares));
            }
        });
    }
    let means = means.into_iter().flatten().enumerate();
    means.filter(|(_, mean)| *mean >= 0.0).for_each(|(node, mean)| out(node, logit(mean).into()));
}

/// Mean densities at nodes with small voxels; -1 at all others.
fn means(
    voxels: &Voxels,
    even: &EvenDensities,
    plan: &BoxPlan,
    x: u32,
    touching: &Touching,
) -> Vec<f64> {
    let mut means: Vec<f64> = vec![-1.0; plan.nodes * plan.nodes];
    for small in &touching.small {
        let volume = f64::from(small.cube.edge) / f64::from(plan.edge);
        let own = volume * volume * volume * even.mean(small.voxel);
        if let Some(mean) = means.get_mut(small.node) {
            *mean = mean.max(0.0) + own;
        }
    }
    for touch in &touching.large {
        touch.nodes(plan, |node, [y, z]| {
            let Some(mean) = means.get_mut(node).filter(|mean| **mean >= 0.0) else { return };
            let (count, middle) = touch.eighths([x, y, z], plan.edge);
            *mean += count / 8.0 * density(voxels.raw(touch.voxel, middle));
        });
    }
    means
}
