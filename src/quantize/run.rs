//! Frames of one group to the bytes of a run, before compression, and back.
//!
//! ```text
//! u8 modes; their weights; u8 mode of each frame; live bits of each frame; residual bytes of live nodes
//! ```
//!
//! A node whose codes are the mean of its lower neighbours in every channel is not *live*, and has no residuals: what
//! nobody needs is filled that way, and takes a bit for all channels together. Frames are sorted into modes by how far
//! off the mean their codes are; each mode has weights of its own, and its residuals lie together, so that an entropy coder
//! can have a table for each. All of it follows from the codes alone, so the same codes are the same bytes, whoever knows
//! what is needed.

use super::fit;
use super::predict::{self, CHANNELS_BEFORE, Channel, Lanes, Sums, WEIGHTS};
use super::wide::{Code, Wide};
use crate::baked::{Codes, NumberType};
use crate::error::{Error, Place, Result};

/// Frames that a mode has at least, so that its weights and tables pay.
const FRAMES_OF_A_MODE: usize = 24;
/// Modes of a run at most.
const MOST_MODES: usize = 8;
/// Frames that are worked on together; of few frames fewer.
const MANY: usize = 32;
const FEW: usize = 4;

/// Shape of the frames of an atlas.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameShape {
    /// How codes are stored.
    pub number: NumberType,
    /// Channels of a frame.
    pub channels: usize,
    /// Nodes along a block's edge.
    pub edge: usize,
}

impl FrameShape {
    /// Nodes of a channel.
    pub fn nodes(&self) -> usize {
        self.edge.pow(3)
    }

    /// Bytes of a frame's codes.
    pub fn bytes(&self) -> usize {
        self.channels * self.nodes() * self.number.bytes()
    }

    /// Bytes of a frame's live bits.
    fn live_bytes(&self) -> usize {
        self.nodes().div_ceil(8)
    }

    /// Weights of a mode, all channels.
    fn weights(&self) -> usize {
        (0..self.channels).map(terms).sum()
    }

    /// The most bytes that a run of so many frames can have.
    pub fn most_bytes(&self, frames: usize) -> Option<usize> {
        let of_frame = self.bytes() + self.live_bytes() + 1;
        frames.checked_mul(of_frame)?.checked_add(1 + 255 * self.weights())
    }
}

/// Weights of a channel's predictions.
fn terms(channel: usize) -> usize {
    WEIGHTS - CHANNELS_BEFORE + channel.min(CHANNELS_BEFORE)
}

/// The codes of one block, all channels of a group.
#[derive(Debug, Clone)]
pub struct Frame {
    /// `[channel][node]`.
    pub codes: Codes,
    /// Of each node, whether its codes count; others are filled with what costs least.
    pub needed: Vec<bool>,
}

/// A run before compression.
#[derive(Debug, Clone)]
pub struct RunBytes {
    /// All of it.
    pub bytes: Vec<u8>,
    /// Where statistics change, ascending; the last is the end.
    pub sections: Vec<usize>,
}

/// The bytes of a run of `frames`, at least one. Codes that nobody needs become at most `most`.
pub fn run_bytes(shape: FrameShape, frames: &[Frame], most: u32) -> RunBytes {
    let few = frames.len() <= 2 * FEW;
    match (shape.number, few) {
        (NumberType::U8, false) => Encoder::<u8, MANY>::new(shape, frames, most).run(),
        (NumberType::U8, true) => Encoder::<u8, FEW>::new(shape, frames, most).run(),
        (NumberType::U16 | NumberType::F16, false) => {
            Encoder::<u16, MANY>::new(shape, frames, most).run()
        }
        (NumberType::U16 | NumberType::F16, true) => {
            Encoder::<u16, FEW>::new(shape, frames, most).run()
        }
        (NumberType::F32, false) => Encoder::<u32, MANY>::new(shape, frames, most).run(),
        (NumberType::F32, true) => Encoder::<u32, FEW>::new(shape, frames, most).run(),
    }
}

/// What a frame has in each code type.
trait Typed: Code {
    fn of(codes: &Codes) -> &[Self];
}

macro_rules! typed {
    ($code:ty, $variant:ident) => {
        impl Typed for $code {
            fn of(codes: &Codes) -> &[Self] {
                if let Codes::$variant(codes) = codes { codes } else { &[] }
            }
        }
    };
}

