//! Grids with values in the middle of cells, as fields whose nodes span a box.
//!
//! One node is added beyond each face, a copy of the face's own, so that the outer half of the
//! outermost cells stays, and rays are sampled from face to face of the cells.

use crate::base::error::{Error, Place, Result};
use crate::model::field::Lattice as FieldLattice;
use crate::model::grid::{Bounds, Nodes};

use super::path::Lattice;

/// Edges of cells that differ by up to this share count as equal, because settings are float32.
const SAME_EDGE: f32 = 1e-6;
/// Maximum ratio of a box's longest edge to its shortest. Rays along thinner boxes take too many
/// steps.
const WIDEST: f64 = 1e6;

/// A box of cells.
#[derive(Debug, Clone, Copy)]
pub struct CellBox {
    /// Half the box's edges, in world units.
    pub radius: [f64; 3],
    /// Its middle.
    pub center: [f64; 3],
    /// Cells along each axis.
    pub cells: Nodes,
}

impl CellBox {
    /// Nodes beyond each face.
    pub const BORDER: usize = 1;

    /// Nodes of the field.
    pub fn nodes(&self) -> Nodes {
        Nodes(self.cells.0.map(|count| count + 2 * Self::BORDER))
    }

    /// The box of the field's nodes.
    ///
    /// # Errors
    /// `Malformed`, at the place of the radius, for a box without extent or one that is too thin;
    /// at the place of the middle, for a middle far from 0.
    pub fn bounds(&self, [place, center]: [&Place; 2]) -> Result<Bounds> {
        let is_far = |at: &f64| !(-Bounds::FARTHEST..=Bounds::FARTHEST).contains(at);
        if let Some(far) = self.radius.into_iter().find(is_far) {
            let found = format!("half an edge of {far}");
            return Err(Error::malformed(place.clone(), found, "edges up to 2e10"));
        }
        if let Some(far) = self.center.into_iter().find(is_far) {
            let found = format!("the middle of a box at {far}");
            return Err(Error::malformed(center.clone(), found, "one within 1e10 of 0"));
        }
        let radii = self.radius.map(f64::abs);
        let [thinnest, widest] =
            [f64::min, f64::max].map(|end| radii.into_iter().fold(radii[0], end));
        if thinnest * WIDEST < widest {
            let found = format!("half edges {:?}", self.radius);
            let expected = format!("edges that differ by a factor of up to {WIDEST}");
            return Err(Error::malformed(place.clone(), found, expected));
        }
        let FieldLattice { bounds, .. } = self.lattice_beyond(Self::BORDER);
        bounds.check_model(place)?;
        Ok(bounds)
    }

    /// For nodes in the middles of all cells, and this many beyond each face.
    pub fn lattice_beyond(&self, border: usize) -> FieldLattice {
        let more = 2.0 * border as f64 - 1.0;
        let bounds = self.reaching(|radius, count| radius * (1.0 + more / count));
        FieldLattice::new(bounds, Nodes(self.cells.0.map(|count| count + 2 * border)))
    }

    /// The box of the cells.
    pub fn faces(&self) -> Bounds {
        self.reaching(|radius, _| radius)
    }

    /// The box with this reach from the middle, from half the box's edge and the cells along it.
    #[expect(clippy::cast_possible_truncation, reason = "a field's box is float32")]
    fn reaching(&self, reach: impl Fn(f64, f64) -> f64) -> Bounds {
        let mut bounds = Bounds { min: [0.0; 3], max: [0.0; 3] };
        let corners = bounds.min.iter_mut().zip(&mut bounds.max);
        for ((min, max), (radius, center, count)) in corners.zip(self.axes()) {
            let reach = reach(radius, count);
            (*min, *max) = ((center - reach) as f32, (center + reach) as f32);
        }
        bounds
    }

    /// The edge of a cube of a cell's volume, in world units.
    #[expect(clippy::cast_possible_truncation, reason = "a field's settings are float32")]
    pub fn voxel_size(&self) -> f32 {
        libm::cbrt(self.axes().map(|(radius, _, count)| 2.0 * radius / count).product()) as f32
    }

    /// Edges of a cell in world units, if they differ.
    #[expect(clippy::cast_possible_truncation, reason = "a field's settings are float32")]
    pub fn voxel(&self) -> Option<[f32; 3]> {
        let mut edges = [0.0; 3];
        for (edge, (radius, _, count)) in edges.iter_mut().zip(self.axes()) {
            *edge = (2.0 * radius / count) as f32;
        }
        let cube = self.voxel_size();
        edges.iter().any(|edge| (edge / cube - 1.0).abs() > SAME_EDGE).then_some(edges)
    }

    /// Positions in cells, 0 being the middle of the first one; samples lie within the cells.
    pub fn lattice(&self) -> Lattice {
        let (mut origin, mut per_unit, mut faces) = ([0.0; 3], [0.0; 3], [[0.0; 2]; 3]);
        let maps = origin.iter_mut().zip(&mut per_unit).zip(&mut faces);
        for (((origin, per_unit), faces), (radius, center, count)) in maps.zip(self.axes()) {
            *per_unit = count / (2.0 * radius);
            *origin = center - radius + 0.5 / *per_unit;
            *faces = [-0.5, count - 0.5];
        }
        Lattice { origin, per_unit, faces }
    }

    /// Radius, middle and count along each axis.
    fn axes(&self) -> impl Iterator<Item = (f64, f64, f64)> {
        let axes = self.radius.into_iter().zip(self.center).zip(self.cells.0);
        axes.map(|((radius, center), count)| (radius, center, count as f64))
    }
}
