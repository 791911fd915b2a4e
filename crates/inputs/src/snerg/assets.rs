//! A folder, ready to be loaded, and its values at nodes.

use std::ops::Range;
use std::sync::Arc;

use super::parameters::Parameters;
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::folder::{
    Atlas, AtlasFiles, AtlasLayout, BORDER, FieldNodes, Folder, Logits, OPACITY, Places, Texel,
};
use crate::lazy::Lazy;
use crate::model::grid::Nodes;
use crate::snerg::layout::{APRON, INDICES, PLANES, feature_name, rgba_name};
use crate::source::SideFile;

/// Limit of colour logits: 8 bits resolve no more.
const LARGEST_LOGIT: f64 = 7.0;

/// The pictures of a folder. Values are premultiplied, so a texel of opacity 0 is empty.
const FILES: AtlasFiles = AtlasFiles {
    indices: INDICES,
    names: |slice| [rgba_name(slice), feature_name(slice)],
    planes: PLANES,
    is_nothing: |[_, _, _, opacity, ..]| *opacity == 0,
};

/// A folder, ready to be loaded.
#[derive(Debug)]
pub(super) struct Assets {
    pub(super) parameters: Parameters,
    folder: Folder,
    places: Places,
    limits: Limits,
    loaded: Lazy<Atlas>,
}

impl Assets {
    /// Checks all pictures. Returns them with a digest of each.
    pub(super) fn find(
        folder: Folder,
        parameters: Parameters,
        has_features: bool,
        limits: &Limits,
    ) -> Result<(Self, Vec<SideFile>)> {
        let layout = AtlasLayout {
            files: FILES,
            counts: parameters.blocks(),
            edge: parameters.edge(),
            size: parameters.atlas,
            has_features,
        };
        let (places, found) = Places::find(&folder, layout, limits)?;
        let (limits, loaded) = (limits.clone(), Lazy::default());
        Ok((Self { parameters, folder, places, limits, loaded }, found))
    }

    /// The atlas, read on first use.
    pub(super) fn atlas(&self) -> Result<Arc<Atlas>> {
        let Self { folder, places, limits, .. } = self;
        self.loaded.get(|| places.load(folder, &mut Budget::new(limits), limits))
    }

    /// The texels of a plane of nodes, z fastest; zeros beyond the faces.
    fn plane(&self, x: usize) -> Result<Vec<Texel>> {
        let (nodes, axes, grid) = (self.nodes(), &self.parameters.axes, self.parameters.grid.0);
        let Nodes([nx, ny, nz]) = nodes;
        let mut texels = vec![[0; 8]; ny * nz];
        if !(BORDER..nx - BORDER).contains(&x) {
            return Ok(texels);
        }
        // The voxel of a node along an axis, or the node of a voxel: the mapping is its own
        // inverse.
        let turned = |axis: usize, at: usize| match axes.of_world(axis) {
            (own, true) => grid.get(own).map_or(0, |count| count - 1 - at),
            (_, false) => at,
        };
        let (own, _) = axes.of_world(0);
        let at = turned(0, x - BORDER);
        visit_plane(&*self.atlas()?, self.parameters.block, own, at, |voxel, texel| {
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
}

/// Calls `visit` with all voxels above opacity 0 in a plane of blocks of `edge` voxels per side.
fn visit_plane(
    atlas: &Atlas,
    edge: usize,
    axis: usize,
    at: usize,
    mut visit: impl FnMut([usize; 3], Texel),
) {
    let along = |other: usize, count: usize, own: usize| match other == axis {
        true => own..own + 1,
        false => 0..count,
    };
    let blocks = |axis: usize| along(axis, atlas.counts.get(axis).copied().unwrap_or(0), at / edge);
    let voxels = |axis: usize| along(axis, edge, at % edge);
    for number in places([blocks(0), blocks(1), blocks(2)]) {
        let Some(block) = atlas.block(number) else { continue };
        for local in places([voxels(0), voxels(1), voxels(2)]) {
            let texel = block.texel(local.map(|at| at + APRON));
            if texel != [0; 8] {
                let mut voxel = local;
                voxel.iter_mut().zip(number).for_each(|(at, block)| *at += block * edge);
                visit(voxel, texel);
            }
        }
    }
}

/// The places in a box, x fastest.
fn places([xs, ys, zs]: [Range<usize>; 3]) -> impl Iterator<Item = [usize; 3]> {
    zs.flat_map(move |z| {
        let xs = xs.clone();
        ys.clone().flat_map(move |y| xs.clone().map(move |x| [x, y, z]))
    })
}

impl FieldNodes for Assets {
    fn nodes(&self) -> Nodes {
        self.parameters.cells().nodes()
    }

    fn memory_bytes(&self) -> u64 {
        let Nodes([_, ny, nz]) = self.nodes();
        self.places.memory_bytes() + 32 * (ny * nz) as u64
    }

    fn load(&self) -> Result<()> {
        self.atlas().map(drop)
    }

    fn opacities(&self, x: usize) -> Result<Vec<f64>> {
        let texels = self.plane(x)?.into_iter();
        Ok(texels.map(|[_, _, _, opacity, ..]| f64::from(opacity) / 255.0).collect())
    }

    fn logits(&self, x: usize) -> Result<impl Fn([usize; 2]) -> Logits> {
        let Nodes([nx, ny, nz]) = self.nodes();
        let near = x.saturating_sub(1)..(x + 2).min(nx);
        let planes: Vec<Vec<Texel>> = near.map(|x| self.plane(x)).collect::<Result<_>>()?;
        Ok(move |[y, z]: [usize; 2]| {
            let own = planes.get(x.min(1)).and_then(|plane| plane.get(y * nz + z));
            let mut sums = own.copied().unwrap_or([0; 8]).map(u32::from);
            if sums.get(OPACITY) == Some(&0) {
                let rows = y.saturating_sub(1)..(y + 2).min(ny);
                for row in planes
                    .iter()
                    .flat_map(|plane| rows.clone().filter_map(|y| plane.get(y * nz..(y + 1) * nz)))
                {
                    let near = row.get(z.saturating_sub(1)..(z + 2).min(nz));
                    for texel in near.unwrap_or_default() {
                        let terms = sums.iter_mut().zip(texel);
                        terms.for_each(|(sum, value)| *sum += u32::from(*value));
                    }
                }
            }
            let [red, green, blue, opacity, a, b, c, d] = sums;
            [red, green, blue, a, b, c, d].map(|value| logit(value, opacity))
        })
    }
}

/// The logit of a premultiplied colour; 0 at opacity 0.
#[expect(clippy::cast_possible_truncation, reason = "logits are float32")]
fn logit(value: u32, opacity: u32) -> f32 {
    if opacity == 0 {
        return 0.0;
    }
    let color = f64::from(value.min(opacity)) / f64::from(opacity);
    let logit = libm::log(color / (1.0 - color));
    logit.clamp(-LARGEST_LOGIT, LARGEST_LOGIT) as f32
}