typed!(u8, U8);
typed!(u16, U16);
typed!(u32, U32);

/// The weights of every lane.
type LaneWeights<T, const L: usize> = [[<T as Code>::Wide; L]; WEIGHTS];

/// The weights that each lane's mode has in one channel.
fn lane_weights<T: Code, const L: usize>(
    modes: &[u8],
    of_mode: impl Fn(u8) -> [i8; WEIGHTS],
) -> LaneWeights<T, L> {
    let mut out = [[T::Wide::default(); L]; WEIGHTS];
    for (lane, &mode) in modes.iter().enumerate() {
        for (out, weight) in out.iter_mut().zip(of_mode(mode)) {
            out[lane] = T::Wide::from_i8(weight);
        }
    }
    out
}

/// The channels that predictions of `channel` look at.
fn before<T, const L: usize>(channels: &[Channel<T, L>], channel: usize) -> &[Channel<T, L>] {
    &channels[channel.saturating_sub(CHANNELS_BEFORE)..channel]
}

/// Frames that are encoded together, lane by lane.
struct Batch<T, const L: usize> {
    channels: Vec<Channel<T, L>>,
    live: Lanes<T, L>,
    /// Lanes that hold a frame.
    count: usize,
}

struct Encoder<T, const L: usize> {
    shape: FrameShape,
    frames: usize,
    batches: Vec<Batch<T, L>>,
    /// Live nodes of each frame.
    live: Vec<usize>,
}

impl<T: Typed, const L: usize> Encoder<T, L> {
    fn new(shape: FrameShape, frames: &[Frame], most: u32) -> Self {
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

    fn run(self) -> RunBytes {
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
    fn weights(
        &self,
        sums: &[Vec<Sums<L>>],
        modes: &[u8],
        count: u8,
    ) -> Vec<Vec<[i8; WEIGHTS]>> {
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
                    let bit = |(i, live): (usize, &[T; L])| u8::from(live[lane] != T::default()) << i;
                    bytes.push(nodes.iter().enumerate().map(bit).fold(0, |byte, bit| byte | bit));
                }
            }
        }
    }
}

/// Codes of a run, `[frame][channel][node]`, into `codes`, whose length says how many frames there are.
pub fn run_codes<T: Code>(
    shape: FrameShape,
    bytes: &[u8],
    codes: &mut [T],
    place: &Place,
) -> Result<()> {
    let frames = codes.len() / (shape.channels * shape.nodes());
    let run = Run::read(shape, frames, bytes).map_err(|expected| {
        let found = format!("a run of {} bytes for {frames} frames", bytes.len());
        Error::malformed(place.clone(), found, expected)
    })?;
    let size = if frames <= 2 * FEW { FEW } else { MANY };
    let length = size * shape.channels * shape.nodes();
    for (batch, codes) in codes.chunks_mut(length).enumerate() {
        if size == FEW {
            run.restore::<T, FEW>(batch * size, codes);
        } else {
            run.restore::<T, MANY>(batch * size, codes);
        }
    }
    Ok(())
}

/// A run whose parts are found.
struct Run<'a> {
    shape: FrameShape,
    /// Of each mode's channels.
    weights: Vec<Vec<[i8; WEIGHTS]>>,
    modes: &'a [u8],
    live: &'a [u8],
    /// Live nodes before each frame, in the order of modes.
    starts: Vec<usize>,
    /// Live nodes in all.
    count: usize,
    residuals: &'a [u8],
}

