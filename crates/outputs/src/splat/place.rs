//! Splats at the nodes of a field: initial positions, then colours of the visible ones.

use super::optimize::GROWTH;
use super::project::{COLOR, GaussianSplat, OPACITY, PARAMETERS, SIZE};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::format::{ExportOptions, ExportSource};
use crate::model::activate::lanes;
use crate::model::grid::{Bounds, Nodes};
use crate::model::harmonics::{BAND_0, basis};
use crate::view::Lattice;
use crate::view::render::Renderer;
use crate::volume::{lattice, lattice_of};

/// Minimum opacity of a splat, over the distance of two points.
const SHOWS: f32 = 0.01;
/// A point is hidden if all its neighbours are more opaque than this.
const HIDES: f32 = 0.9;
/// The standard deviation of a splat, in distances of points.
const SPREAD: f32 = 0.5;
/// Range of initial opacities.
const OPACITIES: [f32; 2] = [0.02, 0.98];
/// Number of directions for colours.
const DIRECTIONS: usize = 64;
/// Splats that a thread colours at once.
const CHUNK: usize = 512;

/// The points of one of nested boxes, or of the only box.
#[derive(Debug)]
pub(super) struct BoxPoints {
    lattice: Lattice,
    /// The next smaller box, which has its own points.
    hole: Option<Bounds>,
    /// True if places are shares of a box other than the lattice's own.
    nested: bool,
}

impl BoxPoints {
    fn spacing(&self) -> [f32; 3] {
        self.lattice.spacing.map(|edge| edge as f32)
    }

    /// Mean distance of points.
    fn edge(&self) -> f32 {
        libm::cbrt(self.lattice.spacing.iter().product::<f64>()) as f32
    }

    /// A point's place in shares of the outermost box; none in the hole.
    fn share(&self, outer: &Bounds, at: [usize; 3]) -> Option<[f64; 3]> {
        if !self.nested {
            return Some(self.lattice.share(at));
        }
        let world = self.lattice.world(at);
        let within = |hole: &Bounds| {
            (0..3).all(|axis| {
                (f64::from(hole.min[axis])..=f64::from(hole.max[axis])).contains(&world[axis])
            })
        };
        if self.hole.as_ref().is_some_and(within) {
            return None;
        }
        let extent = outer.extent();
        Some([0, 1, 2].map(|axis| (world[axis] - f64::from(outer.min[axis])) / extent[axis]))
    }
}

/// The points of all boxes, the innermost first.
///
/// # Errors
/// Options out of range, and more points than the limits allow.
pub(super) fn points(source: &ExportSource, options: &ExportOptions) -> Result<Vec<BoxPoints>> {
    let Some(world) = &source.world else {
        let lattice = lattice(source, options, 1)?;
        return Ok(vec![BoxPoints { lattice, hole: None, nested: false }]);
    };
    let first = world.box_of_part(options.level);
    let of_box = |(number, part): (usize, usize)| {
        let bounds = world.level_bounds(number);
        let nodes = Nodes(world.part(part).map_or([2; 3], |part| part.dimensions));
        let hole = (number > first).then(|| world.level_bounds(number - 1));
        let lattice = lattice_of(&bounds, nodes, options, 1)?;
        Ok(BoxPoints { lattice, hole, nested: true })
    };
    let shells = (first + 1..=world.shells.len()).map(|number| {
        let part = world.shell_of(number);
        (number, part.unwrap_or(options.level))
    });
    std::iter::once((first, options.level)).chain(shells).map(of_box).collect()
}

/// The smallest standard deviation that a fit may give a splat, and the largest, in world units.
pub(super) fn sizes(boxes: &[BoxPoints]) -> [f64; 2] {
    let edges = || boxes.iter().map(|points| f64::from(SPREAD * points.edge()));
    let [smaller, larger] = GROWTH.map(|by| libm::exp(by.into()));
    [smaller * edges().fold(f64::INFINITY, f64::min), larger * edges().fold(0.0, f64::max)]
}

/// Splats without colours at all visible points, and the edges of each one's cell.
///
/// # Errors
/// More memory than the limits allow, and a request to stop.
pub(super) fn splats(
    field: &Renderer,
    boxes: &[BoxPoints],
    level: usize,
    limits: &Limits,
    progress: &dyn Progress,
) -> Result<Vec<(GaussianSplat, [f32; 3])>> {
    let planes = boxes.iter().map(|points| points.lattice.counts()[0] as u64).sum();
    progress.begin(Step::Encode, planes);
    let mut all = Vec::new();
    for points in boxes {
        let cell = points.spacing();
        for splat in splats_of(field, points, level, limits, progress)? {
            all.push((splat, cell));
        }
        // Each with its optimizer state.
        let bytes = 4 * (all.len() * size_of::<GaussianSplat>()) as u64;
        limits::check(LimitName::Memory, "bytes of splats", bytes, limits.memory, &Place::File)?;
    }
    if all.is_empty() {
        return Err(Error::usage("the field shows nothing, so there is nothing to make splats of"));
    }
    Ok(all)
}

