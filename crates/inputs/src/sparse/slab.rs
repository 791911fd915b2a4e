//! Slabs of a few planes of rows, and a cache of the most recent ones.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::{Arc, Mutex};

use super::array::RowArray;
use super::index::{Index, NO_ROW};
use crate::base::error::Result;
use crate::base::lock::lock;
use crate::model::grid::Element;

/// Planes of a slab, at most: rows in Morton order then lie together.
const PLANES: usize = 8;
/// Bytes of a slab, at most, unless one plane is larger.
const SLAB_BYTES: usize = 80 << 20;
/// Maximum bytes of cached slabs, beside the last two.
const KEPT_BYTES: u64 = 160 << 20;

/// The rows of the nodes of one plane.
#[derive(Debug, Default)]
pub(super) struct Plane {
    /// Nodes that have a row, ascending, `y * nz + z`; empty if `is_full`.
    pub(super) nodes: Vec<u32>,
    /// True if every node has a row.
    pub(super) is_full: bool,
    /// The rows as stored, in the order of nodes.
    pub(super) rows: Vec<u8>,
}

/// Consecutive planes.
#[derive(Debug)]
struct Slab {
    planes: Vec<Plane>,
}

impl Slab {
    fn bytes(&self) -> u64 {
        let planes = self.planes.iter().map(|plane| plane.rows.len() + 4 * plane.nodes.len());
        planes.sum::<usize>() as u64
    }
}

/// A slab; one thread fills it while others wait.
type Slot = Arc<Mutex<Option<Arc<Slab>>>>;

/// A cached slab: its number, and its bytes once filled.
#[derive(Debug)]
struct Kept {
    number: usize,
    slot: Slot,
    bytes: u64,
}

/// The most recently used slabs.
#[derive(Debug)]
pub(super) struct Slabs {
    planes: usize,
    /// Maximum bytes of a plane, with a row at each node.
    plane_bytes: usize,
    /// True if nodes without a row take the mean of their neighbours' rows.
    dilates: bool,
    kept: Mutex<VecDeque<Kept>>,
}

impl Slabs {
    pub(super) fn new(index: &Index, array: &RowArray, dilates: bool) -> Self {
        let [_, ny, nz] = index.nodes().0;
        let dilates = dilates && !index.is_dense();
        // Dilated rows are float32.
        let row_bytes = if dilates { 4 * array.width() } else { array.row_bytes() };
        let plane_bytes = (ny * nz).saturating_mul(row_bytes + 4).max(1);
        // A power of 2, to match Morton order.
        let planes = 1 << (SLAB_BYTES / plane_bytes).clamp(1, PLANES).ilog2();
        Self { planes, plane_bytes, dilates, kept: Mutex::default() }
    }

    /// The values of a column of a plane's rows.
    pub(super) fn column(&self, array: &RowArray, rows: &[u8], column: usize, out: &mut Vec<f32>) {
        match self.dilates {
            true => Element::F32.decode_column(rows, 4 * array.width(), 4 * column, out),
            false => array.decode_column(column, rows, out),
        }
    }

    /// Bytes of all that is kept, at most.
    pub(super) fn memory_bytes(&self, index: &Index) -> u64 {
        let plane_bytes = self.plane_bytes as u64;
        let slab = self.planes as u64 * plane_bytes;
        // One more while the oldest is still in use.
        KEPT_BYTES.max(2 * slab).min(plane_bytes * index.nodes().0[0] as u64) + slab
    }

    /// Clears the cache.
    pub(super) fn release(&self) {
        lock(&self.kept).clear();
    }

    /// Calls `take` with plane `x`, and returns the bytes that were read for it.
    pub(super) fn with_plane(
        &self,
        index: &Index,
        array: &RowArray,
        x: usize,
        take: impl FnOnce(&Plane),
    ) -> Result<u64> {
        let number = x / self.planes;
        let slot = self.slot(number);
        let mut filled = lock(&slot);
        let mut read = 0;
        let slab = match &*filled {
            Some(slab) => Arc::clone(slab),
            None => {
                let (slab, bytes) = self.fill(index, array, number)?;
                read = bytes;
                self.filled(number, slab.bytes());
                let slab = Arc::new(slab);
                *filled = Some(Arc::clone(&slab));
                slab
            }
        };
        drop(filled);
        if let Some(plane) = slab.planes.get(x % self.planes) {
            take(plane);
        }
        Ok(read)
    }

    fn slot(&self, number: usize) -> Slot {
        let mut kept = lock(&self.kept);
        let found = kept.iter().position(|own| own.number == number);
        let own = found.and_then(|at| kept.remove(at));
        let own = own.unwrap_or_else(|| Kept { number, slot: Slot::default(), bytes: 0 });
        let slot = Arc::clone(&own.slot);
        kept.push_back(own);
        slot
    }

    /// Records the bytes of a slab, and evicts the least recently used ones.
    fn filled(&self, number: usize, bytes: u64) {
        let mut kept = lock(&self.kept);
        if let Some(own) = kept.iter_mut().find(|own| own.number == number) {
            own.bytes = bytes;
        }
        while kept.len() > 2 && kept.iter().map(|own| own.bytes).sum::<u64>() > KEPT_BYTES {
            kept.pop_front();
        }
    }

