//! Harmonics at nodes, fitted to a network at points between them.
//!
//! A network is not linear between nodes, and a training only ever mixed a node's features with
//! those of its neighbours: the colour at the very node says little. So the harmonics are found at
//! [`POINTS`] of each visible cell, and nodes take those whose interpolation comes closest, by the
//! equations of [`super::projection`]. A point weighs as much as a step there stops of the light.
//!
//! That asks the network eight times a cell. It is only done where a few cells show that nodes alone
//! are too far off; and nodes without such points keep the fit of their own.

use std::fmt::Debug;

use super::fitted::{Channels, Colors, FindColors, FittedColors, NodeColors, RowCells, without};
use super::node_set::{NodeSet, corner_shares, corners};
use super::planes::visit;
use super::projection::{Equations, Slab};
use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Silent, Step};
use crate::lazy::Lazy;
use crate::model::field::{NodeValues, Nonfinite, Planes};
use crate::model::grid::{NodeMask, Nodes, row};

/// Points of a cell, in its edges.
const POINTS: [[f64; 3]; 8] = all_of(0.25, 0.75);
/// Corners of a cell.
const CORNERS: [[f64; 3]; 8] = all_of(0.0, 1.0);
/// Points that stop a smaller part of the light of a step do not count.
const FAINT: f64 = 0.01;
/// Mean square error of colours above which points between nodes are fitted: 42 dB.
const UNEVEN: f64 = 6e-5;
/// Planes of cells that are looked at first, and cells of each.
const LOOKS: [usize; 2] = [16, 32];
/// Slabs that are in memory at once.
const AT_ONCE: usize = 8;
/// Bytes of the equations, at most; beyond, nodes keep the fit of their own.
const MOST_BYTES: u64 = 768 << 20;

const fn all_of(low: f64, high: f64) -> [[f64; 3]; 8] {
    let (a, b) = (low, high);
    [[a, a, a], [a, a, b], [a, b, a], [a, b, b], [b, a, a], [b, a, b], [b, b, a], [b, b, b]]
}

/// Sees a point of a cell: the cell's lowest node `(y, z)`, and the number of the point.
pub type OnPoint<'a, Along> = &'a mut dyn FnMut([usize; 2], usize, FindColors<'_, Along>);

/// Colours that a network gives all points of a grid.
pub trait PointColors: NodeColors {
    /// Shows the points at `offsets`, in edges of a cell, of cells between planes `x` and `x + 1`:
    /// the bits of their lowest nodes, rows along z. All points of a cell follow each other.
    ///
    /// # Errors
    /// Those of reading.
    fn visit_points(
        &self,
        network: &Self::Network,
        x: usize,
        cells: &[u64],
        offsets: &[[f64; 3]],
        on_point: OnPoint<'_, Self::Along>,
    ) -> Result<()>;
}

/// The harmonics of colours.
#[derive(Debug)]
pub struct ProjectedColors<N: PointColors> {
    nodal: FittedColors<N>,
    solved: Lazy<Option<Solved>>,
}

/// Nodes whose values are known.
#[derive(Debug)]
struct Solved {
    set: NodeSet,
    /// The nodes that points decide on, plane by plane.
    decided: Vec<Vec<u64>>,
    /// Channel by channel, nodes in the order of the set.
    values: Vec<f32>,
}

/// A point of a cell at which something is seen.
struct Point<'a> {
    cell: [usize; 2],
    number: usize,
    /// The part of a step's light that is stopped there.
    weight: f64,
    channels: &'a Channels,
}

impl<N: PointColors> ProjectedColors<N> {
    /// Of a fit at nodes, which stays where there are no points.
    pub fn new(nodal: FittedColors<N>) -> Self {
        Self { nodal, solved: Lazy::default() }
    }

