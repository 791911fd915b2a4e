//! Fits splats to pictures of the field.

use super::project::{
    ByProjected, COLOR, Eye, GaussianSplat, OPACITY, PARAMETERS, Rules, SIZE, by_parameters,
};
use super::raster::{Picture, draw};
use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::model::camera::Camera;

/// Number of steps, one picture each. Twice as many gain 0.6 dB.
pub(super) const STEPS: usize = 260;
/// Lengths of the first steps: positions in shares of a cell, logarithms, logits, coefficients of
/// band 0 and of the others.
const LENGTHS: GaussianSplat = {
    let mut lengths = [0.0025; PARAMETERS];
    let (mut position, mut color) = (0, COLOR);
    while position < SIZE {
        lengths[position] = 0.05;
        position += 1;
    }
    (lengths[SIZE], lengths[OPACITY]) = (0.04, 0.08);
    while color < COLOR + 3 {
        lengths[color] = 0.015;
        color += 1;
    }
    lengths
};
/// Final step lengths, as a share of the first.
const LAST: f32 = 0.03;
/// Decay of Adam's means (Kingma and Ba 2015). Each picture shows different splats, so squares are
/// averaged over few steps.
const MEANS: [f32; 2] = [0.9, 0.95];
const LEAST: f32 = 1e-12;
/// Splats per thread and batch.
const CHUNK: usize = 4096;
/// Range of the change of log sizes.
pub(super) const GROWTH: [f32; 2] = [-2.2, 1.1];

/// A picture of the field.
#[derive(Debug)]
pub(super) struct Target {
    pub(super) camera: Camera,
    /// Colours over the background.
    pub(super) color: Vec<[f32; 3]>,
}

/// Splats during the fit, with Adam's state.
#[derive(Debug)]
pub(super) struct Fit {
    pub(super) splats: Vec<GaussianSplat>,
    states: Vec<State>,
    background: [f32; 3],
}

#[derive(Debug, Clone)]
struct State {
    /// The initial centre and log size.
    first: [f32; SIZE + 1],
    /// Edges of the cell that bounds the centre.
    cell: [f32; 3],
    means: [GaussianSplat; 2],
}

/// The mean square error of a picture of splats, and its derivatives by the numbers of each visible
/// splat. `wanted` has the colours of all pixels, row by row.
///
/// # Errors
/// A request to stop.
pub fn differentiate(
    splats: &[GaussianSplat],
    camera: &Camera,
    wanted: &[[f32; 3]],
    background: [f32; 3],
) -> Result<(f64, Vec<Option<GaussianSplat>>)> {
    let (error, eye, by) = by_projections(splats, camera, wanted, background)?;
    let by = splats.iter().zip(by).map(|(splat, by)| Some(by_parameters(splat, &eye, &by?)));
    Ok((error, by.collect()))
}

/// The same by the projection of each splat, and the camera as splats see it.
fn by_projections(
    splats: &[GaussianSplat],
    camera: &Camera,
    wanted: &[[f32; 3]],
    background: [f32; 3],
) -> Result<(f64, Eye, Vec<Option<ByProjected>>)> {
    let drawn = draw(splats, camera, Rules::TRAINING)?;
    let (error, by_picture) = mean_square_error(&drawn.picture(background), wanted);
    let by = drawn.by_projected(&by_picture, background)?;
    Ok((error, drawn.eye, by))
}

/// The mean square error of a picture, and its derivatives by the picture's colours.
fn mean_square_error(picture: &Picture, wanted: &[[f32; 3]]) -> (f64, Vec<[f32; 3]>) {
    let share = 1.0 / (3 * wanted.len()) as f32;
    let mut sum = 0.0;
    let pairs = picture.color.iter().zip(wanted);
    let by = pairs.map(|(own, wanted)| {
        [0, 1, 2].map(|channel| {
            let off = own[channel] - wanted[channel];
            sum += f64::from(off) * f64::from(off);
            2.0 * share * off
        })
    });
    let by = by.collect();
    (sum * f64::from(share), by)
}

impl Fit {
    /// From splats and the edges of each one's cell.
    pub(super) fn new(splats: Vec<(GaussianSplat, [f32; 3])>, background: [f32; 3]) -> Self {
        let means = [[0.0; PARAMETERS]; 2];
        let state = |&(splat, cell): &(GaussianSplat, [f32; 3])| {
            let first = std::array::from_fn(|place| splat[place]);
            State { first, cell, means }
        };
        let states = splats.iter().map(state).collect();
        Self { splats: splats.into_iter().map(|(splat, _)| splat).collect(), states, background }
    }