impl<'a> Run<'a> {
    /// Finds the parts; the error says what was expected.
    fn read(shape: FrameShape, frames: usize, bytes: &'a [u8]) -> std::result::Result<Self, &'static str> {
        let mut left = bytes;
        let mut take = |count: usize| {
            let (taken, rest) = left.split_at_checked(count).ok_or("more bytes")?;
            left = rest;
            Ok::<_, &'static str>(taken)
        };
        let count = usize::from(take(1)?[0]);
        if count == 0 {
            return Err("at least one mode");
        }
        let mut weights = vec![vec![[0; WEIGHTS]; shape.channels]; count];
        for weights in &mut weights {
            for (channel, weights) in weights.iter_mut().enumerate() {
                for (weight, byte) in weights.iter_mut().zip(take(terms(channel))?) {
                    *weight = byte.cast_signed();
                }
            }
        }
        let modes = take(frames)?;
        if modes.iter().any(|&mode| usize::from(mode) >= count) {
            return Err("modes that the run has");
        }
        let live = take(frames.saturating_mul(shape.live_bytes()))?;
        let spare = shape.nodes() % 8;
        let (mut counts, mut by_mode) = (Vec::with_capacity(frames), vec![0; count]);
        for (live, &mode) in live.chunks_exact(shape.live_bytes()).zip(modes) {
            if spare > 0 && live[live.len() - 1] >> spare != 0 {
                return Err("no live bits of nodes that a block does not have");
            }
            let count: usize = live.iter().map(|byte| byte.count_ones() as usize).sum();
            by_mode[usize::from(mode)] += count;
            counts.push(count);
        }
        let mut next = 0;
        for start in &mut by_mode {
            next += std::mem::replace(start, next);
        }
        let start = |(count, &mode): (usize, &u8)| {
            let next = by_mode[usize::from(mode)] + count;
            std::mem::replace(&mut by_mode[usize::from(mode)], next)
        };
        let starts = counts.into_iter().zip(modes).map(start).collect();
        if left.len() != next * shape.channels * shape.number.bytes() {
            return Err("a residual of each live node and channel");
        }
        Ok(Self { shape, weights, modes, live, starts, count: next, residuals: left })
    }

    /// Codes of up to `L` frames from `first` on.
    fn restore<T: Code, const L: usize>(&self, first: usize, codes: &mut [T]) {
        let FrameShape { number, channels, edge } = self.shape;
        let nodes = self.shape.nodes();
        let frames = codes.len() / (channels * nodes);
        let modes = &self.modes[first..][..frames];
        let empty = || vec![[T::default(); L]; nodes];
        let (mut live, mut residuals) = (empty(), empty());
        let bits = self.live.chunks_exact(self.shape.live_bytes());
        for (lane, bits) in bits.skip(first).take(frames).enumerate() {
            for (lanes, &byte) in live.chunks_mut(8).zip(bits) {
                for (i, lanes) in lanes.iter_mut().enumerate() {
                    lanes[lane] = T::default().with_all_if(byte >> i & 1 == 1);
                }
            }
        }
        // The channel that is made, after those that its predictions look at.
        let mut known: Vec<Channel<T, L>> = Vec::with_capacity(CHANNELS_BEFORE + 1);
        for channel in 0..channels {
            for lane in 0..frames {
                self.take_residuals(first + lane, channel, lane, &live, &mut residuals);
            }
            let weights =
                lane_weights::<T, L>(modes, |mode| self.weights[usize::from(mode)][channel]);
            let mut made = match known.len() > CHANNELS_BEFORE {
                true => known.remove(0),
                false => Channel { codes: empty(), means: empty() },
            };
            let before = before(&known, known.len());
            let origin = T::origin(number);
            predict::restore(edge, origin, &live, &residuals, before, &weights, &mut made);
            for (lane, codes) in codes.chunks_exact_mut(channels * nodes).enumerate() {
                for (out, code) in codes[channel * nodes..].iter_mut().zip(&made.codes) {
                    *out = code[lane];
                }
            }
            known.push(made);
        }
    }

    /// Residuals of one frame and channel into a lane. What is not live may get anything.
    fn take_residuals<T: Code, const L: usize>(
        &self,
        frame: usize,
        channel: usize,
        lane: usize,
        live: &[[T; L]],
        residuals: &mut [[T; L]],
    ) {
        let planes = self.residuals.get(channel * T::BYTES * self.count + self.starts[frame]..);
        let planes = planes.unwrap_or_default();
        let mut at = 0;
        for (residual, live) in residuals.iter_mut().zip(live) {
            let mut number = 0;
            for byte in 0..T::BYTES {
                // After the last live node there may be no byte, and none is needed.
                let byte_of = planes.get(byte * self.count + at).copied().unwrap_or(0);
                number |= u32::from(byte_of) << (8 * byte);
            }
            residual[lane] = T::narrow(number);
            at += usize::from(live[lane] != T::default());
        }
    }
}
