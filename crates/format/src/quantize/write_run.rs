//! Encodes frames to the bytes of a run.

use super::code_word::Code;
use super::frame::{Frame, FrameShape, RunBytes, before, lane_weights, terms};
use super::lanes::{gather, spread};
use super::modes::Modes;
use super::predict::{self, Channel, Lanes};
use super::sums::{self, Sums};
use crate::model::grid::row;

/// Frames that are encoded together, lane by lane.
struct Batch<T: Code, const L: usize> {
    channels: Vec<Channel<T, L>>,
    live: Lanes<T, L>,
}

/// A run's frames, with the codes of don't-care nodes set.
pub struct Encoder<T: Code, const L: usize> {
    shape: FrameShape,
    frames: usize,
    batches: Vec<Batch<T, L>>,
    /// The live bits of each frame.
    live: Vec<Vec<u8>>,
}

impl<T: Code, const L: usize> Encoder<T, L> {
    /// Adds frames, and sets codes of don't-care nodes to their mean, or `dont_care_max` if that is
    /// lower.
    pub fn new(shape: FrameShape, frames: &[Frame], dont_care_max: u32) -> Self {
        let nodes = shape.nodes();
        let origin = T::origin(shape.number);
        let mut rows: Vec<T> = Vec::with_capacity(L * nodes);
        let (mut batches, mut bits) = (Vec::new(), Vec::with_capacity(frames.len()));
        for frames in frames.chunks(L) {
            let empty = || vec![[T::default(); L]; nodes];
            let (mut retained, mut live) = (empty(), empty());
            rows.clear();
            for frame in frames {
                rows.extend(
                    frame.retained.iter().map(|&retained| T::default().with_all_if(retained)),
                );
            }
            spread(&rows.chunks_exact(nodes).collect::<Vec<_>>(), &mut retained);
            let mut channels = Vec::with_capacity(shape.channels);
            for channel in 0..shape.channels {
                let rows = frames.iter().map(|frame| &T::of(&frame.codes)[channel * nodes..]);
                let rows: Vec<_> = rows.map(|codes| &codes[..nodes]).collect();
                let mut lanes = Channel::new(nodes);
                spread(&rows, &mut lanes.codes);
                let dont_care_max = T::narrow(dont_care_max);
                predict::set_dont_care(
                    shape.edge,
                    origin,
                    dont_care_max,
                    &retained,
                    &mut lanes,
                    &mut live,
                );
                channels.push(lanes);
            }
            gather(&live, &mut rows, nodes, nodes);
            bits.extend(rows.chunks_exact(nodes).map(live_bits));
            batches.push(Batch { channels, live });
        }
        let live = bits;
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
                    sums::sums(edge, &batch.live, before, &batch.channels[c])
                };
                (0..channels).map(sums).collect()
            })
            .collect();
        let live_counts: Vec<usize> = self.live.iter().map(|live| count_live(live)).collect();
        let Modes { of_frames: modes, weights } = Modes::of(self.shape, &live_counts, &sums);
        let mut order: Vec<usize> = (0..self.frames).collect();
        order.sort_by_key(|&frame| (modes[frame], frame));
        let mut bytes = vec![weights.len() as u8];
        for mode_weights in &weights {
            for (channel, weights) in mode_weights.iter().enumerate() {
                bytes.extend(weights[..terms(channel)].iter().map(|weight| weight.cast_unsigned()));
            }
        }
        bytes.extend(&modes);
        self.live.iter().for_each(|live| bytes.extend(live));
        let mut sections = vec![bytes.len()];
        let start = bytes.len();
        let live: usize = live_counts.iter().sum();
        // Extra room, so that bytes can be written before it is known whether they count.
        bytes.resize(start + live * channels * T::BYTES + 8, 0);
        let mut at = start;
        let nodes = self.shape.nodes();
        let mut lanes = vec![[T::default(); L]; nodes];
        let mut residuals = vec![T::default(); self.frames * nodes];
        for channel in 0..channels {
            let batches = self.batches.iter().zip(residuals.chunks_mut(L * nodes));
            for ((batch, residuals), modes) in batches.zip(modes.chunks(L)) {
                let weights = lane_weights::<T, L>(modes, |mode| weights[mode as usize][channel]);
                let before = before(&batch.channels, channel);
                predict::residuals(edge, before, &weights, &batch.channels[channel], &mut lanes);
                gather(&lanes, residuals, nodes, nodes);
            }
            for byte in 0..T::BYTES {
                let mut mode = 0;
                for &frame in &order {
                    if modes[frame] != mode {
                        mode = modes[frame];
                        sections.push(at);
                    }
                    let (whole, rest) = residuals[frame * nodes..][..nodes].as_chunks::<8>();
                    for (nodes, &live) in whole.iter().zip(&self.live[frame]) {
                        at += put_eight(nodes, live, byte, &mut bytes[at..]);
                    }
                    if let Some(&live) = self.live[frame].get(whole.len()) {
                        at += put_eight(rest, live, byte, &mut bytes[at..]);
                    }
                }
                sections.push(at);
            }
        }
        bytes.truncate(at);
        RunBytes { bytes, sections }
    }
}

/// Live nodes of a frame.
fn count_live(bits: &[u8]) -> usize {
    bits.iter().map(|bits| bits.count_ones() as usize).sum()
}

/// For each byte of live bits, the set bits, lowest first.
const LIVE: [[u8; 8]; 256] = live_places();

const fn live_places() -> [[u8; 8]; 256] {
    let mut places = [[0; 8]; 256];
    let mut place = 0;
    while place < 256 * 8 {
        let (live, bit) = (place / 8, place % 8);
        if live >> bit & 1 == 1 {
            places[live][(live & ((1 << bit) - 1)).count_ones() as usize] = bit as u8;
        }
        place += 1;
    }
    places
}

/// Writes a byte of the residuals of up to eight nodes, live ones first, and returns the number of
/// live nodes.
#[inline(always)]
fn put_eight<T: Code>(nodes: &[T], live: u8, byte: usize, out: &mut [u8]) -> usize {
    let mut whole = [T::default(); 8];
    let nodes = nodes.first_chunk().unwrap_or_else(|| {
        whole[..nodes.len()].copy_from_slice(nodes);
        &whole
    });
    if let Some(out) = out.first_chunk_mut::<8>() {
        // Branch-free, because live nodes alternate along surfaces.
        for (out, &place) in out.iter_mut().zip(&LIVE[usize::from(live)]) {
            *out = nodes[usize::from(place & 7)].byte(byte);
        }
    }
    live.count_ones() as usize
}

/// The live bits of a frame.
fn live_bits<T: Code>(live: &[T]) -> Vec<u8> {
    let byte = |nodes: &[T]| {
        let mut eight = [0; 8];
        for (bit, live) in eight.iter_mut().zip(nodes) {
            *bit = live.byte(0) & 1;
        }
        row::lowest_bits(eight)
    };
    let (whole, rest) = live.as_chunks::<8>();
    let mut bits: Vec<u8> = whole.iter().map(|nodes| byte(nodes)).collect();
    if !rest.is_empty() {
        bits.push(byte(rest));
    }
    bits
}
