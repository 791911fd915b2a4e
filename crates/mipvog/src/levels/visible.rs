//! The nodes and blocks that can contribute to any pixel.
//!
//! Opacity grows with raw density, so a threshold on opacity is a threshold on raw values: testing
//! a node is one comparison. A trilinear sample never exceeds the largest of its cell's 8 corners,
//! with activation before or after interpolation. Therefore a cell is *visible* if any corner is
//! above the threshold (and the free-space mask, if there is one, touches the cell), and a node is
//! *retained* if it is a corner of a visible cell. Other nodes are don't-care nodes: they may hold
//! any value that stays below the threshold. A block of nodes is dropped only if it holds no
//! retained node. All its cells then stay below the threshold, even if its neighbours are kept and
//! its own nodes read as empty.
//!
//! Coarser levels follow the same rule on their own filtered density. If density is not filtered
//! (the research code's levels), a cell is visible if it overlaps a visible cell of level 0.

use super::filter::LevelFilter;
use super::free_space::masked_share;
use super::opacity::{Opacity, OpacitySearch};
use super::{Direction, Light, OpticalDepthGrid, Visibility};
use crate::base::error::Result;
use crate::base::progress::{Progress, Silent, Step};
use crate::model::field::{
    Activation, DensityFunction, Nonfinite, NonfiniteCount, Planes, RadianceField,
};
use crate::model::grid::{CellMask, NodeMask, Nodes};
use mipvog_format::sample::free_cells::{any_in_ranges, inside_cells};

/// Containers omit a free-space mask that drops less than this share of the visible opacity: 120 dB
/// below the picture.
const DROPPED_SHARE: f64 = 1e-6;

/// The visible nodes of one level, and the reasons why the others are not.
#[derive(Debug)]
pub struct VisibleLevel {
    /// Corners of visible cells.
    pub retained: NodeMask,
    /// Nodes whose own opacity is above the threshold.
    pub opaque_nodes: u64,
    /// Opaque nodes that only the free-space mask drops.
    pub masked_nodes: u64,
}

/// The visible nodes of a field at every level.
#[derive(Debug)]
pub struct Visible {
    /// Finest first.
    pub levels: Vec<VisibleLevel>,
    /// Raw density of the opacity threshold; a node at or below it is invisible.
    pub raw_threshold: f32,
    /// True if pictures would change without the free-space mask.
    pub mask_is_required: bool,
    /// Visibility, if coarser levels average alpha.
    pub visibility: Option<Visibility>,
    /// Nodes of level 0 whose alpha is not 0, if coarser levels average alpha.
    pub occupied: Option<NodeMask>,
    /// Density values that are not finite.
    pub nonfinite: NonfiniteCount,
    /// CRC-32 of each plane of density.
    pub density_checksums: Vec<u32>,
    /// Bytes of density that were read.
    pub bytes_read: u64,
}

/// Raw density above which a node's opacity exceeds `threshold`, lowered slightly so that no
/// rounding, here or in another program's activation, drops a node above it.
pub fn raw_threshold(threshold: f32, activation: &Activation) -> f32 {
    let raw = activation.raw_at_opacity(threshold.into());
    let slack = match activation.function {
        DensityFunction::Relu => 1e-6 * raw,
        DensityFunction::Softplus => 1e-6 * (raw.abs() + f64::from(activation.shift).abs() + 1.0),
    };
    (raw - slack) as f32
}

impl Visible {
    /// Finds the visible nodes of `sizes.len()` levels. `alpha_threshold` is opacity over one
    /// interval, above 0 and below 1. `light` is the light that visibility is measured with.
    ///
    /// # Errors
    ///
    /// Errors of reading density; values that are not finite, if these are refused.
    pub fn find(
        planes: &Planes,
        sizes: &[Nodes],
        filter: &dyn LevelFilter,
        alpha_threshold: f32,
        light: Light,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let field = planes.field();
        let activation = &field.scene.activation;
        let raw_threshold = raw_threshold(alpha_threshold, activation);
        let filtered = &sizes[..if filter.has_density() { sizes.len() } else { 1 }];
        let domain = filter.alpha(activation);
        let threshold = |level: usize| match domain.filter(|_| level > 0) {
            // Steps grow with the level.
            Some(domain) => domain.alpha_at_opacity(alpha_threshold, 2f64.powi(level as i32)),
            None => raw_threshold,
        };
        let thresholds = (0..filtered.len()).map(threshold).collect();
        let direction = Direction::of(filter, field);
        let search =
            OpacitySearch { planes, sizes: filtered, filter, direction, light, thresholds };
        progress.begin(Step::Prune, (search.passes() * sizes[0].0[0]) as u64);
        let Opacity { opaque, occupied, visibility, nonfinite, checksums, bytes_read } =
            search.run(progress)?;
        planes.accepted(nonfinite)?;
        let mut levels = Vec::with_capacity(sizes.len());
        let mut finest_cells = None;
        for (level, opaque) in opaque.iter().enumerate() {
            let mut cells = opaque.cells_with_a_corner()?;
            let mut masked_nodes = 0;
            if let Some(free_space) = &field.free_space {
                cells.intersect(&inside_cells(free_space, &field.scene.bounds, sizes[level])?);
                masked_nodes = opaque.count() - opaque.count_common(&cells.corners()?);
            }
            let retained = cells.corners()?;
            levels.push(VisibleLevel { retained, opaque_nodes: opaque.count(), masked_nodes });
            finest_cells.get_or_insert(cells);
        }
        let cells = finest_cells.unwrap_or_else(|| CellMask::empty(sizes[0]));
        for &nodes in &sizes[levels.len()..] {
            let retained = overlapping_cells(&cells, nodes)?.corners()?;
            levels.push(VisibleLevel { retained, opaque_nodes: 0, masked_nodes: 0 });
        }
        let mask_is_required = match &field.free_space {
            Some(mask) => masked_share(mask, planes, &cells, raw_threshold)? > DROPPED_SHARE,
            None => false,
        };
        Ok(Self {
            levels,
            raw_threshold,
            mask_is_required,
            visibility,
            occupied,
            nonfinite,
            density_checksums: checksums,
            bytes_read,
        })
    }