    /// Takes all steps. [`Step::Fit`] advances by one each.
    pub(super) fn run(&mut self, targets: &[Target], progress: &dyn Progress) -> Result<()> {
        // Neighbours on a circle are far apart in this order.
        let count = targets.len();
        let stride = (2..count).rev().find(|&by| coprime(by, count)).unwrap_or(1);
        for step in 0..STEPS {
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
            if progress.enough() {
                break;
            }
            let target = &targets[(step * stride) % count];
            let (_, eye, by) =
                by_projections(&self.splats, &target.camera, &target.color, self.background)?;
            let share = step as f32 / STEPS as f32;
            self.step(&eye, &by, step + 1, 1.0 - (1.0 - LAST) * share)?;
            progress.advance(Step::Fit, 1);
        }
        Ok(())
    }

    fn step(
        &mut self,
        eye: &Eye,
        by: &[Option<ByProjected>],
        count: usize,
        shrunk: f32,
    ) -> Result<()> {
        let corrections = MEANS.map(|mean| 1.0 - power(mean, count));
        let splats = self.splats.chunks_mut(CHUNK).zip(self.states.chunks_mut(CHUNK));
        let mut parts: Vec<_> = splats.zip(by.chunks(CHUNK)).collect();
        parallel::map_mut(&mut parts, |_, ((splats, states), by)| {
            for ((splat, state), by) in splats.iter_mut().zip(states.iter_mut()).zip(by.iter()) {
                // Splats outside this picture do not change.
                let Some(by) = by else { continue };
                let slopes = by_parameters(splat, eye, by);
                state.change(splat, &slopes, corrections, shrunk);
            }
            Ok(())
        })?;
        Ok(())
    }
}

impl State {
    /// A step of Adam, with clamping.
    fn change(
        &mut self,
        splat: &mut GaussianSplat,
        slopes: &GaussianSplat,
        corrections: [f32; 2],
        shrunk: f32,
    ) {
        let smallest = self.cell.iter().copied().fold(f32::INFINITY, f32::min);
        let mut lengths = LENGTHS;
        lengths[..SIZE].iter_mut().for_each(|length| *length *= smallest);
        let [mean, square] = &mut self.means;
        let [of_mean, of_square] = corrections.map(|correction| 1.0 / correction);
        for place in 0..PARAMETERS {
            let slope = slopes[place];
            mean[place] = MEANS[0] * mean[place] + (1.0 - MEANS[0]) * slope;
            square[place] = MEANS[1] * square[place] + (1.0 - MEANS[1]) * slope * slope;
            let root = (square[place] * of_square).sqrt();
            splat[place] -= shrunk * lengths[place] * (mean[place] * of_mean) / (root + LEAST);
        }
        for ((at, from), cell) in splat.iter_mut().zip(self.first).zip(self.cell) {
            *at = at.clamp(from - 0.75 * cell, from + 0.75 * cell);
        }
        let [least, most] = GROWTH.map(|by| self.first[SIZE] + by);
        splat[SIZE] = splat[SIZE].clamp(least, most);
    }
}

/// The numbers of the splats with more than `least` of a pixel's light in any picture, limited to
/// the `most` most visible ones.
///
/// # Errors
/// A request to stop.
pub(super) fn visible(
    splats: &[GaussianSplat],
    targets: &[Target],
    most: usize,
    least: f32,
) -> Result<Vec<usize>> {
    let mut weights = vec![0.0f32; splats.len()];
    for target in targets {
        draw(splats, &target.camera, Rules::TRAINING)?.weights(&mut weights)?;
    }
    let mut order: Vec<usize> =
        (0..weights.len()).filter(|&number| weights[number] > least).collect();
    order.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]).then(a.cmp(&b)));
    order.truncate(most);
    order.sort_unstable();
    Ok(order)
}

/// A power, the same on every machine.
fn power(base: f32, count: usize) -> f32 {
    libm::powf(base, count as f32)
}

fn coprime(a: usize, b: usize) -> bool {
    if b == 0 { a == 1 } else { coprime(b, a % b) }
}
