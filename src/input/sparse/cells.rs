//! Grids whose values lie in the middle of cells, as fields whose nodes span a box.
//!
//! One node is added beyond each face, a copy of the face's own: so the outer half of the outermost
//! cells stays. A mask of free space cuts the field off at the faces of the cells.

use crate::base::error::{Place, Result};
use crate::model::field::{FreeSpace, Lookup};
use crate::model::grid::{Bounds, Nodes};

use super::path::Lattice;

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
    /// Nodes of the field.
    pub fn nodes(&self) -> Nodes {
        Nodes(self.cells.0.map(|count| count + 2))
    }

    /// The box of the field's nodes.
    ///
    /// # Errors
    /// `Malformed` for a box without extent, at `place`.
    #[expect(clippy::cast_possible_truncation, reason = "a field's box is float32")]
    pub fn bounds(&self, place: &Place) -> Result<Bounds> {
        let mut bounds = Bounds { min: [0.0; 3], max: [0.0; 3] };
        let corners = bounds.min.iter_mut().zip(&mut bounds.max);
        for ((min, max), (radius, center, count)) in corners.zip(self.axes()) {
            let reach = radius * (1.0 + 1.0 / count);
            (*min, *max) = ((center - reach) as f32, (center + reach) as f32);
        }
        bounds.check(place)?;
        Ok(bounds)
    }

    /// The edge of a cube of a cell's volume, in world units.
    #[expect(clippy::cast_possible_truncation, reason = "a field's settings are float32")]
    pub fn voxel_size(&self) -> f32 {
        libm::cbrt(self.axes().map(|(radius, _, count)| 2.0 * radius / count).product()) as f32
    }

    /// The mask that ends at the faces of the cells: of 4 x 4 x 4 nodes the middle ones are inside,
    /// and they reach from face to face.
    pub fn free_space(&self) -> FreeSpace {
        let is_inside = |node: &usize| (1..3).contains(node);
        let nodes = (0..64usize).map(|at| [at / 16, at / 4 % 4, at % 4].iter().all(is_inside));
        let (mut scale, mut shift) = ([0.0; 3], [0.0; 3]);
        let maps = scale.iter_mut().zip(&mut shift);
        for ((scale, shift), (radius, center, _)) in maps.zip(self.axes()) {
            (*scale, *shift) = (1.0 / radius, 1.5 - center / radius);
        }
        let lookup = Lookup::Nearest(nodes.collect());
        FreeSpace { nodes: Nodes([4; 3]), scale, shift, lookup }
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