    fn solve(&self, progress: &dyn Progress) -> Result<Option<Solved>> {
        let (nodal, nodes, channels) = (&self.nodal, self.nodes(), self.channels());
        nodal.prepared(progress)?;
        let Nodes([nx, ..]) = nodes;
        let full = NodeMask::full(nodes);
        let visible = |x| nodal.visible.within(&nodal.geometry, x, full.plane(x));
        let set = NodeSet::new(nodes, parallel::map(nx, visible)?);
        let bytes = set.count() as u64 * Equations::bytes_of_node(channels);
        if bytes > MOST_BYTES || !self.is_uneven(&set)? {
            return Ok(None);
        }
        let mut equations = Equations::new(&set, nodes, channels, &nodal.limits)?;
        progress.begin(Step::Colors, (nx - 1) as u64);
        for first in (0..nx - 1).step_by(AT_ONCE) {
            let count = AT_ONCE.min(nx - 1 - first);
            let slabs = parallel::map(count, |number| {
                let slab = self.slab(&set, first + number);
                progress.advance(Step::Colors, 1);
                if progress.cancelled() { Err(Error::cancelled()) } else { slab }
            })?;
            slabs.iter().for_each(|slab| equations.add(slab));
        }
        let (values, has_points) = equations.solve()?;
        let mut decided = Vec::new();
        for x in 0..nx {
            let mut bits = vec![0; full.plane(x).len()];
            let mut numbers = set.start(x)..;
            set.visit(x, |[y, z]| {
                let has = numbers.next().and_then(|at| has_points.get(at)).copied();
                if let Some(row) =
                    bits.get_mut(y * row::words(nodes)..).filter(|_| has == Some(true))
                {
                    row::set(row, z);
                }
            });
            decided.push(bits);
        }
        Ok(Some(Solved { set, decided, values }))
    }

    /// The sums over the points between planes `x` and `x + 1`.
    #[expect(clippy::cast_possible_truncation, reason = "shares and weights are float32")]
    fn slab(&self, set: &NodeSet, x: usize) -> Result<Slab> {
        let channels = self.channels();
        let mut slab = Slab::new(set, x, channels);
        let shares = POINTS.map(|at| corner_shares(at).map(|share| share as f32));
        let (mut own, mut numbers) = (None, [0; 8]);
        self.look(x, &set.cells(x), &POINTS, &mut |point| {
            let [y, z] = point.cell;
            if own != Some(point.cell) {
                own = Some(point.cell);
                for (corner, number) in numbers.iter_mut().enumerate() {
                    let at = [x + (corner >> 2), y + (corner >> 1 & 1), z + (corner & 1)];
                    *number = set.number(at).unwrap_or_default();
                }
            }
            let values = point.channels.iter().take(channels).copied();
            if let Some(shares) = shares.get(point.number) {
                slab.add(&numbers, shares, point.weight as f32, values);
            }
        })?;
        Ok(slab)
    }

    /// True if colours between nodes are far from those that nodes alone give.
    fn is_uneven(&self, set: &NodeSet) -> Result<bool> {
        let (nodes, [planes, cells]) = (self.nodes(), LOOKS);
        let (Nodes([nx, ..]), channels) = (nodes, self.channels());
        let offsets: Vec<[f64; 3]> = CORNERS.into_iter().chain(POINTS).collect();
        let sums = parallel::map(planes.min(nx - 1), |number| {
            let x = number * (nx - 1) / planes.min(nx - 1);
            let some = some_of(nodes, &set.cells(x), cells);
            let (mut corners, mut sums) = ([[0.0; size_of::<Channels>() / 4]; 8], [0.0; 2]);
            self.look(x, &some, &offsets, &mut |point| {
                if let Some(corner) = corners.get_mut(point.number) {
                    *corner = *point.channels;
                    return;
                }
                let Some(&at) = offsets.get(point.number) else { return };
                let shares = corner_shares(at);
                let off = (0..channels).map(|channel| {
                    let of =
                        |values: &Channels| values.get(channel).copied().map_or(0.0, f64::from);
                    let terms = corners.iter().zip(shares);
                    let between: f64 = terms.map(|(corner, share)| share * of(corner)).sum();
                    (between - of(point.channels)).powi(2)
                });
                sums[0] += point.weight * off.sum::<f64>();
                sums[1] += point.weight;
            })?;
            Ok(sums)
        })?;
        let total = sums.into_iter().fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
        // Squares of coefficients are means over the sphere, by its area; plain colours are themselves.
        let scale = if channels == 3 { 1.0 } else { 0.25 * std::f64::consts::FRAC_1_PI };
        Ok(total[1] > 0.0 && scale * total[0] / (3.0 * total[1]) > UNEVEN)
    }

