//! Small connected parts of level 0 that become empty: floaters.
//!
//! A node is visible if its opacity is above the threshold by which blocks were dropped. Visible
//! nodes are connected if they differ by at most one along each axis. A part with too few nodes is
//! emptied with the faint nodes around it. Nodes around a part that stays keep their values: they
//! shape its surface.
//!
//! A node of a coarser level is emptied if its average includes nodes of emptied parts and none of
//! the remaining parts. So an emptied part close to another one stays in the coarser levels that
//! cannot resolve both.

use super::blocks::keep_blocks;
use crate::bake::report::IslandReport;
use crate::base::error::Result;
use crate::levels::{Filter, Kernel, LevelFilter, RequiredNodes};
use crate::model::baked::{DensityDomain, Group, StepRule};
use crate::model::grid::{NodeMask, Nodes, row};
use crate::unpacked::Unpacked;

/// Empties the parts with fewer than `fewest` nodes, at every level.
///
/// # Errors
///
/// Errors of reading level 0.
pub fn drop_islands(unpacked: &mut Unpacked, fewest: u64) -> Result<IslandReport> {
    let visible = visible_nodes(unpacked, 0)?;
    let parts = Parts::of(&visible);
    let [kept, islands] = parts.split(fewest);
    let report = IslandReport {
        components: parts.sizes.iter().filter(|&&size| size > 0).count() as u64,
        dropped: parts.sizes.iter().filter(|&&size| size > 0 && size < fewest).count() as u64,
        nodes: islands.count(),
    };
    if report.dropped == 0 {
        return Ok(report);
    }
    let levels = unpacked.levels.iter().map(|level| level.table.grid().nodes);
    let sizes: Vec<Nodes> = levels.collect();
    // The widest kernel, if the filter's is unknown.
    let weights = unpacked.metadata.filter.parse::<Filter>();
    let weights = weights.map_or_else(|_| Kernel::Mean7.weights(), |filter| filter.weights());
    let mut emptied = vec![around(&islands)?];
    emptied[0].intersect(&around(&kept)?.complement());
    let reached = |mask: NodeMask| RequiredNodes::of_occupied(mask, &sizes, &weights);
    let (from_kept, from_islands) = (reached(kept)?, reached(islands)?);
    for (kept, islands) in from_kept.levels().iter().zip(from_islands.levels()).skip(1) {
        let mut alone = islands.clone();
        alone.intersect(&kept.complement());
        emptied.push(alone);
    }
    for (number, emptied) in emptied.into_iter().enumerate() {
        if unpacked.metadata.levels[number].density.is_none() {
            continue;
        }
        let grid = unpacked.levels[number].table.grid();
        // Blocks hold the nodes around visible ones too.
        let touched = around(&emptied)?.blocks(grid.edge)?;
        unpacked.levels[number].emptied = Some(emptied);
        let needed = around(&visible_nodes(unpacked, number)?)?.blocks(grid.edge)?;
        let [_, rows, length] = grid.counts();
        keep_blocks(unpacked, number, |[i, j, k]| {
            let block = (i * rows + j) * length + k;
            needed[block] || !touched[block]
        })?;
    }
    Ok(report)
}

/// The nodes of a set, and those next to one.
fn around(nodes: &NodeMask) -> Result<NodeMask> {
    nodes.cells_with_a_corner()?.corners()
}

/// The nodes of a level whose opacity is above the threshold by which blocks were dropped.
fn visible_nodes(unpacked: &Unpacked, number: usize) -> Result<NodeMask> {
    let (metadata, level) = (&unpacked.metadata, &unpacked.levels[number]);
    let nodes = level.table.grid().nodes;
    let Some(density) = &metadata.levels[number].density else {
        return Ok(NodeMask::empty(nodes));
    };
    let intervals = match metadata.step_rule {
        StepRule::Constant => 1.0,
        StepRule::LevelOfDetail => libm::exp2(number as f64),
    };
    let depth = -libm::log1p(-f64::from(metadata.alpha_threshold)) / intervals;
    let opacity = -libm::expm1(-depth);
    let activation = &metadata.activation;
    let least = match density.decode.density() {
        Some(DensityDomain::SqrtOpticalDepth) => depth.sqrt(),
        Some(DensityDomain::Opacity) => opacity,
        _ => activation.raw_at_opacity(opacity),
    };
    let [_, ny, nz] = nodes.0;
    let words = row::words(nodes);
    NodeMask::of_planes(nodes, |x, rows| {
        let mut values = vec![0.0; ny * nz];
        level.read_plane((Group::Density, 0), x, density.empty, &mut values)?;
        for (values, row) in values.chunks_exact(nz).zip(rows.chunks_exact_mut(words)) {
            row::pack_above(values, least as f32, row);
        }
        Ok(())
    })
}

