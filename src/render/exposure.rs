//! What given cameras see of a field: the cells of level 0 in which some ray meets a sample whose weight in
//! its pixel is not negligible.
//!
//! A sample's weight is its opacity times the light left before it, as in compositing. Rays are those of
//! level 0, at two pixels a node, whatever the size of the cameras' pictures: a cell that a picture of any
//! size shows is then met by a ray, but for what is smaller than half a cell.

use super::march::OPAQUE_DEPTH;
use super::packet::optical_depth;
use super::route::Route;
use super::view::{Field, View};
use crate::activate::lanes;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::grid::{NodeMask, Nodes};
use crate::parallel;
use crate::progress::{Progress, Step};
use crate::sample::{Sample, Stored};

/// Pixels along a picture's longer side for each node along the box's longest axis.
const PIXELS_A_NODE: usize = 2;
/// Cameras that are followed at once, each with a mask of its own.
const BATCH: usize = 8;

/// The cells of level 0, numbered by their lowest nodes, in which a ray of one of the `cameras` meets a
/// sample of at least `least_weight`, 0 to 1.
pub fn exposed_cells(
    field: &Field,
    cameras: &[Camera],
    least_weight: f32,
    progress: &dyn Progress,
) -> Result<NodeMask> {
    let nodes = field.view().nodes;
    let mut exposed = NodeMask::empty(nodes);
    progress.begin(Step::Render, cameras.len() as u64);
    for cameras in cameras.chunks(BATCH) {
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
        let masks = parallel::map(cameras.len(), |i| {
            let camera = &at_size(&cameras[i], nodes);
            let seen = match field {
                Field::Lanes4(view, stored) => seen_by(view, stored, camera, least_weight),
                Field::Lanes8(view, stored) => seen_by(view, stored, camera, least_weight),
                Field::Lanes16(view, stored) => seen_by(view, stored, camera, least_weight),
            };
            progress.advance(Step::Render, 1);
            Ok(seen)
        })?;
        masks.iter().for_each(|mask| exposed.unite(mask));
    }
    Ok(exposed)
}

/// The camera with a picture that has [`PIXELS_A_NODE`].
fn at_size(camera: &Camera, nodes: Nodes) -> Camera {
    let [width, height] = [camera.lens.width, camera.lens.height];
    let longest = PIXELS_A_NODE * nodes.0.into_iter().max().unwrap_or(2);
    let sides = [width, height].map(|side| (side * longest).div_ceil(width.max(height)));
    Camera { lens: camera.lens.resized(sides[0], sides[1]), ..camera.clone() }
}

fn seen_by<const C: usize>(
    view: &View,
    stored: &Stored<C>,
    camera: &Camera,
    least_weight: f32,
) -> NodeMask {
    match stored {
        Stored::Dense(field) => seen(view, field, camera, least_weight),
        Stored::Sparse(field) => seen(view, field, camera, least_weight),
    }
}

fn seen<const C: usize>(
    view: &View,
    field: &impl Sample<C>,
    camera: &Camera,
    least_weight: f32,
) -> NodeMask {
    let mut exposed = NodeMask::empty(view.nodes);
    for pixel in 0..camera.lens.width * camera.lens.height {
        let [x, y] = [pixel % camera.lens.width, pixel / camera.lens.width];
        let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
        let Some(route) = Route::new(view, field.levels(), &ray, None, Some(0)) else { continue };
        let mut depth = 0.0f32;
        route.walk(view, field.skip(), |k, _, _| {
            let position = route.path.position(k);
            let Some(cell) = field.locate(0, position) else { return true };
            let sample = optical_depth(field.density(0, &cell), field.decode(0), view);
            if lanes::opacity(sample) > view.march.alpha_threshold {
                if lanes::opacity(sample) * lanes::exp(-depth) >= least_weight {
                    exposed.insert([0, 1, 2].map(|axis| {
                        let cells = view.nodes.0[axis] - 1;
                        ((position[axis] * cells as f64) as usize).min(cells - 1)
                    }));
                }
                depth += sample;
            }
            // Behind that no sample can weigh as much.
            f64::from(depth) < OPAQUE_DEPTH && lanes::exp(-depth) >= least_weight
        });
    }
    exposed
}
