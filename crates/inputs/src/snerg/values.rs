//! Density and colours at nodes, plane by plane.

use std::sync::Arc;

use super::atlas::{Atlas, Places};
use super::block::{OPACITY, Texel};
use super::files::Pictures;
use super::parameters::Parameters;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::progress::{Progress, Silent};
use crate::folder::raw_density;
use crate::lazy::Lazy;
use crate::model::field::NodeValues;
use crate::model::grid::Nodes;
use crate::network::{PlaneCache, visit};
use crate::snerg::layout::PLANES;

/// Logits of colours reach so far: 8 bits tell no more.
const LARGEST_LOGIT: f64 = 7.0;
/// Nodes of nothing beyond each face.
const BORDER: usize = 1;

/// A folder, ready to be loaded.
#[derive(Debug)]
pub(super) struct Folder {
    pub(super) parameters: Parameters,
    pub(super) pictures: Pictures,
    pub(super) places: Places,
    limits: Limits,
    loaded: Lazy<Atlas>,
}

impl Folder {
    pub(super) fn new(
        parameters: Parameters,
        pictures: Pictures,
        places: Places,
        limits: &Limits,
    ) -> Self {
        let (limits, loaded) = (limits.clone(), Lazy::default());
        Self { parameters, pictures, places, limits, loaded }
    }

    /// The atlas, read when it is first asked for.
    pub(super) fn atlas(&self) -> Result<Arc<Atlas>> {
        let Self { parameters, pictures, places, limits, .. } = self;
        self.loaded.get(|| Atlas::load(pictures, places, parameters, limits))
    }

    fn nodes(&self) -> Nodes {
        self.parameters.cells().nodes()
    }

    /// The texels of a plane of nodes, z fastest; zeros beyond the faces.
    fn plane(&self, x: usize) -> Result<Vec<Texel>> {
        let (nodes, axes, grid) = (self.nodes(), &self.parameters.axes, self.parameters.grid.0);
        let Nodes([nx, ny, nz]) = nodes;
        let mut texels = vec![[0; 8]; ny * nz];
        if !(BORDER..nx - BORDER).contains(&x) {
            return Ok(texels);
        }
        let atlas = self.atlas()?;
        // A voxel along an axis of the world, or a node's voxel; the same both ways.
        let turned = |axis: usize, at: usize| match axes.of_world(axis) {
            (own, true) => grid.get(own).map_or(0, |count| count - 1 - at),
            (_, false) => at,
        };
        let (own, _) = axes.of_world(0);
        atlas.plane(own, turned(0, x - BORDER), |voxel, texel| {
            let [y, z] = [1, 2].map(|axis| {
                let (own, _) = axes.of_world(axis);
                turned(axis, voxel.get(own).copied().unwrap_or(0)) + BORDER
            });
            if y < ny
                && let Some(out) = texels.get_mut(y * nz + z).filter(|_| z < nz)
            {
                *out = texel;
            }
        });
        Ok(texels)
    }

    /// Bytes of the blocks, at most, and of pictures and planes.
    fn memory_bytes(&self) -> u64 {
        let [width, height, _] = self.parameters.atlas.map(|size| size as u64);
        let Nodes([_, ny, nz]) = self.nodes();
        let texels = self.places.full_count() * self.parameters.edge().pow(3);
        8 * texels as u64 + 2 * 4 * PLANES as u64 * width * height + 32 * (ny * nz) as u64
    }
}

fn digest(hash: &mut dyn FnMut(&[u8])) -> Result<()> {
    // The digests of pictures have the checksums of all values.
    hash(&[]);
    Ok(())
}

/// Raw densities, whose opacity is a voxel's.
#[derive(Debug)]
pub(super) struct DensityValues(pub(super) Arc<Folder>);

impl NodeValues for DensityValues {
    fn nodes(&self) -> Nodes {
        self.0.nodes()
    }

    fn channels(&self) -> usize {
        1
    }

    fn memory_bytes(&self) -> u64 {
        self.0.memory_bytes()
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        digest(hash)
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.0.atlas().map(drop)
    }

    fn read(&self, _: usize, x: usize, _: &[u64], out: &mut [f32]) -> Result<u64> {
        let texels = self.0.plane(x)?;
        for (out, [_, _, _, opacity, ..]) in out.iter_mut().zip(texels) {
            *out = raw_density(f64::from(opacity) / 255.0);
        }
        Ok(0)
    }
}

/// Logits of diffuse colours, then of features.
#[derive(Debug)]
pub(super) struct ColorValues {
    folder: Arc<Folder>,
    channels: usize,
    planes: PlaneCache,
}

impl ColorValues {
    pub(super) fn new(folder: Arc<Folder>, channels: usize) -> Self {
        Self { folder, channels, planes: PlaneCache::default() }
    }
}

impl NodeValues for ColorValues {
    fn nodes(&self) -> Nodes {
        self.folder.nodes()
    }

    fn channels(&self) -> usize {
        self.channels
    }

    fn memory_bytes(&self) -> u64 {
        self.planes.bytes(self.nodes(), self.channels)
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        digest(hash)
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.folder.atlas().map(drop)
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let (plane, nodes) = (out.len(), self.nodes());
        let Nodes([nx, ny, nz]) = nodes;
        let channels = [channel, self.channels];
        // Before the plane is locked.
        self.prepare(&Silent)?;
        self.planes.read(self.nodes(), x, channels, region, out, |region, values| {
            let near = x.saturating_sub(1)..(x + 2).min(nx);
            let planes: Vec<Vec<Texel>> =
                near.map(|x| self.folder.plane(x)).collect::<Result<_>>()?;
            let own = planes.get(x.min(1)).map_or(&[][..], Vec::as_slice);
            visit(nodes, region, |[y, z]| {
                let node = y * nz + z;
                let texel = own.get(node).copied().unwrap_or([0; 8]);
                let mut sums = texel.map(u32::from);
                if sums.get(OPACITY) == Some(&0) {
                    let rows = y.saturating_sub(1)..(y + 2).min(ny);
                    for row in planes.iter().flat_map(|plane| {
                        rows.clone().filter_map(|y| plane.get(y * nz..(y + 1) * nz))
                    }) {
                        let near = row.get(z.saturating_sub(1)..(z + 2).min(nz));
                        for texel in near.unwrap_or_default() {
                            let terms = sums.iter_mut().zip(texel);
                            terms.for_each(|(sum, value)| *sum += u32::from(*value));
                        }
                    }
                }
                let [red, green, blue, opacity, features @ ..] = sums;
                let channels = [red, green, blue].into_iter().chain(features);
                let out = values.iter_mut().skip(node).step_by(plane);
                out.zip(channels).for_each(|(out, value)| *out = logit(value, opacity));
            });
            Ok(())
        })?;
        Ok(0)
    }
}

/// The logit of a colour that was multiplied by an opacity; 0 where there is none.
#[expect(clippy::cast_possible_truncation, reason = "logits are float32")]
fn logit(value: u32, opacity: u32) -> f32 {
    if opacity == 0 {
        return 0.0;
    }
    let color = f64::from(value.min(opacity)) / f64::from(opacity);
    let logit = libm::log(color / (1.0 - color));
    logit.clamp(-LARGEST_LOGIT, LARGEST_LOGIT) as f32
}
