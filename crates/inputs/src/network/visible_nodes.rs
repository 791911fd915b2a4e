//! The nodes whose colour can be visible.
//!
//! A sample is coloured if its weight is above the colour threshold of the march. Its weight is at
//! most its opacity, and that is at most the largest one of its cell's corners. A node without such
//! a corner in any of its cells is black in the model's own pictures, so the network is not
//! evaluated there.

use super::planes::PlaneCache;
use crate::base::error::Result;
use crate::model::field::{Nonfinite, Planes, RadianceField};
use crate::model::grid::{Nodes, row};

/// Opacities that rounding may raise above the threshold count as above.
const SLACK: f64 = 0.999;

/// The most recently read densities of a field.
#[derive(Debug, Default)]
pub(super) struct VisibleNodes {
    densities: PlaneCache,
}

impl VisibleNodes {
    /// Bytes of the densities that are kept.
    pub(super) fn memory_bytes(&self, nodes: Nodes) -> u64 {
        self.densities.bytes(nodes, 1)
    }

    /// The nodes of a region of plane `x` that are a corner of a cell of `geometry` with a corner
    /// above its colour threshold.
    ///
    /// # Errors
    /// Errors of reading density.
    pub(super) fn within(
        &self,
        geometry: &RadianceField,
        x: usize,
        region: &[u64],
    ) -> Result<Vec<u64>> {
        let scene = &geometry.scene;
        let threshold = f64::from(scene.march.color_threshold) * SLACK;
        if threshold <= 0.0 {
            return Ok(region.to_vec());
        }
        #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
        let least = scene.activation.raw_at_opacity(threshold) as f32;
        let planes = Planes::new(geometry, None, Nonfinite::Empty);
        let Nodes([nx, ny, nz]) = scene.nodes;
        let near = with_neighbours(scene.nodes, region);
        let (mut above, mut values) = (vec![0; region.len()], vec![0.0; ny * nz]);
        for x in x.saturating_sub(1)..(x + 2).min(nx) {
            let all = [0, 1];
            self.densities.read(scene.nodes, x, all, &near, &mut values, |missing, values| {
                planes.read(0, x, missing, values, false).map(|_| ())
            })?;
            let mut plane = vec![0; region.len()];
            let rows = plane.chunks_exact_mut(row::words(scene.nodes));
            rows.zip(values.chunks_exact(nz)).for_each(|(row, values)| {
                row::pack_above(values, least, row);
            });
            row::and_into(&mut plane, &near);
            row::or_into(&mut above, &plane);
        }
        let mut shaded = with_neighbours(scene.nodes, &above);
        row::and_into(&mut shaded, region);
        Ok(shaded)
    }
}

/// A plane's set with the neighbours of its nodes along y and z.
fn with_neighbours(nodes: Nodes, plane: &[u64]) -> Vec<u64> {
    let (Nodes([_, _, nz]), words) = (nodes, row::words(nodes));
    let mut along_z = plane.to_vec();
    for row in along_z.chunks_exact_mut(words) {
        row::or_shifted_up(row);
        row::or_shifted_down(row);
        row::clear_from(row, nz);
    }
    let mut all = along_z.clone();
    all.iter_mut().skip(words).zip(&along_z).for_each(|(word, below)| *word |= below);
    all.iter_mut().zip(along_z.iter().skip(words)).for_each(|(word, above)| *word |= above);
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::grid::NodeMask;

    #[test]
    fn a_node_is_shaded_if_a_neighbour_is_opaque() {
        for nodes in [[2, 2, 2], [5, 3, 70], [4, 9, 64], [7, 2, 130]] {
            // Faint, except for a few nodes.
            let [nx, ny, nz] = nodes;
            let is_dense = |node: [usize; 3]| (node[0] * 7 + node[1] * 3 + node[2]) % 37 == 1;
            let place = |at: usize| [at / (ny * nz), at / nz % ny, at % nz];
            let raw = |at: usize| if is_dense(place(at)) { 3.0 } else { -20.0 };
            let count = nx * ny * nz;
            let density = (0..count).map(raw).collect();
            let field = RadianceField::builder(nodes, density, vec![0.0; 3 * count]);
            let field = field.build().expect("a field");
            assert!(field.scene.march.color_threshold > 0.0);
            let shaded = VisibleNodes::default();
            let (full, near) = (NodeMask::full(Nodes(nodes)), |at: usize, end: usize| {
                at.saturating_sub(1)..(at + 2).min(end)
            });
            for x in 0..nx {
                let found = shaded.within(&field, x, full.plane(x)).expect("densities");
                for (y, row) in found.chunks_exact(full.row_words()).enumerate() {
                    for z in 0..nz {
                        let is_near = near(x, nx)
                            .any(|x| near(y, ny).any(|y| near(z, nz).any(|z| is_dense([x, y, z]))));
                        assert_eq!(row::get(row, z), is_near, "{nodes:?} at {x} {y} {z}");
                    }
                }
            }
        }
    }

    #[test]
    fn every_node_is_shaded_without_a_threshold() {
        let builder = RadianceField::builder([3; 3], vec![-20.0; 27], vec![0.0; 81]);
        let mut field = builder.build().expect("a field");
        field.scene.march.color_threshold = 0.0;
        let found = VisibleNodes::default().within(&field, 1, &[5, 7, 2]).expect("no densities");
        assert_eq!(found, [5, 7, 2]);
    }
}
