//! Values at nodes.

use super::parameters::LOW;
use super::sums::{Assets, Sums, density};
use crate::base::error::Result;
use crate::folder::{BORDER, FieldNodes, Logits};
use crate::model::grid::Nodes;

/// Sums at node `node`, if it may be occupied.
fn at_node(sums: &Sums, node: [usize; 3]) -> Option<[f64; 8]> {
    let (parameters, Nodes(counts)) = (&sums.parameters, sums.parameters.cells().nodes());
    let mut voxel = [0; 3];
    for (axis, (at, count)) in node.into_iter().zip(counts).enumerate() {
        let (own, flipped) = parameters.axes.of_world(axis);
        let at = if flipped { count - 1 - at } else { at };
        if let Some(voxel) = voxel.get_mut(own) {
            *voxel = parameters.resolution() / 4 + at - BORDER;
        }
    }
    if !sums.occupancy.is_near(voxel) {
        return None;
    }
    let edge = parameters.voxel_size();
    sums.at(voxel.map(|at| LOW + (at as f64 + 0.5) * edge), edge)
}

impl FieldNodes for Assets {
    fn nodes(&self) -> Nodes {
        self.parameters.cells().nodes()
    }

    fn memory_bytes(&self) -> u64 {
        self.bytes()
    }

    fn load(&self) -> Result<()> {
        self.sums().map(drop)
    }

    fn opacities(&self, x: usize) -> Result<Vec<f64>> {
        let (sums, Nodes([_, ny, nz])) = (self.sums()?, self.nodes());
        let edge = self.parameters.voxel_size();
        let opacity = |[_, _, _, sum, ..]: [f64; 8]| -libm::expm1(-density(sum) * edge);
        let nodes = (0..ny * nz).map(|at| at_node(&sums, [x, at / nz, at % nz]));
        Ok(nodes.map(|found| found.map_or(0.0, opacity)).collect())
    }

    #[expect(clippy::cast_possible_truncation, reason = "logits are float32")]
    fn logits(&self, x: usize) -> Result<impl Fn([usize; 2]) -> Logits> {
        let sums = self.sums()?;
        Ok(move |[y, z]: [usize; 2]| {
            let found = at_node(&sums, [x, y, z]).unwrap_or_default();
            let [red, green, blue, _, a, b, c, d] = found;
            [red, green, blue, a, b, c, d].map(|value| value as f32)
        })
    }
}
