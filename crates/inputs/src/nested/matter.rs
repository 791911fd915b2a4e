//! The nodes of a box near matter, for models that are slow to evaluate and have no occupancy.
//!
//! One in [`EACH`] sample points is probed, and the surroundings of probes that hit matter are
//! evaluated in full. Probes are the points `(X, Y, Z)`, counted along the box, with
//!
//! ```text
//! X + 3 Y + 5 Z = 0 modulo 8
//! ```
//!
//! Any line of eight points along an axis contains a probe, and so does any ball three points
//! across. An object without a probe is thinner than two points, and shorter than eight along the
//! axes; its parts farther than [`REACH`] points from a hit are lost.

use super::cell::Cell;
use super::world::World;
use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::model::field::Lattice;
use crate::model::grid::{Nodes, row};

/// One in this many points is probed.
const EACH: usize = 8;
/// Radius around a hit, in points, that counts as near.
const REACH: usize = 4;
/// Smaller optical depths between neighbouring nodes count as empty. By default, a bake drops even
/// blocks with a few times as much.
const FAINT: f64 = 5e-4;

/// Rows of bits along z, plane by plane.
#[derive(Debug)]
pub(super) struct Matter(Vec<Vec<u64>>);

impl Matter {
    /// Probes the nodes of a box.
    ///
    /// # Errors
    /// A request to stop.
    pub(super) fn find<W: World>(
        world: &W,
        loaded: &W::Loaded,
        lattice: &Lattice,
        masked: bool,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let Nodes([nx, ny, _]) = lattice.nodes;
        let mut planes = vec![(vec![0; ny * row::words(lattice.nodes)], EACH); nx];
        progress.begin(Step::Views, nx as u64);
        parallel::map_mut(&mut planes, |x, (bits, least)| {
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
            *least = probe(world, loaded, lattice, masked, x, bits);
            progress.advance(Step::Views, 1);
            Ok(())
        })?;
        // Points are closest where cells have the most of them.
        let least = planes.iter().map(|(_, least)| *least).min().unwrap_or(1).max(1);
        let reach = REACH.div_ceil(least);
        let met: Vec<Vec<u64>> =
            planes.into_iter().map(|(bits, _)| across(lattice.nodes, &bits, reach)).collect();
        let near = |x: usize| {
            let mut bits = vec![0; met.first().map_or(0, Vec::len)];
            let around = met.iter().skip(x.saturating_sub(reach)).take(reach + x.min(reach) + 1);
            around.for_each(|other| row::or_into(&mut bits, other));
            bits
        };
        Ok(Self((0..nx).map(near).collect()))
    }

    /// Bytes of a box of this many nodes.
    pub(super) fn bytes(nodes: Nodes) -> u64 {
        let Nodes([nx, ny, _]) = nodes;
        (3 * 8 * nx * ny * row::words(nodes)) as u64
    }

    /// The nodes of a plane.
    pub(super) fn plane(&self, x: usize) -> &[u64] {
        self.0.get(x).map(Vec::as_slice).unwrap_or_default()
    }
}

/// Sets the bits of the nodes of a plane whose probes hit matter. Returns the fewest points along
/// an edge of a cell.
fn probe<W: World>(
    world: &W,
    loaded: &W::Loaded,
    lattice: &Lattice,
    masked: bool,
    x: usize,
    bits: &mut [u64],
) -> usize {
    let Nodes([_, ny, nz]) = lattice.nodes;
    let spacing = lattice.nodes.spacing(&lattice.bounds).into_iter().fold(0.0, f64::max);
    let (mut places, mut positions, mut densities) = (Vec::new(), Vec::new(), Vec::new());
    let mut least = EACH;
    for (y, bits) in (0..ny).zip(bits.chunks_mut(row::words(lattice.nodes))) {
        for z in 0..nz {
            let cell = Cell::of(world, lattice, [x, y, z]);
            least = least.min(cell.count);
            let is_probe = |[i, j, k]: &[usize; 3]| {
                let [x, y, z] = [x * cell.count + i, y * cell.count + j, z * cell.count + k];
                (x + 3 * y + 5 * z) % EACH == 0
            };
            for numbers in cell.numbers(false).filter(is_probe) {
                places.push(z);
                positions.push(cell.point(numbers));
            }
        }
        densities.clear();
        world.densities(loaded, &positions, masked, &mut densities);
        for (z, density) in places.drain(..).zip(&densities) {
            if density * spacing > FAINT {
                row::set(bits, z);
            }
        }
        positions.clear();
    }
    least
}

/// A plane's set with all nodes that are near it along y and z.
fn across(nodes: Nodes, plane: &[u64], reach: usize) -> Vec<u64> {
    let (Nodes([_, ny, nz]), words) = (nodes, row::words(nodes));
    let mut along_z = plane.to_vec();
    for row in along_z.chunks_exact_mut(words) {
        for _ in 0..reach {
            row::or_shifted_up(row);
            row::or_shifted_down(row);
        }
        row::clear_from(row, nz);
    }
    let mut all = vec![0; plane.len()];
    for (y, row) in (0..ny).zip(all.chunks_exact_mut(words)) {
        let around = along_z.chunks_exact(words).skip(y.saturating_sub(reach));
        around.take(reach + y.min(reach) + 1).for_each(|other| row::or_into(row, other));
    }
    all
}
