//! What nobody can see.
//!
//! Opacity grows with raw density, so a threshold on opacity is one threshold on raw values, found
//! once; testing a node is one comparison. A trilinear sample never exceeds the largest of its
//! cell's 8 corners, whatever is activated before or after interpolation. Therefore a cell is
//! *visible* if any corner is above the threshold (and the free-space mask, if there is one, touches
//! the cell), and a node is *needed* if it is a corner of a visible cell. A block of nodes is
//! dropped only if it holds no needed node; all its cells then stay below the threshold even where
//! its neighbours are kept and its own nodes read as empty.
//!
//! Coarser levels follow the same rule on their own filtered density; where density is not filtered
//! (the research code's levels) a cell is visible if it overlaps a visible cell of level 0.

mod free_space;
mod opaque;

pub use free_space::{inside_cells, masked_share, touched_cells};
use opaque::{Finest, coarser_above, finest_above};

use crate::base::error::Result;
use crate::base::progress::{Progress, Silent, Step};
use crate::levels::mips::{Kernel, Matter, Occluders, Visibility};
use crate::model::activate;
use crate::model::field::{Nonfinite, Planes, RadianceField, Scene};
use crate::model::grid::{Bounds, CellMask, NodeMask, Nodes};

/// The free-space mask is left out of containers where what it drops, of everything that can be
/// seen, has less opacity than this: 120 dB below the picture.
const DROPPED_SHARE: f64 = 1e-6;

/// What can be seen of one level, and why the rest cannot.
#[derive(Debug)]
pub struct PrunedLevel {
    /// Corners of visible cells.
    pub needed: NodeMask,
    /// Nodes whose own opacity is above the threshold.
    pub opaque_nodes: u64,
    /// Those of them that only the free-space mask drops.
    pub masked_nodes: u64,
}

/// What can be seen of a field at every level.
#[derive(Debug)]
pub struct Pruned {
    /// Finest first.
    pub levels: Vec<PrunedLevel>,
    /// Raw density of the opacity threshold: what is not above it cannot be seen.
    pub raw_threshold: f32,
    /// Whether what only the free-space mask drops would be seen without it.
    pub keeps_mask: bool,
    /// How much of each node is seen, for coarser levels of matter.
    pub visibility: Option<Visibility>,
    /// Nodes of level 0 that hold matter, for coarser levels of it.
    pub matter: Option<NodeMask>,
    /// Density values that are not finite (refused, or emptied).
    pub nonfinite: u64,
    /// CRC-32 of each plane of density.
    pub density_checksums: Vec<u32>,
}

/// Raw density above which a node's opacity exceeds `threshold`, lowered by a hair so that no
/// rounding, here or in anybody's activation, drops a node that is above.
pub fn raw_threshold(threshold: f32, shift: f32, interval: f32) -> f32 {
    let raw = activate::raw_at_opacity(threshold.into(), shift.into(), interval.into());
    let slack = 1e-6 * (raw.abs() + f64::from(shift).abs() + 1.0);
    (raw - slack) as f32
}

/// How coarser levels get their density.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DensityFilter {
    /// The low-pass before halving.
    pub kernel: Kernel,
    /// What is averaged, where it is not raw density.
    pub matter: Option<Matter>,
}

/// Finds what can be seen of `sizes.len()` levels. Without a filter coarser levels hold no density.
pub fn prune(
    planes: &Planes,
    sizes: &[Nodes],
    filter: Option<DensityFilter>,
    alpha_threshold: f32,
    progress: &dyn Progress,
) -> Result<Pruned> {
    let field = planes.field();
    let activation = &field.scene.activation;
    let raw_threshold = raw_threshold(alpha_threshold, activation.shift, activation.interval);
    let filtered = &sizes[..if filter.is_some() { sizes.len() } else { 1 }];
    let plain = DensityFilter { kernel: Kernel::None, matter: None };
    let filter = filter.unwrap_or(plain);
    let thresholds: Vec<f32> = (0..filtered.len())
        .map(|level| match filter.matter.filter(|_| level > 0) {
            // Steps grow with the level.
            Some(matter) => matter.amount_at_opacity(alpha_threshold, 2f64.powi(level as i32)),
            None => raw_threshold,
        })
        .collect();
    let occluders = occluders(planes, filtered, filter.matter);
    let passes = filtered.len().min(2);
    progress.begin(Step::Prune, (passes * sizes[0].0[0]) as u64);
    let empty_up_to = filter.matter.map(|matter| matter.empty_up_to());
    let finest = finest_above(planes, thresholds[0], empty_up_to, occluders.as_ref(), progress)?;
    let Finest { opaque, mut matter, checksums: density_checksums } = finest;
    let nonfinite = planes.take_nonfinite()?.count;
    let mut opaque = vec![opaque];
    if filtered.len() > 1 {
        let occluders = occluders.as_ref();
        let (coarser, back) =
            coarser_above(planes, filtered, filter, matter, &thresholds, occluders, progress)?;
        opaque.extend(coarser);
        matter = back;
    }
    let visibility = occluders.map(|occluders| occluders.visibility()).transpose()?;
    let inside = field.free_space.as_ref();
    let mut levels = Vec::with_capacity(sizes.len());
    let mut finest_cells = None;
    for (level, opaque) in opaque.iter().enumerate() {
        let mut cells = opaque.cells_with_a_corner()?;
        let mut masked_nodes = 0;
        if let Some(free_space) = inside {
            let touched = inside_cells(free_space, &field.scene.bounds, sizes[level])?;
            cells.intersect(&touched);
            masked_nodes = opaque.count() - opaque.count_common(&cells.corners()?);
        }
        let needed = cells.corners()?;
        levels.push(PrunedLevel { needed, opaque_nodes: opaque.count(), masked_nodes });
        finest_cells.get_or_insert(cells);
    }
    let cells = finest_cells.unwrap_or_else(|| CellMask::empty(sizes[0]));
    for &nodes in &sizes[levels.len()..] {
        let needed = overlapping_cells(&cells, nodes)?.corners()?;
        levels.push(PrunedLevel { needed, opaque_nodes: 0, masked_nodes: 0 });
    }
    let keeps_mask = match inside {
        Some(free_space) => {
            masked_share(free_space, planes, &cells, raw_threshold)? > DROPPED_SHARE
        }
        None => false,
    };
    Ok(Pruned {
        levels,
        raw_threshold,
        keeps_mask,
        visibility,
        matter,
        nonfinite,
        density_checksums,
    })
}

