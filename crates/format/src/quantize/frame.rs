//! Frames of one group: their shape, their codes, and the common parts of their predictions.

use std::sync::Arc;

use super::code_word::{Code, Wide};
use super::predict::{CHANNELS_BEFORE, Channel, WEIGHTS};
use crate::model::baked::{Codes, NumberType};

/// Shape of the frames of an atlas.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameShape {
    /// Number type of codes.
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
    pub(super) fn live_bytes(&self) -> usize {
        self.nodes().div_ceil(8)
    }

    /// Weights of a mode, all channels.
    fn weights(&self) -> usize {
        (0..self.channels).map(terms).sum()
    }

    /// The most bytes that a run of this many frames can have.
    pub fn max_bytes(&self, frames: usize) -> Option<usize> {
        let frame_bytes = self.bytes() + self.live_bytes() + 1;
        frames.checked_mul(frame_bytes)?.checked_add(1 + 255 * self.weights())
    }
}

/// Weights of a channel's predictions.
pub(super) fn terms(channel: usize) -> usize {
    WEIGHTS - CHANNELS_BEFORE + channel.min(CHANNELS_BEFORE)
}

/// The codes of one block, all channels of a group.
#[derive(Debug, Clone)]
pub struct Frame {
    /// `[channel][node]`.
    pub codes: Codes,
    /// For each node, true if its codes count; the others have the cheapest codes.
    pub retained: Arc<[bool]>,
}

/// A run before compression.
#[derive(Debug, Clone)]
pub struct RunBytes {
    /// All of it.
    pub bytes: Vec<u8>,
    /// Ends of sections with different statistics, ascending; the last is the end of the bytes.
    pub sections: Vec<usize>,
}

/// The weights of every lane.
pub(super) type LaneWeights<T, const L: usize> = [[<T as Code>::Wide; L]; WEIGHTS];

/// The weights that each lane's mode has in one channel.
pub(super) fn lane_weights<T: Code, const L: usize>(
    modes: &[u8],
    mode_weights: impl Fn(u8) -> [i8; WEIGHTS],
) -> LaneWeights<T, L> {
    let mut out = [[T::Wide::default(); L]; WEIGHTS];
    for (lane, &mode) in modes.iter().enumerate() {
        for (out, weight) in out.iter_mut().zip(mode_weights(mode)) {
            out[lane] = T::Wide::from_i8(weight);
        }
    }
    out
}

/// The channels that predictions of `channel` use.
pub(super) fn before<T: Code, const L: usize>(
    channels: &[Channel<T, L>],
    channel: usize,
) -> &[Channel<T, L>] {
    &channels[channel.saturating_sub(CHANNELS_BEFORE)..channel]
}
