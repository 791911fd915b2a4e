//! Colours of a model at the nodes of a box, along directions.

use std::sync::Arc;

use super::cell::points;
use super::world::ColoredWorld;
use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::model::field::Lattice;
use crate::model::grid::Nodes;
use crate::network::{Colors, NodeColors, OnNode, visit};

/// Nodes that are prepared at once.
const AT_ONCE: usize = 32;
/// Maximum points of a node whose colours are evaluated.
const MOST_COLORS: usize = 4;
/// Points that absorb a smaller share of the light than this add no colour.
const FAINT: f64 = 0.02;

/// The colours of a model at the nodes of a box.
#[derive(Debug)]
pub(super) struct SampledColors<W> {
    pub(super) world: Arc<W>,
    pub(super) lattice: Lattice,
}

/// The points whose mean is a node's colour, with their weights: the light that they absorb over an
/// edge of the cell, from their optical depths per world unit.
fn shares(densities: &[f64], spacing: f64) -> Vec<(usize, f64)> {
    let edge = spacing / libm::cbrt(densities.len() as f64);
    let stopped = densities.iter().map(|density| -libm::expm1(-density * edge));
    let stopped: Vec<f64> = stopped.collect();
    let all: f64 = stopped.iter().sum();
    let shown = stopped.into_iter().enumerate().filter(|(_, share)| *share > FAINT * all);
    let shown: Vec<_> = shown.collect();
    let sum: f64 = shown.iter().map(|(_, share)| share).sum();
    match sum > 0.0 {
        true if shown.len() > MOST_COLORS => chosen(&shown, sum),
        true => shown.into_iter().map(|(point, share)| (point, share / sum)).collect(),
        // The node is empty, but its colour counts between it and its neighbours.
        false => vec![(0, 1.0)],
    }
}

/// A few of many points, each representing an equal part of the light in the order of the points.
fn chosen(shown: &[(usize, f64)], sum: f64) -> Vec<(usize, f64)> {
    let each = sum / MOST_COLORS as f64;
    let (mut passed, mut next) = (0.0, 0.5 * each);
    let mut found = Vec::with_capacity(MOST_COLORS);
    for (point, share) in shown {
        passed += share;
        let mut parts = 0.0;
        while next < passed && found.len() < MOST_COLORS {
            (parts, next) = (parts + 1.0, next + each);
            if parts > 1.0 {
                found.pop();
            }
            found.push((*point, parts));
        }
    }
    let all: f64 = found.iter().map(|(_, parts)| parts).sum();
    found.iter_mut().for_each(|(_, parts)| *parts /= all);
    found
}

impl<W: ColoredWorld> NodeColors for SampledColors<W> {
    type Network = W::Loaded;
    type Along = W::Along;

    fn nodes(&self) -> Nodes {
        self.lattice.nodes
    }

    fn memory_bytes(&self, _: usize) -> [u64; 2] {
        // The digest of density covers the model.
        [0; 2]
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.world.digest(hash)
    }

    fn load(&self, _: &dyn Progress) -> Result<Arc<W::Loaded>> {
        self.world.load()
    }

    fn along(&self, loaded: &W::Loaded, directions: &[[f64; 3]]) -> W::Along {
        self.world.along(loaded, directions)
    }

    fn visit(
        &self,
        loaded: &W::Loaded,
        x: usize,
        region: &[u64],
        on_node: OnNode<'_, W::Along>,
    ) -> Result<()> {
        let spacing = self.lattice.nodes.spacing(&self.lattice.bounds);
        let spacing = spacing.into_iter().fold(0.0, f64::max);
        let mut of_point: Colors = Colors::default();
        let (mut found, mut densities) = (W::Places::default(), Vec::new());
        let mut next = Group::default();
        let mut show = |group: &mut Group| {
            densities.clear();
            self.world.places(loaded, &group.points, &mut found, &mut densities);
            let mut first = 0;
            for (node, count) in group.nodes.drain(..) {
                let own = densities.get(first..first + count).unwrap_or_default();
                let shares = shares(own, spacing);
                on_node(node, &mut |along, colors| {
                    colors.iter_mut().for_each(Vec::clear);
                    for (point, share) in &shares {
                        let number = first + point;
                        self.world.colors(loaded, along, &mut found, number, &mut of_point);
                        for (sums, found) in colors.iter_mut().zip(&of_point) {
                            sums.resize(found.len(), 0.0);
                            let terms = sums.iter_mut().zip(found);
                            terms.for_each(|(sum, color)| *sum += share * color);
                        }
                    }
                });
                first += count;
            }
            group.points.clear();
        };
        visit(self.lattice.nodes, region, |[y, z]| {
            let points = points(&*self.world, &self.lattice, [x, y, z], true);
            next.nodes.push(([y, z], points.len()));
            next.points.extend(points);
            if next.nodes.len() == AT_ONCE {
                show(&mut next);
            }
        });
        show(&mut next);
        Ok(())
    }
}

/// Nodes whose points are prepared together.
#[derive(Debug, Default)]
struct Group {
    /// Each with the number of its points.
    nodes: Vec<([usize; 2], usize)>,
    points: Vec<[f64; 3]>,
}
