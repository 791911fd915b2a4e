//! Decodes the bytes of a run to codes.

use super::code_word::Code;
use super::frame::{FrameShape, before, lane_weights, terms};
use super::lanes::{gather, spread};
use super::predict::{self, CHANNELS_BEFORE, Channel, Lanes, WEIGHTS};

/// For each byte of live bits, the number of set bits below each: the index of a live node's
/// residual among those of eight.
const PLACES: [[u8; 8]; 256] = places();

const fn places() -> [[u8; 8]; 256] {
    let mut places = [[0; 8]; 256];
    let mut place = 0;
    while place < 256 * 8 {
        let (live, bit) = (place / 8, place % 8);
        places[live][bit] = (live & ((1 << bit) - 1)).count_ones() as u8;
        place += 1;
    }
    places
}

/// For each bit, lowest first, a byte with only that bit.
fn byte_masks(bits: u8) -> [u8; 8] {
    const ONES: u64 = 0x0101_0101_0101_0101;
    // Each byte keeps its bit, which carries into the highest if set.
    let own = (u64::from(bits) * ONES) & 0x8040_2010_0804_0201;
    let set = ((own + ONES * 0x7f) >> 7) & ONES;
    (set * 0xff).to_le_bytes()
}

/// A parsed run.
pub struct RunParts<'a> {
    shape: FrameShape,
    /// For the channels of each mode.
    weights: Vec<Vec<[i8; WEIGHTS]>>,
    modes: &'a [u8],
    live: &'a [u8],
    /// Live nodes before each frame, in the order of modes.
    starts: Vec<usize>,
    /// Total live nodes.
    count: usize,
    residuals: &'a [u8],
}

/// Buffers for restoring batches of frames.
pub struct Scratch<T: Code, const L: usize> {
    live: Lanes<T, L>,
    residuals: Lanes<T, L>,
    rows: Vec<T>,
    spare: Vec<Channel<T, L>>,
}

impl<T: Code, const L: usize> Scratch<T, L> {
    /// For batches of blocks of this many nodes.
    pub fn new(nodes: usize) -> Self {
        let empty = || vec![[T::default(); L]; nodes];
        let rows = vec![T::default(); L * nodes];
        Self { live: empty(), residuals: empty(), rows, spare: Vec::new() }
    }
}

impl<'a> RunParts<'a> {
    /// Parses the parts; the error names the expected bytes.
    pub fn read(
        shape: FrameShape,
        frames: usize,
        bytes: &'a [u8],
    ) -> std::result::Result<Self, &'static str> {
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
            let (words, bytes) = live.as_chunks();
            let word_bits = words.iter().map(|&word| u64::from_le_bytes(word).count_ones());
            let byte_bits = bytes.iter().map(|byte| byte.count_ones());
            let count = word_bits.chain(byte_bits).sum::<u32>() as usize;
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
    pub fn restore<T: Code, const L: usize>(
        &self,
        first: usize,
        codes: &mut [T],
        scratch: &mut Scratch<T, L>,
    ) {
        let FrameShape { number, channels, edge } = self.shape;
        let nodes = self.shape.nodes();
        let frames = codes.len() / (channels * nodes);
        let modes = &self.modes[first..][..frames];
        let Scratch { live, residuals, rows, spare } = scratch;
        let rows = &mut rows[..frames * nodes];
        let bits = self.live.chunks_exact(self.shape.live_bytes()).skip(first);
        for (row, bits) in rows.chunks_exact_mut(nodes).zip(bits) {
            let mask = |mask: u8| T::narrow(u32::from_ne_bytes([mask; 4]));
            let (whole, rest) = row.as_chunks_mut::<8>();
            for (row, &bits) in whole.iter_mut().zip(bits) {
                *row = byte_masks(bits).map(mask);
            }
            if let Some(&bits) = bits.get(whole.len()) {
                rest.iter_mut().zip(byte_masks(bits)).for_each(|(live, bits)| *live = mask(bits));
            }
        }
        spread(&rows.chunks_exact(nodes).collect::<Vec<_>>(), live);
        // The current channel, after those that its predictions use.
        let mut known: Vec<Channel<T, L>> = Vec::with_capacity(CHANNELS_BEFORE + 1);
        for channel in 0..channels {
            for (lane, row) in rows.chunks_exact_mut(nodes).enumerate() {
                self.take_residuals(first + lane, channel, row);
            }
            spread(&rows.chunks_exact(nodes).collect::<Vec<_>>(), residuals);
            let weights =
                lane_weights::<T, L>(modes, |mode| self.weights[usize::from(mode)][channel]);
            if known.len() > CHANNELS_BEFORE {
                spare.push(known.remove(0));
            }
            let mut made = spare.pop().unwrap_or_else(|| Channel::new(nodes));
            let before = before(&known, known.len());
            let origin = T::origin(number);
            predict::restore(edge, origin, live, residuals, before, &weights, &mut made);
            gather(&made.codes, &mut codes[channel * nodes..], channels * nodes, nodes);
            known.push(made);
        }
        spare.append(&mut known);
    }

    /// Residuals of one frame and channel. Values of nodes that are not live are unspecified.
    fn take_residuals<T: Code>(&self, frame: usize, channel: usize, row: &mut [T]) {
        let planes = self.residuals.get(channel * T::BYTES * self.count + self.starts[frame]..);
        let planes = planes.unwrap_or_default();
        let bits = &self.live[frame * self.shape.live_bytes()..];
        let (whole, rest) = row.as_chunks_mut::<8>();
        let mut at = 0;
        for (row, &live) in whole.iter_mut().zip(bits) {
            at += self.take_eight(planes, at, live, row);
        }
        if let Some(&live) = bits.get(whole.len()) {
            self.take_eight(planes, at, live, rest);
        }
    }

    /// Residuals of up to eight nodes from place `at` of each plane on, and the number of live
    /// ones.
    #[inline(always)]
    fn take_eight<T: Code>(&self, planes: &[u8], at: usize, live: u8, row: &mut [T]) -> usize {
        // The next bytes of each plane. After the last live node there may be fewer than eight; the
        // missing ones are not used.
        let mut last = [[0; 8]; 4];
        let mut next = [&[0; 8]; 4];
        for (byte, (next, last)) in next.iter_mut().zip(&mut last).enumerate().take(T::BYTES) {
            let left = planes.get(byte * self.count + at..).unwrap_or_default();
            *next = left.first_chunk().unwrap_or_else(|| {
                last[..left.len()].copy_from_slice(left);
                last
            });
        }
        // Branch-free, because live nodes alternate along surfaces.
        let places = &PLACES[usize::from(live)];
        for (out, &place) in row.iter_mut().zip(places) {
            let byte = |byte: usize| u32::from(next[byte][usize::from(place & 7)]) << (8 * byte);
            *out = T::narrow((0..T::BYTES).fold(0, |number, i| number | byte(i)));
        }
        usize::from(places[7] + (live >> 7))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_are_the_bits_of_a_byte() {
        for bits in 0..=u8::MAX {
            let plain = std::array::from_fn(|i| if bits >> i & 1 == 1 { u8::MAX } else { 0 });
            assert_eq!(byte_masks(bits), plain, "{bits:#b}");
        }
    }
}
