//! Frames to the bytes of a run.

use super::fit;
use super::predict::{self, Channel, Lanes, Sums, WEIGHTS};
use super::run::{Frame, FrameShape, RunBytes, Typed, before, lane_weights, terms};

/// Frames that a mode has at least, so that its weights and tables pay.
const FRAMES_OF_A_MODE: usize = 24;
/// Modes of a run at most.
const MOST_MODES: usize = 8;

/// Frames that are encoded together, lane by lane.
struct Batch<T, const L: usize> {
    channels: Vec<Channel<T, L>>,
    live: Lanes<T, L>,
    /// Lanes that hold a frame.
    count: usize,
}

/// A run's frames, filled.
pub struct Encoder<T, const L: usize> {
    shape: FrameShape,
    frames: usize,
    batches: Vec<Batch<T, L>>,
    /// Live nodes of each frame.
    live: Vec<usize>,
}

impl<T: Typed, const L: usize> Encoder<T, L> {
    /// Takes frames, and gives codes that nobody needs their mean, or `most` where that is lower.
    pub fn new(shape: FrameShape, frames: &[Frame], most: u32) -> Self {
        let nodes = shape.nodes();
        let origin = T::origin(shape.number);
        let batches: Vec<Batch<T, L>> = frames
            .chunks(L)
            .map(|frames| {
                let empty = || vec![[T::default(); L]; nodes];
                let (mut needed, mut live) = (empty(), empty());
                for (lane, frame) in frames.iter().enumerate() {
                    for (out, &is_needed) in needed.iter_mut().zip(&frame.needed) {
                        out[lane] = T::default().with_all_if(is_needed);
                    }
                }
                let mut channels = Vec::with_capacity(shape.channels);
                for channel in 0..shape.channels {
                    let mut lanes = Channel { codes: empty(), means: empty() };
                    for (lane, frame) in frames.iter().enumerate() {
                        let codes = &T::of(&frame.codes)[channel * nodes..][..nodes];
                        for (out, &code) in lanes.codes.iter_mut().zip(codes) {
                            out[lane] = code;
                        }
                    }
                    let most = T::narrow(most);
                    predict::fill(shape.edge, origin, most, &needed, &mut lanes, &mut live);
                    channels.push(lanes);
                }
                Batch { channels, live, count: frames.len() }
            })
            .collect();
        let mut live = Vec::with_capacity(frames.len());
        for batch in &batches {
            let mut counts = [0; L];
            for lanes in &batch.live {
                for (count, live) in counts.iter_mut().zip(lanes) {
                    *count += usize::from(*live != T::default());
                }
            }
            live.extend(&counts[..batch.count]);
        }
        Self { shape, frames: frames.len(), batches, live }
    }

    /// The run.
    pub fn run(self) -> RunBytes {
        let FrameShape { channels, edge, .. } = self.shape;
        let sums: Vec<Vec<Sums<L>>> = self
            .batches
            .iter()
            .map(|batch| {
                let sums = |c: usize| {
                    let before = before(&batch.channels, c);
                    predict::sums(edge, &batch.live, before, &batch.channels[c])
                };
                (0..channels).map(sums).collect()
            })
            .collect();
        let (modes, order) = self.modes(&sums);
        let count = modes.iter().max().map_or(1, |&mode| mode + 1);
        let weights = self.weights(&sums, &modes, count);
        let mut bytes = vec![count];
        for of_mode in &weights {
            for (channel, weights) in of_mode.iter().enumerate() {
                bytes.extend(weights[..terms(channel)].iter().map(|weight| weight.cast_unsigned()));
            }
        }
        bytes.extend(&modes);
        self.live_bits(&mut bytes);
        let mut sections = vec![bytes.len()];
        let start = bytes.len();
        let live: usize = self.live.iter().sum();
        // One more, so that a byte can be written before it is known whether it counts.
        bytes.resize(start + live * channels * T::BYTES + 1, 0);
        let mut at = start;
        let mut residuals = vec![vec![[T::default(); L]; self.shape.nodes()]; self.batches.len()];
        for channel in 0..channels {
            for ((batch, residuals), modes) in
                self.batches.iter().zip(&mut residuals).zip(modes.chunks(L))
            {
                let weights = lane_weights::<T, L>(modes, |mode| weights[mode as usize][channel]);
                let before = before(&batch.channels, channel);
                predict::residuals(edge, before, &weights, &batch.channels[channel], residuals);
            }
            for byte in 0..T::BYTES {
                let mut mode = 0;
                for &frame in &order {
                    if modes[frame] != mode {
                        mode = modes[frame];
                        sections.push(at);
                    }
                    let (batch, lane) = (frame / L, frame % L);
                    for (residual, live) in residuals[batch].iter().zip(&self.batches[batch].live) {
                        bytes[at] = residual[lane].byte(byte);
                        at += usize::from(live[lane] != T::default());
                    }
                }
                sections.push(at);
            }
        }
        bytes.truncate(at);
        RunBytes { bytes, sections }
    }

    /// The mode of each frame, and frames in the order of their modes.
    fn modes(&self, sums: &[Vec<Sums<L>>]) -> (Vec<u8>, Vec<usize>) {
        let activity = |frame: usize| {
            let sizes: f64 = sums[frame / L].iter().map(|sums| sums.sizes[frame % L]).sum();
            sizes / self.live[frame].max(1) as f64
        };
        let mut order: Vec<usize> = (0..self.frames).collect();
        let activities: Vec<f64> = order.iter().map(|&frame| activity(frame)).collect();
        order.sort_by(|&a, &b| activities[a].total_cmp(&activities[b]).then(a.cmp(&b)));
        let count = (self.frames / FRAMES_OF_A_MODE).clamp(1, MOST_MODES);
        let mut modes = vec![0; self.frames];
        for (rank, &frame) in order.iter().enumerate() {
            modes[frame] = (rank * count / self.frames) as u8;
        }
        order.sort_by_key(|&frame| (modes[frame], frame));
        (modes, order)
    }

    /// The weights of each mode's channels.
    fn weights(&self, sums: &[Vec<Sums<L>>], modes: &[u8], count: u8) -> Vec<Vec<[i8; WEIGHTS]>> {
        let mut products =
            vec![vec![[0.0; fit::PRODUCTS]; self.shape.channels]; usize::from(count)];
        for (frame, &mode) in modes.iter().enumerate() {
            for (total, sums) in products[usize::from(mode)].iter_mut().zip(&sums[frame / L]) {
                for (total, lanes) in total.iter_mut().zip(&sums.products) {
                    *total += lanes[frame % L];
                }
            }
        }
        let of_mode = |products: Vec<[f64; fit::PRODUCTS]>| {
            let all = products.iter().enumerate();
            all.map(|(channel, products)| fit::weights(products, terms(channel))).collect()
        };
        products.into_iter().map(of_mode).collect()
    }

    fn live_bits(&self, bytes: &mut Vec<u8>) {
        for batch in &self.batches {
            for lane in 0..batch.count {
                for nodes in batch.live.chunks(8) {
                    let bit =
                        |(i, live): (usize, &[T; L])| u8::from(live[lane] != T::default()) << i;
                    bytes.push(nodes.iter().enumerate().map(bit).fold(0, |byte, bit| byte | bit));
                }
            }
        }
    }
}