/// Those of one box.
fn splats_of(
    field: &Renderer,
    points: &BoxPoints,
    level: usize,
    limits: &Limits,
    progress: &dyn Progress,
) -> Result<Vec<GaussianSplat>> {
    let counts = points.lattice.counts();
    let [nx, ny, nz] = counts;
    let sizes = [nx as u64, ny as u64, nz as u64, 4];
    let bytes = limits::product(&sizes, "bytes of densities", &Place::File)? as u64;
    limits::check(LimitName::Memory, "bytes of densities", bytes, limits.memory, &Place::File)?;
    let (edge, outer) = (points.edge(), &field.view().bounds);
    let planes = parallel::map(nx, |x| {
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
        let mut plane = Vec::with_capacity(ny * nz);
        for (y, z) in (0..ny).flat_map(|y| (0..nz).map(move |z| (y, z))) {
            let share = points.share(outer, [x, y, z]);
            let density = share.map_or(0.0, |share| field.density_at(share, level));
            plane.push(lanes::opacity(density * edge));
        }
        progress.advance(Step::Encode, 1);
        Ok(plane)
    })?;
    let opacity = |[x, y, z]: [usize; 3]| planes[x][y * nz + z];
    let shows = |at: [usize; 3]| {
        opacity(at) >= SHOWS
            && (0..3).any(|axis| {
                let mut near = [at, at];
                near[0][axis] = at[axis].saturating_sub(1);
                near[1][axis] = (at[axis] + 1).min(counts[axis] - 1);
                at[axis] == 0
                    || at[axis] + 1 == counts[axis]
                    || near.map(opacity).iter().any(|v| *v < HIDES)
            })
    };
    let found = parallel::map(nx, |x| {
        let places = (0..ny).flat_map(|y| (0..nz).map(move |z| [x, y, z]));
        let splat = |at| splat(points.lattice.world(at), edge, opacity(at));
        Ok(places.filter(|&at| shows(at)).map(splat).collect::<Vec<_>>())
    })?;
    Ok(found.concat())
}

#[expect(clippy::cast_possible_truncation, reason = "splats are float32")]
fn splat(world: [f64; 3], edge: f32, opacity: f32) -> GaussianSplat {
    let mut out = [0.0; PARAMETERS];
    out.iter_mut().zip(world).for_each(|(out, at)| *out = at as f32);
    out[SIZE] = lanes::ln(f64::from(SPREAD * edge)) as f32;
    let opacity = f64::from(opacity.clamp(OPACITIES[0], OPACITIES[1]));
    out[OPACITY] = libm::log(opacity / (1.0 - opacity)) as f32;
    out
}

/// Gives splats the field's colours from all around, as harmonics.
///
/// # Errors
/// A request to stop.
pub(super) fn color(
    field: &Renderer,
    splats: &mut [(GaussianSplat, [f32; 3])],
    level: usize,
    progress: &dyn Progress,
) -> Result<()> {
    let directions = directions();
    let weights = directions.map(basis);
    // The functions are orthonormal over the sphere, so sums over directions are the fit.
    let share = 4.0 * std::f32::consts::PI / DIRECTIONS as f32;
    let mut chunks: Vec<_> = splats.chunks_mut(CHUNK).collect();
    parallel::map_mut(&mut chunks, |_, splats| {
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
        for (splat, _) in splats.iter_mut() {
            let world = [0, 1, 2].map(|axis| f64::from(splat[axis]));
            let colors = field.point_colors(world, &directions, level)?;
            splat[COLOR..].fill(0.0);
            for (color, weights) in colors.iter().zip(&weights) {
                for (function, weight) in weights.iter().enumerate() {
                    for (channel, value) in color.iter().enumerate() {
                        let place = COLOR + 3 * function + channel;
                        splat[place] += share * weight * value.clamp(0.0, 1.0);
                    }
                }
            }
            for channel in &mut splat[COLOR..COLOR + 3] {
                *channel -= 0.5 / BAND_0;
            }
        }
        Ok(())
    })
    .map(drop)
}

/// Directions from all around, evenly spread.
fn directions() -> [[f64; 3]; DIRECTIONS] {
    let turn = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    std::array::from_fn(|number| {
        let z = 1.0 - (2 * number + 1) as f64 / DIRECTIONS as f64;
        let around = (1.0 - z * z).sqrt();
        let angle = turn * number as f64;
        [around * libm::cos(angle), around * libm::sin(angle), z]
    })
}
