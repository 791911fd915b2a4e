//! The part of a field that cameras see, and the importance of each node in their pictures.
//!
//! A sample's weight is its opacity times the transmittance before it, as in compositing.
//!
//! **Rays.** One ray goes through every point of a lattice over the box's rectangle in the picture.
//! At the depth of the box's farthest corner, the points of the lattice are at most one node
//! spacing apart. The eight cells around a node contain a ball whose radius is the node spacing.
//! The ball's projection contains a disc, so some ray crosses the ball along a chord of at least
//! one step. Every node in front of the camera thus has a sample in an adjacent cell, for any lens,
//! distance and picture size. The number of rays is bounded ([`MAX_RAYS_A_CELL`]), so lenses wider
//! than a right angle can miss distant nodes.
//!
//! **Importance.** An error `e` in a node's colour changes a ray's colour by `e` times a sum over
//! the ray's samples: the sample's weight times the node's trilinear weight. In fog, a single node
//! has hardly any weight, but errors along a ray are similar. So a ray adds to each node that sum
//! times the sum of all its weights: the node's share of the squared error if all nodes of the ray
//! have the same error. Every ray is weighted by its share of the camera's picture, so all cameras
//! count equally.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;

use super::march::OPAQUE_DEPTH;
use super::renderer::{Renderer, with_values};
use super::route::{EVERY_SAMPLE, Route, RouteSample};
use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::model::activate::lanes;
use crate::model::camera::{Camera, Ray};
use crate::model::grid::{Bounds, CellMask, Nodes};
use crate::view::sample::SampleLevels;
use crate::view::sample::View;
use crate::view::sample::optical_depth;

/// Maximum rays along each side of a camera's lattice per cell of the box's longest edge, for the
/// closest cells.
const MAX_RAYS_A_CELL: f64 = 8.0;
/// Maximum sum of one node over all cameras: a quarter of the 64-bit range, which leaves headroom
/// for rounding up.
const MAX_SUM: f64 = (1u64 << 62) as f64;
/// Number of cameras traced at once, each with its own mask.
const BATCH: usize = 8;

/// The part of level 0 that cameras see.
#[derive(Debug)]
pub struct CameraCoverage {
    /// The cells that contain a sample of sufficient weight.
    pub cells: CellMask,
    /// The importance of each node, z fastest, relative to the mean of the values above 0; 0 if no
    /// ray hits the node.
    pub importance: Vec<f32>,
}

/// Traces rays of all `cameras` through level 0. Cells with a sample of at least `least_weight`, 0
/// to 1, count as covered. The result does not depend on the number of threads.
///
/// # Errors
/// `Malformed` for cameras or rules that cannot be rendered, `Cancelled`.
pub fn camera_coverage(
    field: &Renderer,
    cameras: &[Camera],
    least_weight: f32,
    progress: &dyn Progress,
) -> Result<CameraCoverage> {
    let view = field.view();
    view.check()?;
    cameras.iter().try_for_each(Camera::check)?;
    let mut cells = CellMask::empty(view.nodes);
    // Integers, so that sums do not depend on the order of rays.
    let sums: Vec<AtomicU64> = (0..view.nodes.count()).map(|_| AtomicU64::new(0)).collect();
    progress.begin(Step::Cover, cameras.len() as u64);
    for batch in cameras.chunks(BATCH) {
        let masks = parallel::map(batch.len(), |i| {
            let mut mask = CellMask::empty(view.nodes);
            if let Some(lattice) = Lattice::new(view, &batch[i]) {
                let unit = MAX_SUM / cameras.len() as f64 / lattice.points_of_picture();
                let buffer = ImportanceBuffer { nodes: view.nodes, unit, sums: &sums };
                with_values!(field.lanes()?, values => {
                    follow(view, values, &lattice, least_weight, &buffer, &mut mask, progress)
                })?;
            }
            progress.advance(Step::Cover, 1);
            Ok(mask)
        })?;
        masks.iter().for_each(|mask| cells.unite(mask));
    }
    Ok(CameraCoverage { cells, importance: relative(&sums) })
}

