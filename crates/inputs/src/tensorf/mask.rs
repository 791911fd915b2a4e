//! The mask of free space: one bit for a node, in a box that may be larger than the model's.

use super::read::{corners, key, malformed};
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::model::field::{FreeSpace, Lookup};
use crate::model::grid::{Bounds, Nodes};
use crate::tensor::{Tensor, Value};

/// Any set node near a position makes it visible: a threshold below every nonzero float32 share.
const THRESHOLD: f32 = 1e-6;

/// A mask with unread bits.
#[derive(Debug, Clone)]
pub(super) struct MaskFile {
    bits: Tensor,
    nodes: Nodes,
    bounds: Bounds,
}

/// A mask in memory.
#[derive(Debug)]
pub(super) struct Mask {
    /// z fastest.
    inside: Vec<bool>,
    nodes: [usize; 3],
    origin: [f64; 3],
    /// Nodes for a world unit.
    per_unit: [f64; 3],
}

impl MaskFile {
    /// The mask of a file, if training made one.
    pub(super) fn find(root: &Value, limits: &Limits) -> Result<Option<Self>> {
        let Some(bits) = root.get("alphaMask.mask") else { return Ok(None) };
        let bits = bits.tensor().ok_or_else(|| {
            malformed("alphaMask.mask", bits.describe(), "an array of bytes, one bit per node")
        })?;
        let shape = root.get("alphaMask.shape").map(|shape| shape.numbers("alphaMask.shape"));
        let shape = shape.transpose()?.unwrap_or_default();
        let &[_, _, z, y, x] = shape.as_slice() else {
            return Err(malformed("alphaMask.shape", format!("{shape:?}"), "[1, 1, z, y, x]"));
        };
        let expected = "integer numbers of nodes, at least 2 along each axis";
        let whole = |count: f64| (2.0..=1e6).contains(&count) && count.fract() == 0.0;
        if ![x, y, z].into_iter().all(whole) {
            return Err(malformed("alphaMask.shape", format!("{shape:?}"), expected));
        }
        #[expect(clippy::cast_possible_truncation, reason = "checked above")]
        let counts = [x, y, z].map(|count| count as u64);
        let nodes = Nodes::checked(counts, limits, &key("alphaMask.shape"))?;
        let bounds = corners(root.get("alphaMask.aabb"), "alphaMask.aabb")?;
        if bits.bytes() != nodes.count().div_ceil(8) as u64 {
            let found = format!("{} bytes for {:?} nodes", bits.bytes(), nodes.0);
            return Err(malformed("alphaMask.mask", found, "a bit for each node"));
        }
        Ok(Some(Self { bits: bits.clone(), nodes, bounds }))
    }

    /// Reads the bits.
    pub(super) fn load(&self, budget: &mut Budget) -> Result<Mask> {
        let storage = self.bits.storage(budget)?;
        let place = self.bits.place();
        let bytes = usize::try_from(self.bits.bytes()).unwrap_or(0);
        let mut packed: Vec<u8> = budget.zeroed(bytes, "bytes of a mask", &place)?;
        storage.read_into(0, &mut packed)?;
        let mut inside: Vec<bool> = budget.zeroed(self.nodes.count(), "bytes of a mask", &place)?;
        let [nx, ny, nz] = self.nodes.0;
        for x in 0..nx {
            for y in 0..ny {
                for z in 0..nz {
                    // x is fastest in the file.
                    let bit = (z * ny + y) * nx + x;
                    let byte = packed.get(bit / 8).copied().unwrap_or(0);
                    if let Some(inside) = inside.get_mut((x * ny + y) * nz + z) {
                        *inside = byte >> (7 - bit % 8) & 1 == 1;
                    }
                }
            }
        }
        let per_unit = self.nodes.spacing(&self.bounds).map(|spacing| 1.0 / spacing);
        let origin = self.bounds.min.map(f64::from);
        Ok(Mask { inside, nodes: self.nodes.0, origin, per_unit })
    }

    /// The mask for a field. Interpolation reaches a cell beyond the outermost nodes, so one unset
    /// node is added beyond each face.
    pub(super) fn free_space(&self, limits: &Limits) -> Result<FreeSpace> {
        let mut budget = Budget::new(limits);
        let mask = self.load(&mut budget)?;
        let nodes = Nodes(self.nodes.0.map(|count| count + 2));
        let place = self.bits.place();
        let mut values: Vec<f32> = budget.zeroed(nodes.count(), "bytes of a mask", &place)?;
        let ([_, ny, nz], [_, outer_y, outer_z]) = (self.nodes.0, nodes.0);
        for (number, row) in mask.inside.chunks_exact(nz).enumerate() {
            let (x, y) = (number / ny, number % ny);
            let first = ((x + 1) * outer_y + y + 1) * outer_z + 1;
            let out = values.get_mut(first..first + nz).unwrap_or_default();
            out.iter_mut().zip(row).for_each(|(out, &set)| *out = f32::from(u8::from(set)));
        }
        let scale = mask.per_unit;
        let mut shift = [0.0; 3];
        let axes = shift.iter_mut().zip(mask.origin).zip(scale);
        axes.for_each(|((shift, origin), scale)| *shift = 1.0 - origin * scale);
        let lookup = Lookup::Trilinear { values, threshold: THRESHOLD };
        Ok(FreeSpace { nodes, scale, shift, lookup })
    }
}

impl Mask {
    /// True where the interpolated mask is above 0; beyond the outermost nodes it falls to 0.
    pub(super) fn contains(&self, world: [f64; 3]) -> bool {
        let mut corners = [[None; 2]; 3];
        let axes = world.into_iter().zip(self.origin).zip(self.per_unit).zip(self.nodes);
        for (corners, (((world, origin), per_unit), count)) in corners.iter_mut().zip(axes) {
            let at = (world - origin) * per_unit;
            if !(at > -1.0 && at < count as f64) {
                return false;
            }
            let low = at.floor();
            let node = |at: f64| {
                #[expect(clippy::cast_possible_truncation, reason = "a node's number")]
                (at >= 0.0 && at < count as f64).then_some(at as usize)
            };
            *corners = [node(low), if at > low { node(low + 1.0) } else { None }];
        }
        let [xs, ys, zs] = corners;
        let [_, ny, nz] = self.nodes;
        xs.into_iter().flatten().any(|x| {
            ys.into_iter().flatten().any(|y| {
                zs.into_iter()
                    .flatten()
                    .any(|z| self.inside.get((x * ny + y) * nz + z).copied().unwrap_or(false))
            })
        })
    }
}
