//! The mode of each frame of a run, and the weights of each mode's predictions.
//!
//! Frames are first sorted by the mean distance of their codes from the means of their neighbours,
//! and divided equally among the modes. Then, several times, each mode gets the weights that fit
//! its frames best, and each frame moves to the mode in which it takes the fewest bits. Bits are
//! estimated as if residuals of a mode's channel were normally distributed, so they depend only on
//! sums of squared residuals, which follow from the sums for fitting weights ([`super::sums`]). So
//! no code is read again.

use multiversion::multiversion;

use super::frame::{FrameShape, terms};
use super::least_squares;
use super::predict::WEIGHTS;
use super::sums::{PRODUCTS, SAMPLED, Sums};

/// Minimum initial frames of a mode, so that its weights and tables pay off.
const FRAMES_OF_A_MODE: usize = 24;
/// Maximum modes of a run. With 12, files have the same size.
const MAX_MODES: usize = 8;
/// Number of reassignments of frames to modes. Six save 1.8 % of the bytes, four save 1.7 %.
const REGROUPINGS: usize = 4;
/// Mean square of a rounding error, because residuals are integers.
const ROUNDING: f64 = 1.0 / 12.0;

/// The weights of each channel's predictions.
type Weights = Vec<[i8; WEIGHTS]>;

/// Modes of a run.
#[derive(Debug)]
pub struct Modes {
    /// The mode of each frame.
    pub of_frames: Vec<u8>,
    /// Weights by mode and channel.
    pub weights: Vec<Weights>,
}

impl Modes {
    /// For frames with these numbers of live nodes, from the sums of each batch of `L` frames by
    /// channel.
    pub fn of<const L: usize>(
        shape: FrameShape,
        live_counts: &[usize],
        sums: &[Vec<Sums<L>>],
    ) -> Self {
        let run = Run { shape, live_counts, sums };
        let mut of_frames = run.modes_by_activity();
        let mut weights = run.weights(&of_frames);
        for _ in 0..REGROUPINGS {
            let regrouped = run.cheapest_modes(&of_frames, &weights);
            if regrouped == of_frames {
                break;
            }
            of_frames = regrouped;
            weights = run.weights(&of_frames);
        }
        Self { of_frames, weights }
    }
}

/// The inputs for choosing modes.
struct Run<'a, const L: usize> {
    shape: FrameShape,
    live_counts: &'a [usize],
    sums: &'a [Vec<Sums<L>>],
}

impl<const L: usize> Run<'_, L> {
    /// Modes with equal numbers of frames, by the mean distance of codes from the means.
    fn modes_by_activity(&self) -> Vec<u8> {
        let frames = self.live_counts.len();
        let activity = |frame: usize| {
            let sizes: f64 = self.sums[frame / L].iter().map(|sums| sums.sizes[frame % L]).sum();
            sizes / self.live_counts[frame].max(1) as f64
        };
        let activities: Vec<f64> = (0..frames).map(activity).collect();
        let mut order: Vec<usize> = (0..frames).collect();
        order.sort_by(|&a, &b| activities[a].total_cmp(&activities[b]).then(a.cmp(&b)));
        let count = (frames / FRAMES_OF_A_MODE).clamp(1, MAX_MODES);
        let mut modes = vec![0; frames];
        for (rank, &frame) in order.iter().enumerate() {
            modes[frame] = (rank * count / frames) as u8;
        }
        modes
    }

    /// The weights of each mode, up to the last that any frame has.
    fn weights(&self, modes: &[u8]) -> Vec<Weights> {
        let count = modes.iter().max().map_or(1, |&mode| usize::from(mode) + 1);
        let mut products = vec![vec![[0.0; PRODUCTS]; self.shape.channels]; count];
        for (frame, &mode) in modes.iter().enumerate() {
            for (total, sums) in products[usize::from(mode)].iter_mut().zip(&self.sums[frame / L]) {
                for (total, lanes) in total.iter_mut().zip(&sums.products) {
                    *total += lanes[frame % L];
                }
            }
        }
        let solved = |products: Vec<[f64; PRODUCTS]>| {
            let all = products.iter().enumerate();
            all.map(|(channel, products)| least_squares::weights(products, terms(channel)))
                .collect()
        };
        products.into_iter().map(solved).collect()
    }

    /// For each frame, the mode in which it takes the fewest bits; the first of equal ones.
    fn cheapest_modes(&self, modes: &[u8], weights: &[Weights]) -> Vec<u8> {
        let frames = self.live_counts.len();
        let sampled = |frame: usize| self.live_counts[frame] as f64 / SAMPLED as f64;
        let mut bits = vec![vec![0.0; frames]; weights.len()];
        let mut squares = vec![[0.0; L]; self.sums.len()];
        for channel in 0..self.shape.channels {
            for (mode, weights) in weights.iter().enumerate() {
                let factors = square_factors(&weights[channel]);
                for (squares, sums) in squares.iter_mut().zip(self.sums) {
                    square_sums(&sums[channel], &factors, squares);
                }
                let squares = squares.as_flattened();
                let (mut sum, mut count) = (0.0, 0.0);
                for (frame, _) in modes.iter().enumerate().filter(|(_, own)| **own == mode as u8) {
                    sum += squares[frame];
                    count += sampled(frame);
                }
                let mean = sum / f64::max(count, 1.0) + ROUNDING;
                let (of_scale, of_square) = (libm::log2(mean), std::f64::consts::LOG2_E / mean);
                for (frame, bits) in bits[mode].iter_mut().enumerate() {
                    *bits += sampled(frame) * of_scale + squares[frame] * of_square;
                }
            }
        }
        let cheapest = |frame: usize| {
            let by_bits = |a: &usize, b: &usize| bits[*a][frame].total_cmp(&bits[*b][frame]);
            (0..weights.len()).min_by(by_bits).unwrap_or(0) as u8
        };
        (0..frames).map(cheapest).collect()
    }
}

