//! Densities and colours of voxels as grids of a field.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use super::density::PER_UNIT;
use super::loaded::VoxelFile;
use super::octree::SIDE;
use super::plan::BoxPlan;
use super::plane::{PlaneColors, densities};
use crate::base::error::Result;
use crate::base::lock::lock;
use crate::base::progress::Progress;
use crate::model::activate;
use crate::model::field::{EMPTY_LOGIT, NodeValues};
use crate::model::grid::{Nodes, row};
use crate::model::harmonics::{BAND_0, FUNCTIONS, Harmonics};

/// Bytes of planes of colours that are kept, at most, beside the last few.
const KEPT_BYTES: usize = 128 << 20;
/// Planes that are kept whatever their size: threads read one each.
const KEPT_PLANES: usize = 4;

/// A plane's x in edges of the smallest voxels.
fn place(plan: &BoxPlan, x: usize) -> u32 {
    plan.first + u32::try_from(x).unwrap_or(0) * plan.edge
}

/// Raw densities of a box, for a softplus of which 1 is an optical depth of [`PER_UNIT`] per world
/// unit.
#[derive(Debug)]
pub(super) struct BoxDensity {
    pub(super) file: Arc<VoxelFile>,
    pub(super) plan: BoxPlan,
}

impl NodeValues for BoxDensity {
    fn nodes(&self) -> Nodes {
        Nodes([self.plan.nodes; 3])
    }

    fn channels(&self) -> usize {
        1
    }

    fn memory_bytes(&self) -> u64 {
        self.file.memory_bytes()
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.file.stored.sample(hash)
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.file.load().map(drop)
    }

    fn read(&self, _: usize, x: usize, _: &[u64], out: &mut [f32]) -> Result<u64> {
        let voxels = self.file.load()?;
        out.fill(EMPTY_LOGIT);
        densities(&voxels, &self.plan, place(&self.plan, x), |node, density| {
            if let Some(out) = out.get_mut(node) {
                #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
                let raw = activate::inverse_softplus(density / PER_UNIT) as f32;
                *out = raw.max(EMPTY_LOGIT);
            }
        });
        Ok(0)
    }
}

/// Harmonics of a box.
#[derive(Debug)]
pub(super) struct BoxColors {
    pub(super) file: Arc<VoxelFile>,
    pub(super) plan: BoxPlan,
    /// The rules that make colours of those of band 0, for colours that do not depend on the view.
    pub(super) plain: Option<Harmonics>,
    pub(super) kept: Mutex<VecDeque<(usize, Arc<PlaneColors>)>>,
}

impl BoxColors {
    /// A plane's colours. Two threads that want the same one may both find it.
    fn plane(&self, x: usize) -> Result<Arc<PlaneColors>> {
        let is_own = |(number, _): &(usize, _)| *number == x;
        if let Some((_, plane)) = lock(&self.kept).iter().find(|kept| is_own(kept)) {
            return Ok(Arc::clone(plane));
        }
        let voxels = self.file.load()?;
        let unit = self.file.settings.extent / f64::from(SIDE);
        let at = place(&self.plan, x);
        let plane = Arc::new(PlaneColors::find(&voxels, &self.plan, at, unit));
        let mut kept = lock(&self.kept);
        kept.push_back((x, Arc::clone(&plane)));
        let bytes = |kept: &VecDeque<(usize, Arc<PlaneColors>)>| {
            kept.iter().map(|(_, plane)| plane.bytes()).sum::<usize>()
        };
        while kept.len() > KEPT_PLANES && bytes(&kept) > KEPT_BYTES {
            kept.pop_front();
        }
        Ok(plane)
    }

    fn value(&self, value: f32) -> f32 {
        let Some(rules) = self.plain else { return value };
        let [value, _, _] = rules.color(&[BAND_0; FUNCTIONS], &[value; 3]);
        value
    }
}

impl NodeValues for BoxColors {
    fn nodes(&self) -> Nodes {
        Nodes([self.plan.nodes; 3])
    }

    fn channels(&self) -> usize {
        self.file.width
    }

    fn memory_bytes(&self) -> u64 {
        KEPT_BYTES as u64
    }

    fn digest(&self, _: &mut dyn FnMut(&[u8])) -> Result<()> {
        // The density's stands for the whole file.
        Ok(())
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.file.load().map(drop)
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let plane = self.plane(x)?;
        let nz = self.plan.nodes;
        let words = nz.div_ceil(64);
        for (row, out) in region.chunks_exact(words).zip(out.chunks_exact_mut(nz)) {
            for (start, end) in row::runs(row) {
                out.get_mut(start..end).unwrap_or_default().fill(0.0);
            }
        }
        for (node, value) in plane.nodes.iter().zip(plane.channel(channel)) {
            if let Some(out) = out.get_mut(*node as usize) {
                *out = self.value(*value);
            }
        }
        Ok(0)
    }
}