/// The sums relative to the mean of those above 0.
fn relative(sums: &[AtomicU64]) -> Vec<f32> {
    let sums = || sums.iter().map(|sum| sum.load(Ordering::Relaxed));
    let count = sums().filter(|&sum| sum > 0).count();
    let mean = sums().map(|sum| sum as f64).sum::<f64>() / count.max(1) as f64;
    sums().map(|sum| (sum as f64 / mean.max(f64::MIN_POSITIVE)) as f32).collect()
}

/// The lattice of rays in a camera's picture.
struct Lattice {
    /// The camera, with one pixel per point of the lattice.
    camera: Camera,
    /// First and end column, first and end row of the box's rectangle.
    columns: [usize; 2],
    rows: [usize; 2],
}

impl Lattice {
    /// None if no part of the box is in front of the camera.
    fn new(view: &View, camera: &Camera) -> Option<Self> {
        let to_camera = camera.to_world.inverse();
        let Bounds { min, max } = view.finest_bounds;
        let corners: [DVec3; 8] = std::array::from_fn(|i| {
            let corner = DVec3::from_array(std::array::from_fn(|axis| {
                f64::from(if i >> axis & 1 == 1 { max[axis] } else { min[axis] })
            }));
            to_camera.transform_point3(corner)
        });
        let depths = corners.map(|corner| -corner.z);
        let farthest = depths.into_iter().fold(0.0, f64::max);
        if !(farthest > 0.0 && farthest.is_finite()) {
            return None;
        }
        let spacing =
            view.nodes.spacing(&view.finest_bounds).into_iter().fold(f64::INFINITY, f64::min);
        let step = view.march.longest_step();
        // A disc of this radius holds a chord of a step; no point of the plane is farther from a
        // square lattice than its spacing times the root of a half.
        let square = (spacing * spacing - 0.25 * step * step).max(0.5 * spacing * spacing);
        let distance = (2.0 * square).sqrt().min(spacing);
        let wanted = [camera.to_world.x_axis, camera.to_world.y_axis]
            .map(|axis| farthest * axis.truncate().length() / distance);
        let side = |factor: f64, axis: usize| {
            let pixels = [camera.lens.width, camera.lens.height][axis] as f64;
            (pixels * factor * wanted[axis] / camera.lens.focal[axis]).ceil().max(1.0)
        };
        // The rectangle in shares of the picture. A box that extends behind the camera may cover
        // all of it.
        let behind = depths.iter().any(|&depth| depth < 1e-6 * farthest);
        let share = |axis: usize| {
            if behind {
                return [0.0, 1.0];
            }
            let pixels = [camera.lens.width, camera.lens.height][axis] as f64;
            let at = |corner: &DVec3| {
                let sign = if axis == 0 { 1.0 } else { -1.0 };
                let tangent = sign * corner[axis] / -corner.z;
                (tangent * camera.lens.focal[axis] + camera.lens.center[axis]) / pixels
            };
            let fold = |start: f64, of: fn(f64, f64) -> f64| corners.iter().map(at).fold(start, of);
            [fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max)]
                .map(|share| share.clamp(0.0, 1.0))
        };
        let shares = [share(0), share(1)];
        let across =
            |factor: f64, axis: usize| side(factor, axis) * (shares[axis][1] - shares[axis][0]);
        let longest = view.finest_bounds.extent().into_iter().fold(0.0, f64::max);
        let max_pixels = (MAX_RAYS_A_CELL * longest / spacing).ceil();
        let factor = max_pixels / across(1.0, 0).max(across(1.0, 1)).max(max_pixels);
        let sides = [side(factor, 0), side(factor, 1)];
        let [columns, rows] = [0, 1].map(|axis| {
            let [low, high] = shares[axis].map(|share| share * sides[axis]);
            [low.floor() as usize, high.ceil() as usize]
        });
        let lens = camera.lens.resized(sides[0] as usize, sides[1] as usize);
        Some(Self { camera: Camera { lens, ..camera.clone() }, columns, rows })
    }

    /// Number of points in the whole picture, of which the box's rectangle is a part.
    fn points_of_picture(&self) -> f64 {
        self.camera.lens.width as f64 * self.camera.lens.height as f64
    }

    fn rays(&self) -> impl Iterator<Item = Ray> {
        let [columns, rows] = [self.columns, self.rows].map(|[start, end]| start..end);
        rows.flat_map(move |y| {
            columns.clone().map(move |x| self.camera.ray(x as f64 + 0.5, y as f64 + 0.5))
        })
    }
}

