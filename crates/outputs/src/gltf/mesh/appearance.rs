//! The colours of a mesh: the field's own, as seen from around each vertex.
//!
//! Rays start a few cells outside of a vertex and end as far behind it, one along its normal and
//! three tilted by 45 degrees. A vertex gets the mean of their light without background, divided by the mean of
//! their opacity. So the network, harmonics and low density in front of a surface count as in
//! pictures. Vertices whose rays hit hardly anything keep the colour of their nodes.

use glam::DVec3;

use super::triangles::TriangleSoup;
use crate::base::error::Result;
use crate::base::progress::Silent;
use crate::container::Container;
use crate::model::camera::Ray;
use crate::view::render::Renderer;

/// Distance from a ray's start to its vertex, in cells: the thickness of a surface of fog.
const REACH: f64 = 3.0;
/// Rays of a vertex.
const RAYS: usize = 4;
/// Minimum mean opacity of a vertex's rays for a colour.
const LEAST_OPACITY: f64 = 0.1;

/// The field of a container, for rays from close to its surfaces.
///
/// # Errors
/// A field whose rules cannot be rendered.
pub fn renderer(container: &Container) -> Result<Renderer> {
    let mut field = Renderer::of_container(container)?;
    let view = field.view_mut();
    // Rays start at surfaces, closer than any camera of the scene.
    (view.march.near, view.march.far, view.background) = (0.0, None, [0.0; 3]);
    Ok(field)
}

/// Gives the vertices the colours of the finest level that `field`, a [`renderer`], has. `cell` is
/// the edge of a cell of the grid that the mesh was made of, in world units.
///
/// # Errors
/// Errors of rendering.
pub fn color(soup: &mut TriangleSoup, field: &mut Renderer, cell: f64) -> Result<()> {
    field.view_mut().reach = Some(2.0 * REACH * cell);
    let rays: Vec<Ray> = soup
        .positions
        .iter()
        .zip(soup.normals())
        .flat_map(|(&vertex, normal)| rays(vertex.into(), normal.into(), REACH * cell))
        .collect();
    let light = field.ray_colors(&rays, field.view().finest, &Silent)?;
    for (color, light) in soup.colors.iter_mut().zip(light.chunks(RAYS)) {
        let opacity: f64 = light.iter().map(|ray| 1.0 - f64::from(ray.transmittance)).sum();
        if opacity >= LEAST_OPACITY * RAYS as f64 {
            let sum = |channel: usize| -> f64 {
                light.iter().map(|ray| f64::from(ray.color[channel])).sum()
            };
            *color = [0, 1, 2].map(|channel| (sum(channel) / opacity).clamp(0.0, 1.0));
        }
    }
    Ok(())
}

/// Rays that reach a vertex after `reach` world units.
fn rays(vertex: DVec3, normal: DVec3, reach: f64) -> [Ray; RAYS] {
    let (side, other) = normal.any_orthonormal_pair();
    // Cosines and sines of thirds of a turn.
    let turns = [[1.0, 0.0], [-0.5, 0.75f64.sqrt()], [-0.5, -0.75f64.sqrt()]];
    std::array::from_fn(|number| {
        let outwards = match number.checked_sub(1) {
            None => normal,
            Some(turn) => {
                let [along, across] = turns[turn];
                (normal + side * along + other * across) * 0.5f64.sqrt()
            }
        };
        Ray { origin: vertex + outwards * reach, direction: -outwards }
    })
}
