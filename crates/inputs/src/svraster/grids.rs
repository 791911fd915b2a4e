//! Densities and colours of voxels as grids of a field.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use super::colors::{NodeColors, Painted};
use super::loaded::VoxelFile;
use super::octree::unit;
use super::plan::BoxPlan;
use super::plane::densities;
use crate::base::error::Result;
use crate::base::lock::lock;
use crate::base::progress::Progress;
use crate::model::field::{EMPTY_LOGIT, NodeValues};
use crate::model::grid::{Nodes, row};
use crate::model::harmonics::{BAND_0, FUNCTIONS, Harmonics};

/// Bytes of planes of colours that are kept, at most, beside the last few.
const KEPT_BYTES: usize = 128 << 20;
/// Minimum number of cached planes: one per thread.
const KEPT_PLANES: usize = 4;

/// A plane's x in edges of the smallest voxels.
fn place(plan: &BoxPlan, x: usize) -> u32 {
    plan.first + u32::try_from(x).unwrap_or(0) * plan.edge
}

/// Densities of a box, as logits: a softplus of 1 is an optical depth of
/// [`SCALE`](super::even::SCALE) per world unit.
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
        self.file.even().map(drop)
    }

    fn read(&self, _: usize, x: usize, _: &[u64], out: &mut [f32]) -> Result<u64> {
        let (voxels, even) = (self.file.load()?, self.file.even()?);
        out.fill(EMPTY_LOGIT);
        densities(&voxels, &even, &self.plan, place(&self.plan, x), |node, logit| {
            if let Some(out) = out.get_mut(node) {
                #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
                let logit = logit as f32;
                *out = logit.max(EMPTY_LOGIT);
            }
        });
        Ok(0)
    }
}

/// The most recently used planes.
type Kept = Mutex<VecDeque<(usize, Arc<NodeColors>)>>;

/// Harmonics of a box.
#[derive(Debug)]
pub(super) struct BoxColors {
    file: Arc<VoxelFile>,
    plan: BoxPlan,
    /// The rules from band 0 to colours, for view-independent colours.
    plain: Option<Harmonics>,
    means: Kept,
    sharpened: Kept,
}

/// A plane's colours. Two threads that request the same plane may both compute it.
fn plane(
    kept: &Kept,
    x: usize,
    find: impl FnOnce() -> Result<NodeColors>,
) -> Result<Arc<NodeColors>> {
    if let Some((_, plane)) = lock(kept).iter().find(|(number, _)| *number == x) {
        return Ok(Arc::clone(plane));
    }
    let plane = Arc::new(find()?);
    let mut kept = lock(kept);
    kept.push_back((x, Arc::clone(&plane)));
    let bytes = |kept: &VecDeque<(usize, Arc<NodeColors>)>| {
        kept.iter().map(|(_, plane)| plane.bytes()).sum::<usize>()
    };
    while kept.len() > KEPT_PLANES && bytes(&kept) > KEPT_BYTES {
        kept.pop_front();
    }
    Ok(plane)
}

impl BoxColors {
    pub(super) fn new(file: Arc<VoxelFile>, plan: BoxPlan, plain: Option<Harmonics>) -> Self {
        Self { file, plan, plain, means: Mutex::default(), sharpened: Mutex::default() }
    }

    fn plane(&self, x: usize) -> Result<Arc<NodeColors>> {
        plane(&self.sharpened, x, || {
            let (voxels, even) = (self.file.load()?, self.file.even()?);
            let unit = unit(self.file.settings.extent);
            let painted = Painted { voxels: &voxels, even: &even, plan: &self.plan, unit };
            let means =
                |x: usize| plane(&self.means, x, || Ok(painted.means(place(&self.plan, x))));
            let before = x.checked_sub(1).map(means).transpose()?;
            let own = means(x)?;
            let behind = (x + 1 < self.plan.nodes).then(|| means(x + 1)).transpose()?;
            let sides = [before.as_deref(), behind.as_deref()];
            Ok(painted.sharpened(place(&self.plan, x), &own, sides))
        })
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
        2 * KEPT_BYTES as u64
    }

    fn digest(&self, _: &mut dyn FnMut(&[u8])) -> Result<()> {
        // The digest of density covers the whole file.
        Ok(())
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.file.load().map(drop)
    }

    fn release(&self) {
        lock(&self.means).clear();
        lock(&self.sharpened).clear();
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
        plane.channel(channel, |node, value| {
            if let Some(out) = out.get_mut(node) {
                *out = self.value(value);
            }
        });
        Ok(0)
    }
}
