//! The three planes.

use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::folder::{Folder, RGBA, Texel, Texels};
use crate::source::SideFile;
use crate::sparse::whole;

/// The axes of each plane, the picture's columns first.
const AXES: [[usize; 2]; 3] = [[1, 2], [0, 2], [0, 1]];

fn names(plane: usize) -> [String; 2] {
    [format!("plane_rgb_and_density_{plane}.png"), format!("plane_features_{plane}.png")]
}

/// The planes of a folder.
#[derive(Debug)]
pub(super) struct Planes {
    /// Texels along an edge.
    edge: usize,
    /// Of each plane, row by row.
    texels: [Vec<Texel>; 3],
}

/// Checks the pictures.
pub(super) fn look(folder: &Folder, edge: usize) -> Result<Vec<SideFile>> {
    let names = [0, 1, 2].into_iter().flat_map(names);
    names.map(|name| folder.look("planes", name, [edge; 2], &[RGBA])).collect()
}

/// Bytes of the planes in memory.
pub(super) fn memory_bytes(edge: usize) -> u64 {
    (3 * size_of::<Texel>() * edge * edge) as u64
}

impl Planes {
    /// Reads the pictures.
    pub(super) fn read(
        folder: &Folder,
        edge: usize,
        budget: &mut Budget,
        limits: &Limits,
    ) -> Result<Self> {
        budget.spend(memory_bytes(edge), "bytes of planes", &Place::File)?;
        let mut texels = [Vec::new(), Vec::new(), Vec::new()];
        for (number, texels) in texels.iter_mut().enumerate() {
            let read = Texels::read(folder, &names(number), true, [edge; 2], limits)?;
            *texels = read.run(0, edge * edge).collect();
        }
        Ok(Self { edge, texels })
    }

    /// Adds the codes at a position in texels, each plane interpolated by itself.
    pub(super) fn add(&self, at: [f64; 3], sums: &mut [f64; 8]) {
        let last = self.edge - 1;
        for (texels, axes) in self.texels.iter().zip(AXES) {
            let [across, down] = axes.map(|axis| {
                // Values lie in the middle of texels; the outermost ones reach to the edge.
                let at = at.get(axis).copied().unwrap_or(0.0) - 0.5;
                let at = at.clamp(0.0, last as f64);
                let low = whole(at).min(last.saturating_sub(1));
                [(low, 1.0 - (at - low as f64)), ((low + 1).min(last), at - low as f64)]
            });
            for (row, of_row) in down {
                for (column, of_column) in across {
                    let Some(texel) = texels.get(row * self.edge + column) else { continue };
                    let terms = sums.iter_mut().zip(texel);
                    terms.for_each(|(sum, code)| *sum += of_row * of_column * f64::from(*code));
                }
            }
        }
    }
}
