//! Nodes above each level's threshold.
//!
//! One pass over all of density finds those of level 0, and which nodes hold any matter. The levels after it are made
//! of that matter alone, plane by plane; only where raw density is averaged do they read all of it.

use std::sync::{Mutex, PoisonError};

use super::DensityFilter;
use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::levels::mips::{Cascade, Lift, Occluders, Pool, Regions, SLAB};
use crate::model::field::{Planes, verify_crc32};
use crate::model::grid::{NodeMask, Nodes, row};

/// Planes of level 0 that are worked on between two looks at progress.
const READ_TOGETHER: usize = 16;

/// What one pass over all of density finds.
#[derive(Debug)]
pub struct Finest {
    /// Nodes above the threshold.
    pub opaque: NodeMask,
    /// Nodes that hold matter, where that is averaged.
    pub matter: Option<NodeMask>,
    /// CRC-32 of each plane.
    pub checksums: Vec<u32>,
}

/// Reads all of density.
pub fn finest_above(
    planes: &Planes,
    threshold: f32,
    empty_up_to: Option<f32>,
    occluders: Option<&Occluders>,
    progress: &dyn Progress,
) -> Result<Finest> {
    let nodes = planes.field().scene.nodes;
    let [nx, ny, nz] = nodes.0;
    let full = NodeMask::full(Nodes([1, ny, nz]));
    let mut opaque = NodeMask::empty(nodes);
    let mut matter = empty_up_to.map(|_| NodeMask::empty(nodes));
    let mut of_matter = matter.as_mut().map(|mask| mask.planes_mut(0)).into_iter().flatten();
    let mut rows: Vec<_> =
        opaque.planes_mut(0).into_iter().map(|opaque| (opaque, of_matter.next())).collect();
    let pool = Pool::default();
    let mut hashers = Vec::with_capacity(nx);
    for rows in rows.chunks_mut(READ_TOGETHER) {
        let first = hashers.len();
        hashers.extend(parallel::map_mut(rows, |i, (opaque, matter)| {
            let mut plane = pool.take(ny * nz);
            let read = planes.read(0, first + i, full.plane(0), &mut plane)?;
            above(&plane, nz, threshold, opaque);
            if let (Some(matter), Some(empty_up_to)) = (matter, empty_up_to) {
                above(&plane, nz, empty_up_to, matter);
            }
            if let Some(occluders) = occluders {
                occluders.take(0, first + i, &plane);
            }
            pool.give([plane]);
            Ok(read.checksum)
        })?);
        progress.advance(Step::Prune, rows.len() as u64);
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
    }
    if let Some(expected) = planes.density_crc32() {
        verify_crc32("density", &hashers, expected)?;
    }
    let checksums = hashers.into_iter().map(crc32fast::Hasher::finalize).collect();
    Ok(Finest { opaque, matter, checksums })
}

/// Makes the coarser levels of `sizes`, of level 0's nodes in `matter` where there is such a set, and finds the nodes of
/// each that are above its threshold. Gives the set back.
pub fn coarser_above(
    planes: &Planes,
    sizes: &[Nodes],
    filter: DensityFilter,
    matter: Option<NodeMask>,
    thresholds: &[f32],
    occluders: Option<&Occluders>,
    progress: &dyn Progress,
) -> Result<(Vec<NodeMask>, Option<NodeMask>)> {
    let lift = filter.matter.map_or(Lift::Raw(0..1), Lift::Amounts);
    let of_matter = matter.is_some();
    let regions = match matter {
        Some(matter) => Regions::of_matter(matter, sizes, filter.kernel)?,
        None => {
            let whole = sizes.iter().map(|&nodes| NodeMask::full(nodes)).collect();
            Regions::new(whole, None, filter.kernel)?
        }
    };
    let mut opaque: Vec<NodeMask> =
        sizes[1..].iter().map(|&nodes| NodeMask::empty(nodes)).collect();
    let rows: Vec<Vec<Mutex<&mut [u64]>>> = opaque
        .iter_mut()
        .map(|mask| mask.planes_mut(0).into_iter().map(Mutex::new).collect())
        .collect();
    Cascade::new(&regions, 1, lift, SLAB).run(
        |x, channel, region, plane| planes.read(channel, x, region, plane).map(|_| ()),
        |level, x, _, plane| {
            let mut rows = rows[level - 1][x].lock().unwrap_or_else(PoisonError::into_inner);
            above(plane, sizes[level].0[2], thresholds[level], &mut rows);
            if let Some(occluders) = occluders {
                occluders.take(level, x, plane);
            }
            Ok(())
        },
        |level, planes| {
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
            if level == 0 {
                progress.advance(Step::Prune, planes.len() as u64);
            }
            Ok(())
        },
    )?;
    drop(rows);
    Ok((opaque, regions.into_finest().filter(|_| of_matter)))
}

/// Rows of bits: the nodes of a plane that are above the threshold.
fn above(plane: &[f32], nz: usize, threshold: f32, rows: &mut [u64]) {
    for (values, row) in plane.chunks_exact(nz).zip(rows.chunks_exact_mut(nz.div_ceil(64))) {
        row::pack_above(values, threshold, row);
    }
}