    fn fill(&self, index: &Index, array: &RowArray, number: usize) -> Result<(Slab, u64)> {
        let first = number * self.planes;
        let end = (first + self.planes).min(index.nodes().0[0]);
        if !self.dilates {
            let (planes, read) = planes(index, array, first..end)?;
            return Ok((Slab { planes }, read));
        }
        let before = first.saturating_sub(1);
        let (planes, read) = planes(index, array, before..(end + 1).min(index.nodes().0[0]))?;
        let [_, ny, nz] = index.nodes().0;
        let dilated = (first..end).map(|x| {
            let near = |x: usize| planes.get(x.checked_sub(before)?);
            let sides = [x.checked_sub(1).and_then(near), near(x + 1)];
            near(x).map_or_else(Plane::default, |own| dilate(own, sides, array, [ny, nz]))
        });
        Ok((Slab { planes: dilated.collect() }, read))
    }
}

/// The rows of consecutive planes, and the bytes that were read.
fn planes(index: &Index, array: &RowArray, range: Range<usize>) -> Result<(Vec<Plane>, u64)> {
    if index.is_dense() {
        return full_planes(index, array, range);
    }
    let (mut planes, mut rows) = (Vec::new(), Vec::new());
    let mut wanted: Vec<(u32, u32)> = Vec::new();
    for x in range {
        index.plane(x, &mut rows)?;
        let mut nodes = Vec::new();
        for (node, &row) in (0u32..).zip(&rows).filter(|(_, row)| **row != NO_ROW) {
            nodes.push(node);
            // Fewer than 2^32: a slab has as many nodes at most.
            wanted.push((row, u32::try_from(wanted.len()).unwrap_or(NO_ROW)));
        }
        planes.push(Plane { nodes, ..Plane::default() });
    }
    let size = array.row_bytes();
    let mut bytes = vec![0; wanted.len() * size];
    let read = array.gather(&mut wanted, &mut bytes)?;
    let mut rest = &bytes[..];
    for plane in &mut planes {
        let (own, left) = rest.split_at(plane.nodes.len() * size);
        plane.rows = own.to_vec();
        rest = left;
    }
    Ok((planes, read))
}

/// The same where each node has a row, in order.
fn full_planes(index: &Index, array: &RowArray, range: Range<usize>) -> Result<(Vec<Plane>, u64)> {
    let [_, ny, nz] = index.nodes().0;
    let mut read = 0;
    let planes = range.map(|x| {
        let mut rows = vec![0; ny * nz * array.row_bytes()];
        array.rows_from((x * ny * nz) as u64, &mut rows)?;
        read += rows.len() as u64;
        Ok(Plane { is_full: true, rows, ..Plane::default() })
    });
    let planes = planes.collect::<Result<_>>()?;
    Ok((planes, read))
}

/// A plane as float32 with dilated rows: a node without a row takes the mean of its neighbours'
/// rows.
fn dilate(
    own: &Plane,
    sides: [Option<&Plane>; 2],
    array: &RowArray,
    [ny, nz]: [usize; 2],
) -> Plane {
    let width = array.width();
    let decoded = |plane: &Plane| {
        let mut values = vec![0.0f32; plane.nodes.len() * width];
        let rows = plane.rows.chunks_exact(array.row_bytes());
        for (bytes, row) in rows.zip(values.chunks_exact_mut(width)) {
            array.decode(0, bytes, row);
        }
        values
    };
    let own_values = decoded(own);
    // The place of each node's row: first its own rows, then sums of neighbours.
    let mut places = vec![NO_ROW; ny * nz];
    let number = |count: usize| u32::try_from(count).unwrap_or(NO_ROW);
    for (at, &node) in own.nodes.iter().enumerate() {
        if let Some(place) = places.get_mut(node as usize) {
            *place = number(at);
        }
    }
    let count = own.nodes.len();
    let (mut sums, mut counts): (Vec<f32>, Vec<f32>) = (Vec::new(), Vec::new());
    let mut add = |plane: &Plane, values: &[f32]| {
        for (&node, row) in plane.nodes.iter().zip(values.chunks_exact(width)) {
            let (y, z) = (node as usize / nz, node as usize % nz);
            for y in y.saturating_sub(1)..(y + 2).min(ny) {
                for z in z.saturating_sub(1)..(z + 2).min(nz) {
                    let Some(place) = places.get_mut(y * nz + z) else { continue };
                    if *place == NO_ROW {
                        *place = number(count + counts.len());
                        counts.push(0.0);
                        sums.resize(sums.len() + width, 0.0);
                    }
                    let Some(at) = (*place as usize).checked_sub(count) else { continue };
                    if let (Some(count), Some(sums)) =
                        (counts.get_mut(at), sums.get_mut(at * width..(at + 1) * width))
                    {
                        *count += 1.0;
                        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
                    }
                }
            }
        }
    };
    add(own, &own_values);
    for side in sides.into_iter().flatten() {
        add(side, &decoded(side));
    }
    let mut plane = Plane::default();
    for (node, &place) in (0u32..).zip(&places).filter(|(_, place)| **place != NO_ROW) {
        plane.nodes.push(node);
        let place = place as usize;
        match place.checked_sub(count) {
            None => {
                let row = own_values.get(place * width..(place + 1) * width).unwrap_or_default();
                plane.rows.extend(row.iter().flat_map(|value| value.to_le_bytes()));
            }
            Some(at) => {
                let row = sums.get(at * width..(at + 1) * width).unwrap_or_default();
                let share = counts.get(at).map_or(0.0, |count| 1.0 / count);
                plane.rows.extend(row.iter().flat_map(|sum| (sum * share).to_le_bytes()));
            }
        }
    }
    plane
}