    /// Shows the points of some cells between planes `x` and `x + 1` at which something is seen, and
    /// all corners of these cells.
    fn look(
        &self,
        x: usize,
        cells: &[u64],
        offsets: &[[f64; 3]],
        on_point: &mut dyn FnMut(Point<'_>),
    ) -> Result<()> {
        if cells.iter().all(|word| *word == 0) {
            return Ok(());
        }
        let nodal = &self.nodal;
        let prepared = nodal.prepared(&Silent)?;
        let (scene, mask) = (&nodal.geometry.scene, nodal.geometry.free_space.as_ref());
        let Nodes([_, ny, nz]) = scene.nodes;
        let spacing = scene.nodes.spacing(&scene.bounds);
        let region = corners(scene.nodes, cells);
        let planes = Planes::new(&nodal.geometry, None, Nonfinite::Empty);
        let mut raw = [vec![0.0; ny * nz], vec![0.0; ny * nz]];
        for (out, x) in raw.iter_mut().zip(x..) {
            planes.read(0, x, &region, out, false)?;
        }
        let (mut row_cells, mut colors) = (RowCells::default(), Colors::default());
        let shares: Vec<[f64; 8]> = offsets.iter().map(|&at| corner_shares(at)).collect();
        nodal.colors.visit_points(
            &prepared.network,
            x,
            cells,
            offsets,
            &mut |cell, number, find| {
                let ([y, z], Some(offset), Some(shares)) =
                    (cell, offsets.get(number), shares.get(number))
                else {
                    return;
                };
                let at = prepared.cells.cell([x, y, z]);
                if prepared.cells.is_hidden(at) {
                    return;
                }
                let is_corner = CORNERS.contains(offset);
                let density = shares.iter().enumerate().map(|(corner, share)| {
                    let node = (y + (corner >> 1 & 1)) * nz + z + (corner & 1);
                    let plane = raw.get(corner >> 2).map_or(&[][..], Vec::as_slice);
                    share * plane.get(node).copied().map_or(0.0, f64::from)
                });
                let weight = scene.activation.opacity(density.sum());
                let mut world = scene.bounds.min.map(f64::from);
                let axes = world.iter_mut().zip([x, y, z]).zip(offset).zip(spacing);
                axes.for_each(|(((at, node), by), spacing)| *at += (node as f64 + by) * spacing);
                let is_seen = weight > FAINT && mask.is_none_or(|mask| mask.contains(world));
                if !is_corner && !is_seen {
                    return;
                }
                let Some(own) = row_cells.at(at, || nodal.cell(&prepared, at)) else { return };
                find(&own.along, &mut colors);
                let channels = &nodal.channels_of(own, &mut colors);
                on_point(Point { cell, number, weight, channels });
            },
        )
    }

    fn fill(&self, x: usize, region: &[u64], values: &mut [f32]) -> Result<()> {
        let solved = self.solved.get(|| self.solve(&Silent))?;
        let Some(Solved { set, decided, values: known }) = &*solved else {
            return self.nodal.fill(x, region, values);
        };
        let decided = decided.get(x).map_or(&[][..], Vec::as_slice);
        self.nodal.fill(x, &without(region, decided), values)?;
        let (Nodes([_, ny, nz]), count) = (self.nodes(), set.count());
        let own: Vec<u64> = region.iter().zip(decided).map(|(a, b)| a & b).collect();
        visit(self.nodes(), &own, |[y, z]| {
            let Some(number) = set.number([x, y, z]) else { return };
            let known = known.iter().skip(number).step_by(count);
            let out = values.iter_mut().skip(y * nz + z).step_by(ny * nz);
            out.zip(known).for_each(|(out, value)| *out = *value);
        });
        Ok(())
    }
}

/// At most so many of a plane's bits, spread over it.
fn some_of(nodes: Nodes, bits: &[u64], most: usize) -> Vec<u64> {
    let (words, mut number, mut some) = (row::words(nodes), 0, vec![0; bits.len()]);
    let all: usize = bits.iter().map(|word| word.count_ones() as usize).sum();
    let step = all.div_ceil(most).max(1);
    visit(nodes, bits, |[y, z]| {
        if number % step == step / 2
            && let Some(row) = some.get_mut(y * words..)
        {
            row::set(row, z);
        }
        number += 1;
    });
    some
}

impl<N: PointColors> NodeValues for ProjectedColors<N> {
    fn nodes(&self) -> Nodes {
        self.nodal.nodes()
    }

    fn channels(&self) -> usize {
        self.nodal.channels()
    }

    fn memory_bytes(&self) -> u64 {
        let Nodes(counts) = self.nodes();
        let all = counts.into_iter().fold(1, |all, count| all * count as u64);
        let equations = all.saturating_mul(Equations::bytes_of_node(self.channels()));
        self.nodal.memory_bytes() + equations.min(MOST_BYTES)
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.nodal.digest(hash)
    }

    fn prepare(&self, progress: &dyn Progress) -> Result<()> {
        self.solved.get(|| self.solve(progress)).map(drop)
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let channels = [channel, self.channels()];
        // Before the plane is locked.
        self.prepare(&Silent)?;
        self.nodal.planes.read(self.nodes(), x, channels, region, out, |missing, values| {
            self.fill(x, missing, values)
        })?;
        Ok(0)
    }
}