/// Factors on the sums of products that give the sum of squared residuals.
fn square_factors(weights: &[i8; WEIGHTS]) -> [f64; PRODUCTS] {
    let part = |term: usize| weights.get(term).map_or(1.0, |&weight| -f64::from(weight) / 32.0);
    let mut factors = [0.0; PRODUCTS];
    let pairs = (0..=WEIGHTS).flat_map(|row| (0..=row).map(move |column| (row, column)));
    for (factor, (row, column)) in factors.iter_mut().zip(pairs) {
        *factor = part(row) * part(column) * if row == column { 1.0 } else { 2.0 };
    }
    factors
}

/// The sum of squared residuals of each frame.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2", "aarch64+neon"))]
fn square_sums<const L: usize>(sums: &Sums<L>, factors: &[f64; PRODUCTS], squares: &mut [f64; L]) {
    *squares = [0.0; L];
    for (products, factor) in sums.products.iter().zip(factors) {
        for (square, product) in squares.iter_mut().zip(products) {
            *square += factor * product;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const L: usize = 4;
    const SHAPE: FrameShape =
        FrameShape { number: crate::model::baked::NumberType::U8, channels: 2, edge: 8 };

    /// Sums of samples of all terms and the value.
    fn sums(frames: &[Vec<[f64; WEIGHTS + 1]>]) -> Vec<Sums<L>> {
        let one = |frames: &[Vec<[f64; WEIGHTS + 1]>]| {
            let mut sums = Sums { sizes: [0.0; L], products: [[0.0; L]; PRODUCTS] };
            for (lane, samples) in frames.iter().enumerate() {
                for sample in samples {
                    sums.sizes[lane] += sample[WEIGHTS].abs();
                    let pairs = (0..=WEIGHTS).flat_map(|row| (0..=row).map(move |c| (row, c)));
                    for (product, (row, column)) in sums.products.iter_mut().zip(pairs) {
                        product[lane] += sample[row] * sample[column];
                    }
                }
            }
            sums
        };
        frames.chunks(L).map(one).collect()
    }

    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        ((*state >> 40) as f64 / 2f64.powi(24) - 0.5) * 40.0
    }

    #[test]
    fn sums_of_squared_misses_are_those_of_the_samples() {
        let mut state = 3;
        let frames: Vec<Vec<[f64; WEIGHTS + 1]>> = (0..L)
            .map(|_| (0..60).map(|_| [(); _].map(|()| random(&mut state))).collect())
            .collect();
        let weights = [31, -7, 12, 0, -127];
        let mut found = [0.0; L];
        square_sums(&sums(&frames)[0], &square_factors(&weights), &mut found);
        for (found, samples) in found.iter().zip(&frames) {
            let miss = |sample: &[f64; WEIGHTS + 1]| {
                let terms = sample.iter().zip(weights);
                sample[WEIGHTS] - terms.map(|(term, w)| term * f64::from(w) / 32.0).sum::<f64>()
            };
            let plain: f64 = samples.iter().map(|sample| miss(sample).powi(2)).sum();
            assert!((found - plain).abs() < 1e-9 * plain, "{found} {plain}");
        }
    }

    #[test]
    fn frames_of_two_kinds_are_told_apart_where_activity_is_the_same() {
        let mut state = 9;
        let kinds = [[32, 0, 0, 0, 0], [0, 0, 32, 0, 0]];
        let frames: Vec<Vec<[f64; WEIGHTS + 1]>> = (0..96)
            .map(|frame| {
                let sample = |_| {
                    let mut sample: [f64; WEIGHTS + 1] = [(); _].map(|()| random(&mut state));
                    let kind = kinds[frame / 3 % 2];
                    sample[WEIGHTS] =
                        (0..WEIGHTS).map(|i| sample[i] * f64::from(kind[i]) / 32.0).sum();
                    sample
                };
                (0..100).map(sample).collect()
            })
            .collect();
        let sums = sums(&frames);
        let sums: Vec<Vec<Sums<L>>> =
            sums.into_iter().map(|sums| vec![sums.clone(), sums]).collect();
        let Modes { of_frames, weights } = Modes::of(SHAPE, &[500; 96], &sums);
        for (frame, &mode) in of_frames.iter().enumerate() {
            let own = weights[usize::from(mode)][1];
            assert_eq!(own, kinds[frame / 3 % 2], "frame {frame} in mode {mode}: {weights:?}");
        }
    }

    #[test]
    fn a_run_of_one_frame_without_live_nodes_has_one_mode() {
        let sums = sums(&[Vec::new()]);
        let sums = vec![vec![sums[0].clone(), sums[0].clone()]];
        let Modes { of_frames, weights } = Modes::of(SHAPE, &[0], &sums);
        assert_eq!((of_frames, weights), (vec![0], vec![vec![[0; WEIGHTS]; 2]]));
    }
}
