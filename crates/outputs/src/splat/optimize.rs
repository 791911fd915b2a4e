//! Splats that look as the field does, in pictures of it.

use super::project::{COLOR, GaussianSplat, OPACITY, PARAMETERS, SIZE};
use super::raster::{Picture, draw};
use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::model::camera::Camera;

/// Steps, a picture each: first with pictures of half the size, which cost a third and move splats
/// as well, then with the whole pictures.
const SMALL_STEPS: usize = 150;
const WHOLE_STEPS: usize = 350;
/// All of them.
pub(super) const STEPS: usize = SMALL_STEPS + WHOLE_STEPS;
/// Lengths of the first steps: positions in shares of a cell, logarithms, logits, coefficients of
/// band 0 and of the others. The last steps are a tenth as long.
const POSITION: f32 = 0.04;
const LENGTHS: [f32; 4] = [0.02, 0.05, 0.012, 0.003];
/// Adam's means (Kingma and Ba 2015).
const MEANS: [f32; 2] = [0.9, 0.99];
const LEAST: f32 = 1e-12;
/// Splats that a thread changes at once.
const CHUNK: usize = 4096;
/// Logarithms of sizes beyond the first ones, at most.
const GROWS: f32 = 1.1;

/// A picture of the field.
#[derive(Debug)]
pub(super) struct Target {
    pub(super) camera: Camera,
    /// Colours over the background.
    pub(super) color: Vec<[f32; 3]>,
}

impl Target {
    /// The picture at half the size.
    pub(super) fn small(&self) -> Self {
        let lens = &self.camera.lens;
        let [width, height] = [lens.width, lens.height].map(|side| (side / 2).max(1));
        let mean = |pixel: usize| {
            let (x, y) = (pixel % width * 2, pixel / width * 2);
            let pixels = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[right, down]| {
                let (x, y) = ((x + right).min(lens.width - 1), (y + down).min(lens.height - 1));
                self.color[y * lens.width + x]
            });
            [0, 1, 2].map(|channel| 0.25 * pixels.iter().map(|pixel| pixel[channel]).sum::<f32>())
        };
        let color = (0..width * height).map(mean).collect();
        Self { camera: Camera { lens: lens.resized(width, height), ..self.camera.clone() }, color }
    }
}

/// Splats on the way, with what Adam remembers.
#[derive(Debug)]
pub(super) struct Fit {
    pub(super) splats: Vec<GaussianSplat>,
    states: Vec<State>,
    /// Edges of a cell, which a centre does not leave.
    cell: [f32; 3],
    background: [f32; 3],
}

#[derive(Debug, Clone)]
struct State {
    first: GaussianSplat,
    means: [GaussianSplat; 2],
}

/// The mean square error of a picture of splats, and its derivatives by the numbers of each splat
/// that shows. `wanted` has the colours of all pixels, row by row.
///
/// # Errors
/// A request to stop.
pub fn differentiate(
    splats: &[GaussianSplat],
    camera: &Camera,
    wanted: &[[f32; 3]],
    background: [f32; 3],
) -> Result<(f64, Vec<Option<GaussianSplat>>)> {
    let drawn = draw(splats, camera, background)?;
    let (error, by_picture) = mean_square_error(&drawn.picture, wanted);
    Ok((error, drawn.by_splats(splats, &by_picture, background)?))
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
    pub(super) fn new(splats: Vec<GaussianSplat>, cell: [f32; 3], background: [f32; 3]) -> Self {
        let nothing = [[0.0; PARAMETERS]; 2];
        let states = splats.iter().map(|&first| State { first, means: nothing }).collect();
        Self { splats, states, cell, background }
    }

    /// Keeps the splats that show in some picture, at most `most` of them: those that show most.
    pub(super) fn prune(&mut self, targets: &[Target], most: usize, least: f32) -> Result<()> {
        let mut weights = vec![0.0f32; self.splats.len()];
        for target in targets {
            draw(&self.splats, &target.camera, self.background)?.weights(&mut weights)?;
        }
        let mut order: Vec<usize> =
            (0..weights.len()).filter(|&number| weights[number] > least).collect();
        order.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]).then(a.cmp(&b)));
        order.truncate(most);
        order.sort_unstable();
        self.splats = order.iter().map(|&number| self.splats[number]).collect();
        self.states = order.iter().map(|&number| self.states[number].clone()).collect();
        Ok(())
    }

    /// Takes all steps, with the pictures of half the size and the whole ones. [`Step::Fit`] advances
    /// by one each.
    pub(super) fn run(
        &mut self,
        [small, whole]: [&[Target]; 2],
        progress: &dyn Progress,
    ) -> Result<()> {
        // Neighbours of a circle come far apart.
        let stride = (2..whole.len()).rev().find(|&by| coprime(by, whole.len())).unwrap_or(1);
        for step in 0..STEPS {
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
            if progress.enough() {
                break;
            }
            let targets = if step < SMALL_STEPS { small } else { whole };
            let target = &targets[(step * stride.max(1)) % targets.len()];
            let (_, by) =
                differentiate(&self.splats, &target.camera, &target.color, self.background)?;
            let share = step as f32 / STEPS as f32;
            self.step(&by, step + 1, 1.0 - 0.9 * share)?;
            progress.advance(Step::Fit, 1);
        }
        Ok(())
    }

    fn step(&mut self, by: &[Option<GaussianSplat>], count: usize, shrunk: f32) -> Result<()> {
        let corrections = MEANS.map(|mean| 1.0 - power(mean, count));
        let cell = self.cell;
        let smallest = cell.iter().copied().fold(f32::INFINITY, f32::min);
        let splats = self.splats.chunks_mut(CHUNK).zip(self.states.chunks_mut(CHUNK));
        let mut parts: Vec<_> = splats.zip(by.chunks(CHUNK)).collect();
        parallel::map_mut(&mut parts, |_, ((splats, states), by)| {
            for ((splat, state), by) in splats.iter_mut().zip(states.iter_mut()).zip(by.iter()) {
                // A splat that this picture does not show stays as it is.
                let Some(by) = by else { continue };
                for place in 0..PARAMETERS {
                    let [mean, square] = &mut state.means;
                    let slope = by[place];
                    mean[place] = MEANS[0] * mean[place] + (1.0 - MEANS[0]) * slope;
                    square[place] = MEANS[1] * square[place] + (1.0 - MEANS[1]) * slope * slope;
                    let mean = mean[place] / corrections[0];
                    let root = (square[place] / corrections[1]).sqrt();
                    let length = match place {
                        0..SIZE => POSITION * smallest,
                        SIZE => LENGTHS[0],
                        OPACITY => LENGTHS[1],
                        _ if place < COLOR + 3 => LENGTHS[2],
                        _ => LENGTHS[3],
                    };
                    splat[place] -= shrunk * length * mean / (root + LEAST);
                }
                for axis in 0..3 {
                    let (from, reach) = (state.first[axis], 0.75 * cell[axis]);
                    splat[axis] = splat[axis].clamp(from - reach, from + reach);
                }
                splat[SIZE] =
                    splat[SIZE].clamp(state.first[SIZE] - 2.0 * GROWS, state.first[SIZE] + GROWS);
            }
            Ok(())
        })?;
        Ok(())
    }
}

/// A power, the same on every machine.
fn power(base: f32, count: usize) -> f32 {
    libm::powf(base, count as f32)
}

fn coprime(a: usize, b: usize) -> bool {
    if b == 0 { a == 1 } else { coprime(b, a % b) }
}
