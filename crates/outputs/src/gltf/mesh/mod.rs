//! A triangle mesh of a baked field, for viewers that cannot march it.
//!
//! 1. **OpacityGrid** ([`opacity_grid`]): the nodes of one level, each with its opacity over the
//!    thickness of a surface and its diffuse colour. Empty nodes that cannot be reached from
//!    outside count as opaque.
//! 2. **Surface** ([`surface`]): the surface at which half the light passes that thickness, by
//!    surface nets: one vertex for each cell that the surface goes through, at the mean of its
//!    crossings, and a quad around each edge that it crosses. Its vertices lie in the box, and it
//!    has no border.
//! 3. **Simplify** ([`simplify`]): edges with the least loss collapse, the quadric error of Garland
//!    and Heckbert (1997), down to the requested number of triangles.
//! 4. **Appearance** ([`appearance`]): each vertex gets the mean colour as seen from around it.
//!
//! All steps use float64 in a fixed order. Colours are converted from display-referred sRGB to
//! glTF's linear values only at the end.

mod appearance;
mod field_mesh;
mod incidence;
mod losses;
mod opacity_grid;
mod quadric;
mod simplify;
mod surface;
mod triangles;
mod vector;

pub use field_mesh::{FEWEST_TRIANGLES, meshes};
pub use triangles::Mesh;
