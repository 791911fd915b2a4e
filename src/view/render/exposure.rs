//! What given cameras see of a field, and how much of their pictures each node makes up.
//!
//! A sample's weight is its opacity times the light left before it, as in compositing. Rays are those of
//! level 0, at two pixels a node, whatever the size of the cameras' pictures: a cell that a picture of any
//! size shows is then met by a ray, but for what is smaller than half a cell.
//!
//! An error of a node's colour moves a pixel by the error, times the sample's weight, times the node's share
//! in the sample's cell. So the sum of the squares of these factors, over all rays, says how much an error
//! there adds to the mean squared error of the pictures. The sum of all is least, for a given number of bits,
//! where every node adds as much: errors grow with one over the root of that sum.

use std::sync::atomic::{AtomicU32, Ordering};

use super::march::OPAQUE_DEPTH;
use super::packet::optical_depth;
use super::route::Route;
use super::view::{Field, View};
use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::model::activate::lanes;
use crate::model::camera::Camera;
use crate::model::grid::{NodeMask, Nodes};
use crate::view::sample::{Sample, Stored};

/// Pixels along a picture's longer side for each node along the box's longest axis.
const PIXELS_A_NODE: usize = 2;
/// What squared weights of 1 add to a sum in all, if every camera adds one; a node cannot be that many
/// samples' only corner that this overflows.
const UNIT: f32 = 16_777_216.0;
/// Cameras that are followed at once, each with a mask of its own.
const BATCH: usize = 8;

/// What cameras see of level 0.
#[derive(Debug)]
pub struct Exposure {
    /// The cells, numbered by their lowest nodes, in which a ray meets a sample of enough weight.
    pub cells: NodeMask,
    /// For each node the sum over all rays of squared weights in their pixels, in units of their mean over
    /// the nodes that have any; z fastest.
    pub importance: Vec<f32>,
}

/// What the `cameras` see of level 0: cells with a sample of at least `least_weight`, 0 to 1.
pub fn exposure(
    field: &Field,
    cameras: &[Camera],
    least_weight: f32,
    progress: &dyn Progress,
) -> Result<Exposure> {
    let nodes = field.view().nodes;
    let mut cells = NodeMask::empty(nodes);
    // Whole numbers, so that the order in which rays add up does not matter.
    let sums: Vec<AtomicU32> = (0..nodes.count()).map(|_| AtomicU32::new(0)).collect();
    let film = Film { least_weight, unit: UNIT / cameras.len().max(1) as f32, sums: &sums };
    progress.begin(Step::Render, cameras.len() as u64);
    for cameras in cameras.chunks(BATCH) {
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
        let masks = parallel::map(cameras.len(), |i| {
            let camera = &at_size(&cameras[i], nodes);
            let seen = match field {
                Field::Lanes4(view, stored) => seen_by(view, stored, camera, &film),
                Field::Lanes8(view, stored) => seen_by(view, stored, camera, &film),
                Field::Lanes16(view, stored) => seen_by(view, stored, camera, &film),
            };
            progress.advance(Step::Render, 1);
            Ok(seen)
        })?;
        masks.iter().for_each(|mask| cells.unite(mask));
    }
    Ok(Exposure { cells, importance: relative(&sums) })
}

/// The camera with a picture that has [`PIXELS_A_NODE`].
fn at_size(camera: &Camera, nodes: Nodes) -> Camera {
    let [width, height] = [camera.lens.width, camera.lens.height];
    let longest = PIXELS_A_NODE * nodes.0.into_iter().max().unwrap_or(2);
    let sides = [width, height].map(|side| (side * longest).div_ceil(width.max(height)));
    Camera { lens: camera.lens.resized(sides[0], sides[1]), ..camera.clone() }
}

/// Sums in units of the mean of those that are not zero.
fn relative(sums: &[AtomicU32]) -> Vec<f32> {
    let sums = || sums.iter().map(|sum| sum.load(Ordering::Relaxed));
    let count = sums().filter(|&sum| sum > 0).count();
    let mean = sums().map(f64::from).sum::<f64>() / count.max(1) as f64;
    sums().map(|sum| (f64::from(sum) / mean.max(f64::MIN_POSITIVE)) as f32).collect()
}

/// Where rays leave their marks.
struct Film<'a> {
    least_weight: f32,
    /// What a squared weight of 1 adds to a node's sum.
    unit: f32,
    sums: &'a [AtomicU32],
}

fn seen_by<const C: usize>(
    view: &View,
    stored: &Stored<C>,
    camera: &Camera,
    film: &Film,
) -> NodeMask {
    match stored {
        Stored::Dense(field) => seen(view, field, camera, film),
        Stored::Sparse(field) => seen(view, field, camera, film),
    }
}

fn seen<const C: usize>(
    view: &View,
    field: &impl Sample<C>,
    camera: &Camera,
    film: &Film,
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
            let sample = optical_depth(field.density(0, &cell), field.density_domain(0), view);
            let opacity = lanes::opacity(sample);
            if opacity > view.march.alpha_threshold {
                let weight = opacity * lanes::exp(-depth);
                let (cell, shares) = corners(view.nodes, position);
                if weight >= film.least_weight {
                    exposed.insert(cell);
                }
                film.add(view.nodes, cell, shares, weight);
                depth += sample;
            }
            f64::from(depth) < OPAQUE_DEPTH
        });
    }
    exposed
}

/// The cell of a position, and the shares of its upper corners along each axis.
fn corners(nodes: Nodes, position: [f64; 3]) -> ([usize; 3], [f32; 3]) {
    let at = [0, 1, 2].map(|axis| position[axis] * (nodes.0[axis] - 1) as f64);
    let cell = [0, 1, 2].map(|axis| (at[axis] as usize).min(nodes.0[axis] - 2));
    (cell, [0, 1, 2].map(|axis| (at[axis] - cell[axis] as f64) as f32))
}

impl Film<'_> {
    /// Adds a sample's part to each of its cell's corners.
    fn add(&self, nodes: Nodes, cell: [usize; 3], shares: [f32; 3], weight: f32) {
        for corner in 0..8 {
            let up = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let share = (0..3).fold(weight, |share, axis| {
                share * if up[axis] == 1 { shares[axis] } else { 1.0 - shares[axis] }
            });
            let [x, y, z] = [0, 1, 2].map(|axis| cell[axis] + up[axis]);
            let node = (x * nodes.0[1] + y) * nodes.0[2] + z;
            self.sums[node].fetch_add((share * share * self.unit) as u32, Ordering::Relaxed);
        }
    }
}