/// Bit runs of a set along z, and the part that each belongs to.
struct Parts {
    nodes: Nodes,
    /// Place of the row, start and end along z.
    runs: Vec<([usize; 2], usize, usize)>,
    /// Union-find parent: another run of the same part, or the run itself.
    parent: Vec<usize>,
    /// Nodes of the part, at its root run; 0 at other runs.
    sizes: Vec<u64>,
}

impl Parts {
    fn of(visible: &NodeMask) -> Self {
        let nodes = visible.nodes();
        let [nx, ny, _] = nodes.0;
        let mut parts = Self { nodes, runs: Vec::new(), parent: Vec::new(), sizes: Vec::new() };
        // The first run of each row, and the end of the last one.
        let mut starts = Vec::with_capacity(nx * ny + 1);
        for (x, y) in (0..nx).flat_map(|x| (0..ny).map(move |y| (x, y))) {
            let first = parts.runs.len();
            starts.push(first);
            for (start, end) in row::runs(visible.row(x, y)) {
                parts.parent.push(parts.runs.len());
                parts.runs.push(([x, y], start, end));
            }
            let before = [(1, -1), (1, 0), (1, 1), (0, -1)];
            for (back, aside) in before {
                let Some(other_x) = x.checked_sub(back) else { continue };
                let Some(other_y) = y.checked_add_signed(aside).filter(|&y| y < ny) else {
                    continue;
                };
                let row = other_x * ny + other_y;
                let others = starts[row]..starts.get(row + 1).copied().unwrap_or(first);
                parts.join(first..parts.runs.len(), others);
            }
        }
        parts.sizes = vec![0; parts.runs.len()];
        for run in 0..parts.runs.len() {
            let (_, start, end) = parts.runs[run];
            let root = parts.root(run);
            parts.sizes[root] += (end - start) as u64;
        }
        parts
    }

    /// Joins the runs of two neighbouring rows that touch, along edges and corners too.
    fn join(&mut self, own: std::ops::Range<usize>, others: std::ops::Range<usize>) {
        let (mut a, mut b) = (own.start, others.start);
        while a < own.end && b < others.end {
            let ((_, start, end), (_, other_start, other_end)) = (self.runs[a], self.runs[b]);
            if start <= other_end && other_start <= end {
                let (a, b) = (self.root(a), self.root(b));
                self.parent[a.max(b)] = a.min(b);
            }
            if end < other_end {
                a += 1;
            } else {
                b += 1;
            }
        }
    }

    fn root(&mut self, mut run: usize) -> usize {
        while self.parent[run] != run {
            self.parent[run] = self.parent[self.parent[run]];
            run = self.parent[run];
        }
        run
    }

    /// The nodes of parts with at least `fewest` nodes, and those of the others.
    fn split(&self, fewest: u64) -> [NodeMask; 2] {
        let mut sets = [NodeMask::empty(self.nodes), NodeMask::empty(self.nodes)];
        let words = row::words(self.nodes);
        for (run, &([x, y], start, end)) in self.runs.iter().enumerate() {
            let mut root = run;
            while self.parent[root] != root {
                root = self.parent[root];
            }
            let set = &mut sets[usize::from(self.sizes[root] < fewest)];
            row::set_between(&mut set.plane_mut(x)[y * words..][..words], start, end);
        }
        sets
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_touch_at_faces_edges_and_corners() {
        let at = |nodes: &[[usize; 3]]| {
            let mut mask = NodeMask::empty(Nodes([5, 6, 70]));
            nodes.iter().for_each(|&node| mask.insert(node));
            mask
        };
        // A chain over corners around a word's border, a pair, and one alone.
        let chain = [[0, 1, 62], [1, 2, 63], [2, 1, 64], [3, 0, 65]];
        let pair = [[0, 5, 3], [0, 5, 4]];
        let all = [&chain[..], &pair, &[[4, 5, 69]]].concat();
        let parts = Parts::of(&at(&all));
        let mut sizes: Vec<u64> = parts.sizes.iter().copied().filter(|&size| size > 0).collect();
        sizes.sort_unstable();
        assert_eq!(sizes, [1, 2, 4]);
        let [kept, islands] = parts.split(3);
        assert_eq!(kept, at(&chain));
        assert_eq!(islands, at(&all[4..]));
    }
}