/// A sample in a cell.
struct Weighted {
    cell: [usize; 3],
    /// Interpolation weights of the cell's upper corners along each axis.
    shares: [f32; 3],
    weight: f32,
}

/// Traces the rays of one camera.
fn follow<const C: usize>(
    view: &View,
    field: &impl SampleLevels<C>,
    lattice: &Lattice,
    least_weight: f32,
    buffer: &ImportanceBuffer,
    mask: &mut CellMask,
    progress: &dyn Progress,
) -> Result<()> {
    let mut samples = Vec::new();
    for ray in lattice.rays() {
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
        let Some(route) = Route::new(view, field.levels(), &ray, None, Some(0)) else { continue };
        let mut depth = 0.0f64;
        samples.clear();
        route.walk(
            view,
            |number| field.skip(number),
            EVERY_SAMPLE,
            |sample| {
                let RouteSample { k, intervals, number, .. } = sample;
                let position = route.path.position(k);
                let part = field.part(number, number);
                let Some(cell) = field.locate(part, position) else { return true };
                let density = field.density(part, &cell, &route.path.along);
                let optical = optical_depth(density, field.density_domain(part), view)
                    * field.depth_scale(part)
                    * intervals;
                let opacity = lanes::opacity(optical);
                if opacity > view.march.alpha_threshold {
                    let weight = opacity * lanes::exp(-depth as f32);
                    depth += f64::from(optical);
                    if number > 0 {
                        // Shells occlude, but are kept unchanged.
                        return depth < OPAQUE_DEPTH;
                    }
                    let position =
                        view.boxes.first().map_or(position, |own| own.place_within(position));
                    let (cell, shares) = corners(view.nodes, position);
                    if weight >= least_weight {
                        mask.insert(cell);
                    }
                    samples.push(Weighted { cell, shares, weight });
                }
                depth < OPAQUE_DEPTH
            },
        );
        buffer.add(&samples);
    }
    Ok(())
}

/// The cell of a position, and the interpolation weights of its upper corners along each axis.
fn corners(nodes: Nodes, position: [f64; 3]) -> ([usize; 3], [f32; 3]) {
    let at = [0, 1, 2].map(|axis| position[axis] * (nodes.0[axis] - 1) as f64);
    let cell = [0, 1, 2].map(|axis| (at[axis] as usize).min(nodes.0[axis] - 2));
    (cell, [0, 1, 2].map(|axis| (at[axis] - cell[axis] as f64) as f32))
}

/// The sums of all nodes.
struct ImportanceBuffer<'a> {
    nodes: Nodes,
    /// The sum of a ray whose whole weight is on one node.
    unit: f64,
    sums: &'a [AtomicU64],
}

impl ImportanceBuffer<'_> {
    /// Adds the samples of one ray.
    fn add(&self, samples: &[Weighted]) {
        let total: f64 = samples.iter().map(|sample| f64::from(sample.weight)).sum();
        for sample in samples {
            for corner in 0..8 {
                let up = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
                let share = (0..3).fold(sample.weight, |share, axis| {
                    let upper = sample.shares[axis];
                    share * if up[axis] == 1 { upper } else { 1.0 - upper }
                });
                let [x, y, z] = [0, 1, 2].map(|axis| sample.cell[axis] + up[axis]);
                let node = (x * self.nodes.0[1] + y) * self.nodes.0[2] + z;
                // Rounded up, so that every visible node has some importance.
                let part = (f64::from(share) * total * self.unit).ceil() as u64;
                self.sums[node].fetch_add(part, Ordering::Relaxed);
            }
        }
    }
}