    /// The retained nodes of each level, finest first.
    pub fn retained(&self) -> Vec<&NodeMask> {
        self.levels.iter().map(|level| &level.retained).collect()
    }

    /// Drops nodes that no light reaches, which opaque surfaces enclose. Neighbours of lit nodes
    /// stay.
    ///
    /// # Errors
    /// Too little memory.
    pub fn drop_unlit(&mut self) -> Result<()> {
        let Some(visibility) = &self.visibility else { return Ok(()) };
        for level in &mut self.levels {
            let lit = visibility.lit_nodes(level.retained.nodes())?;
            let around = lit.cells_with_a_corner()?.corners()?.cells_with_a_corner()?.corners()?;
            level.retained.intersect(&around);
        }
        Ok(())
    }

    /// Retains every node of the blocks that hold a retained one.
    ///
    /// # Errors
    /// Too little memory.
    pub fn keep_blocks(&mut self, edge: usize) -> Result<()> {
        for level in &mut self.levels {
            level.retained = level.retained.whole_blocks(edge)?;
        }
        Ok(())
    }

    /// Drops nodes outside `cells` of level 0, the only cells that cameras see, and outside the
    /// cells around them: the alpha of coarser levels spreads into those, and takes part of its
    /// colour from there.
    ///
    /// # Errors
    ///
    /// None of its own.
    pub fn keep_cells(&mut self, cells: &CellMask) -> Result<()> {
        for level in &mut self.levels {
            let cells = overlapping_cells(cells, level.retained.nodes())?;
            level.retained.intersect(&cells.corners()?.cells_with_a_corner()?.corners()?);
        }
        Ok(())
    }
}

/// The visibility of a field, in separate passes over density; none if `filter` does not average
/// alpha or makes no coarser levels.
///
/// # Errors
///
/// Errors of reading density.
pub fn visibility(
    planes: &Planes,
    sizes: &[Nodes],
    filter: &dyn LevelFilter,
) -> Result<Option<Visibility>> {
    if sizes.len() < 2 || filter.alpha(&planes.field().scene.activation).is_none() {
        return Ok(None);
    }
    // At least one coarser level, so that the search measures visibility.
    let sizes = &sizes[..=OpticalDepthGrid::level(sizes).max(1)];
    let thresholds = vec![f32::INFINITY; sizes.len()];
    let direction = Direction::of(filter, planes.field());
    let light = Light::default();
    let search = OpacitySearch { planes, sizes, filter, direction, light, thresholds };
    Ok(search.run(&Silent)?.visibility)
}

/// The planes of a field, prepared for reading, with all nodes outside the reach of its free-space
/// mask emptied.
///
/// # Errors
///
/// Errors of preparing the field, and a request to stop.
pub fn masked_planes<'a>(
    field: &'a RadianceField,
    nonfinite: Nonfinite,
    progress: &dyn Progress,
) -> Result<Planes<'a>> {
    field.prepare(progress)?;
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
    // Cell i of M nodes spans [i, i + 1] / (M - 1) of the axis; cells that only touch do not
    // overlap.
    let ranges: [Vec<(usize, usize)>; 3] = [0, 1, 2].map(|axis| {
        let (coarse, fine) = (nodes.0[axis] - 1, fine.nodes().0[axis] - 1);
        (0..coarse).map(|i| (i * fine / coarse, ((i + 1) * fine).div_ceil(coarse))).collect()
    });
    any_in_ranges(fine, nodes, &ranges)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_threshold_is_never_above_the_exact_one() {
        for interval in [1e-5f32, 0.25, 0.5, 1.0, 100.0] {
            for threshold in [1e-9f32, 1e-4, 1e-3, 0.05, 0.9] {
                let logits = Activation::logits(-4.595_12, interval);
                let raw = raw_threshold(threshold, &logits);
                let below = logits.opacity(raw.into());
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
