//! A triangle mesh of a baked field, for viewers that cannot march it.
//!
//! 1. **OpacityGrid** ([`opacity_grid`]): the nodes of one level, each with its opacity over the
//!    thickness of a surface and its diffuse colour. Empty nodes that no path from outside reaches count as
//!    opaque.
//! 2. **Surface** ([`surface`]): the surface at which half the light passes that thickness, by surface
//!    nets: one vertex for each cell that the surface goes through, at the mean of its crossings,
//!    and a quad around each edge that it crosses. Its vertices lie in the box, and it has no
//!    border.
//! 3. **Simplify** ([`simplify`]): edges collapse, the one first whose loss is least, by the
//!    quadric error of Garland and Heckbert (1997), down to the triangles that were asked for.
//!
//! 4. **Appearance** ([`appearance`]): each vertex gets the mean colour that eyes around it see.
//!
//! All in float64 and in a fixed order. Colours leave display-referred sRGB for linear values, as
//! glTF wants them, at the end alone.

mod appearance;
mod field_mesh;
mod opacity_grid;
mod simplify;
mod surface;
mod triangles;
mod vector;

pub use field_mesh::{FEWEST_TRIANGLES, meshes};
pub use triangles::Mesh;
