//! Colours that are computed node by node, and cached plane by plane for their other channels.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use crate::base::error::Result;
use crate::base::lock::lock;
use crate::model::grid::{Nodes, row};

/// Cached planes: a slab, which threads read at once, plus one.
const KEPT_PLANES: usize = 9;

/// Maximum bytes of planes that are cached for later passes.
const ARCHIVE_BYTES: u64 = 256 << 20;

/// The most recent planes with all channels, and the nodes of earlier ones if they are expensive.
#[derive(Debug, Default)]
pub struct PlaneCache {
    kept: Mutex<Vec<Arc<Slot>>>,
    archive: Option<Mutex<Archive>>,
}

/// A plane.
#[derive(Debug)]
struct Slot {
    x: usize,
    filled: Mutex<Option<Filled>>,
}

#[derive(Debug)]
struct Filled {
    region: Vec<u64>,
    /// Channel by channel.
    values: Vec<f32>,
}

/// Nodes of planes, for the next pass over all planes.
#[derive(Debug, Default)]
struct Archive {
    planes: BTreeMap<usize, Packed>,
    bytes: u64,
}

/// The nodes of a region.
#[derive(Debug)]
struct Packed {
    region: Vec<u64>,
    /// All channels of a node, then those of the next one.
    values: Vec<f32>,
}

/// Visits the nodes `(y, z)` of a plane that belong to a region.
pub fn visit(nodes: Nodes, region: &[u64], mut visit: impl FnMut([usize; 2])) {
    let Nodes([_, _, nz]) = nodes;
    for (y, bits) in region.chunks_exact(row::words(nodes)).enumerate() {
        for (start, end) in row::runs(bits) {
            (start..end.min(nz)).for_each(|z| visit([y, z]));
        }
    }
}

impl PlaneCache {
    /// A cache that keeps nodes for the next pass over all planes, because they are slow to
    /// compute.
    pub fn with_archive() -> Self {
        Self { archive: Some(Mutex::default()), ..Self::default() }
    }

    /// Bytes of planes of this many nodes and channels.
    pub fn bytes(&self, nodes: Nodes, channels: usize) -> u64 {
        let Nodes([nx, ny, nz]) = nodes;
        let plane = (4 * channels * ny * nz) as u64;
        let archive = self.archive.as_ref().map_or(0, |_| ARCHIVE_BYTES.min(plane * nx as u64));
        plane * KEPT_PLANES as u64 + archive
    }

    /// Copies one of `channels` of plane `x`. For missing nodes of the region, `fill` computes all
    /// channels, channel by channel.
    ///
    /// # Errors
    /// Those of `fill`.
    pub fn read(
        &self,
        nodes: Nodes,
        x: usize,
        [channel, channels]: [usize; 2],
        region: &[u64],
        out: &mut [f32],
        fill: impl FnOnce(&[u64], &mut [f32]) -> Result<()>,
    ) -> Result<()> {
        let slot = self.slot(x);
        let mut filled = lock(&slot.filled);
        let covers = |filled: &Filled| {
            filled.region.iter().zip(region).all(|(has, asked)| asked & !has == 0)
        };
        if !filled.as_ref().is_some_and(covers) {
            let mut values = vec![0.0; out.len() * channels];
            let mut known = vec![0; region.len()];
            if let Some(archive) = &self.archive {
                lock(archive).restore(nodes, x, &mut known, &mut values);
            }
            let missing = region.iter().zip(&known).map(|(asked, has)| asked & !has);
            fill(&missing.collect::<Vec<_>>(), &mut values)?;
            row::or_into(&mut known, region);
            if let Some(archive) = &self.archive {
                lock(archive).keep(nodes, x, &known, &values);
            }
            *filled = Some(Filled { region: known, values });
        }
        let values = filled.as_ref().map_or(&[][..], |filled| &filled.values);
        let values = values.get(channel * out.len()..).unwrap_or_default();
        out.iter_mut().zip(values).for_each(|(out, value)| *out = *value);
        Ok(())
    }

    /// The plane's index in the cache.
    fn slot(&self, x: usize) -> Arc<Slot> {
        let mut kept = lock(&self.kept);
        if let Some(slot) = kept.iter().find(|slot| slot.x == x) {
            return Arc::clone(slot);
        }
        if kept.len() == KEPT_PLANES {
            kept.remove(0);
        }
        let slot = Arc::new(Slot { x, filled: Mutex::new(None) });
        kept.push(Arc::clone(&slot));
        slot
    }
}

impl Archive {
    /// Fills in the nodes of plane `x` that are known, channel by channel.
    fn restore(&self, nodes: Nodes, x: usize, known: &mut [u64], values: &mut [f32]) {
        let Some(packed) = self.planes.get(&x) else { return };
        let Nodes([_, ny, nz]) = nodes;
        let channels = values.len() / (ny * nz);
        let mut rows = packed.values.chunks_exact(channels.max(1));
        visit(nodes, &packed.region, |[y, z]| {
            let out = values.iter_mut().skip(y * nz + z).step_by(ny * nz);
            let row = rows.next().unwrap_or_default();
            out.zip(row).for_each(|(out, value)| *out = *value);
        });
        row::or_into(known, &packed.region);
    }

    /// Keeps the nodes of a region, as long as there is room.
    fn keep(&mut self, nodes: Nodes, x: usize, region: &[u64], values: &[f32]) {
        let Nodes([_, ny, nz]) = nodes;
        let channels = values.len() / (ny * nz);
        let count = region.iter().map(|word| word.count_ones() as usize).sum::<usize>();
        let bytes = |values: usize| 4 * values as u64;
        let old = self.planes.get(&x).map_or(0, |packed| bytes(packed.values.len()));
        if self.bytes - old + bytes(count * channels) > ARCHIVE_BYTES {
            return;
        }
        let mut own = Vec::with_capacity(count * channels);
        visit(nodes, region, |[y, z]| {
            own.extend(values.iter().skip(y * nz + z).step_by(ny * nz));
        });
        self.bytes = self.bytes - old + bytes(own.len());
        self.planes.insert(x, Packed { region: region.to_vec(), values: own });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_node_is_found_twice() {
        let (nodes, channels) = (Nodes([40, 3, 70]), 2);
        let (cache, found) = (PlaneCache::with_archive(), Mutex::new(0));
        let value =
            |x: usize, channel: usize, node: usize| (1000 * x + 500 * channel + node) as f32;
        let regions = [[0b1011, 0, 1, 1, 0, 0], [0b111, 1, 0, 0, u64::MAX, 0]];
        for region in [regions[0], regions[1], regions[0]] {
            for x in 0..40 {
                for channel in 0..channels {
                    let mut out = vec![0.0; 210];
                    let fill = |region: &[u64], values: &mut [f32]| {
                        visit(nodes, region, |[y, z]| {
                            *lock(&found) += 1;
                            for channel in 0..channels {
                                let node = y * 70 + z;
                                values[channel * 210 + node] = value(x, channel, node);
                            }
                        });
                        Ok(())
                    };
                    let asked = [channel, channels];
                    cache.read(nodes, x, asked, &region, &mut out, fill).expect("values");
                    visit(nodes, &region, |[y, z]| {
                        assert_eq!(out[y * 70 + z], value(x, channel, y * 70 + z));
                    });
                }
            }
        }
        // Those of both regions, once each.
        assert_eq!(*lock(&found), 40 * (5 + 66));
    }
}