impl Pruned {
    /// Drops what lies outside `cells` of level 0, the only ones that are ever looked at, and the cells
    /// around them: coarser levels' matter spreads into those, and takes a part of its colour from there.
    pub fn keep_cells(&mut self, cells: &CellMask) -> Result<()> {
        for level in &mut self.levels {
            let cells = overlapping_cells(cells, level.needed.nodes())?;
            level.needed.intersect(&cells.corners()?.cells_with_a_corner()?.corners()?);
        }
        Ok(())
    }
}

/// How much of each node is seen, in passes over density of their own.
pub fn visibility(
    planes: &Planes,
    sizes: &[Nodes],
    kernel: Kernel,
    matter: Matter,
) -> Result<Visibility> {
    let sizes = &sizes[..=Occluders::level(sizes)];
    let occluders = Occluders::new(matter, sizes, extent_in_intervals(&planes.field().scene));
    let (occludes, empty_up_to) = (Some(&occluders), Some(matter.empty_up_to()));
    let finest = finest_above(planes, f32::INFINITY, empty_up_to, occludes, &Silent)?;
    if sizes.len() > 1 {
        let filter = DensityFilter { kernel, matter: Some(matter) };
        let thresholds = vec![f32::INFINITY; sizes.len()];
        coarser_above(planes, sizes, filter, finest.matter, &thresholds, occludes, &Silent)?;
    }
    occluders.visibility()
}

/// What light meets, where coarser levels are made of matter.
fn occluders(planes: &Planes, sizes: &[Nodes], matter: Option<Matter>) -> Option<Occluders> {
    let matter = matter.filter(|_| sizes.len() > 1)?;
    Some(Occluders::new(matter, sizes, extent_in_intervals(&planes.field().scene)))
}

fn extent_in_intervals(scene: &Scene) -> [f64; 3] {
    let Scene { bounds: Bounds { min, max }, march, .. } = scene;
    let step = f64::from(march.stepsize) * f64::from(march.voxel_size);
    [0, 1, 2].map(|axis| (f64::from(max[axis]) - f64::from(min[axis])) / step)
}

/// The planes of a field with everything emptied that its free-space mask cannot reach.
pub fn masked_planes(field: &RadianceField, nonfinite: Nonfinite) -> Result<Planes<'_>> {
    let outside = match &field.free_space {
        Some(free_space) => {
            let cells = inside_cells(free_space, &field.scene.bounds, field.scene.nodes)?;
            Some(cells.corners()?.complement())
        }
        None => None,
    };
    Ok(Planes::new(field, outside, nonfinite))
}

/// The cells of a coarser grid over the same box that overlap a cell in `fine`.
fn overlapping_cells(fine: &CellMask, nodes: Nodes) -> Result<CellMask> {
    let fine = fine.lowest_nodes();
    // Cell i of M nodes spans [i, i + 1] / (M - 1) of the axis; cells that only touch do not overlap.
    let ranges: [Vec<(usize, usize)>; 3] = [0, 1, 2].map(|axis| {
        let (coarse, fine) = (nodes.0[axis] - 1, fine.nodes().0[axis] - 1);
        (0..coarse).map(|i| (i * fine / coarse, ((i + 1) * fine).div_ceil(coarse))).collect()
    });
    free_space::gather(fine, nodes, &ranges)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_threshold_is_never_above_the_exact_one() {
        for interval in [1e-5f32, 0.25, 0.5, 1.0, 100.0] {
            for threshold in [1e-9f32, 1e-4, 1e-3, 0.05, 0.9] {
                let raw = raw_threshold(threshold, -4.595_12, interval);
                let below = activate::opacity(raw.into(), f64::from(-4.595_12f32), interval.into());
                assert!(below < f64::from(threshold), "{interval} {threshold}");
                assert!(below > f64::from(threshold) * 0.9999, "{interval} {threshold}");
            }
        }
    }

    #[test]
    fn coarse_cells_overlap_what_they_cover() {
        let fine = Nodes([9, 6, 5]);
        let cells = NodeMask::of_planes(fine, |_, rows| {
            rows.fill(0b1001);
            Ok(())
        });
        let cells = cells.and_then(|cells| cells.cells_with_a_corner()).expect("no error");
        let coarse = overlapping_cells(&cells, Nodes([4, 3, 2])).expect("no error");
        assert_eq!(coarse.count(), 3 * 2);
    }
}
