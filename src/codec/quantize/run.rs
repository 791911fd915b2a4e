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

use std::sync::Arc;

use super::predict::{CHANNELS_BEFORE, Channel, WEIGHTS};
use super::read_run::{RunParts, Scratch};
use super::wide::{Code, Wide};
use super::write_run::Encoder;
use crate::base::error::{Error, Place, Result};
use crate::model::baked::{Codes, NumberType};

/// Frames that are worked on together; of few frames fewer.
const MANY: usize = 64;
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
    pub(super) fn live_bytes(&self) -> usize {
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
pub(super) fn terms(channel: usize) -> usize {
    WEIGHTS - CHANNELS_BEFORE + channel.min(CHANNELS_BEFORE)
}

/// The codes of one block, all channels of a group.
#[derive(Debug, Clone)]
pub struct Frame {
    /// `[channel][node]`.
    pub codes: Codes,
    /// Of each node, whether its codes count; others are filled with what costs least.
    pub needed: Arc<[bool]>,
}

/// A run before compression.
#[derive(Debug, Clone)]
pub struct RunBytes {
    /// All of it.
    pub bytes: Vec<u8>,
    /// Where statistics change, ascending; the last is the end.
    pub sections: Vec<usize>,
}

/// The bytes of a run of `frames`, at least one, whose codes are of the shape's number type. Codes that nobody needs
/// become at most `most`.
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

/// The same with codes of each width.
macro_rules! each_width {
    ($codes:expr, $of_one:ident => $value:expr) => {
        match $codes {
            Codes::U8($of_one) => $value,
            Codes::U16($of_one) => $value,
            Codes::U32($of_one) => $value,
        }
    };
}
pub(super) use each_width;

/// Codes of one type.
pub(super) trait Typed: Code {
    /// The codes, if they are of this type.
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
pub(super) type LaneWeights<T, const L: usize> = [[<T as Code>::Wide; L]; WEIGHTS];

/// The weights that each lane's mode has in one channel.
pub(super) fn lane_weights<T: Code, const L: usize>(
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
pub(super) fn before<T: Code, const L: usize>(
    channels: &[Channel<T, L>],
    channel: usize,
) -> &[Channel<T, L>] {
    &channels[channel.saturating_sub(CHANNELS_BEFORE)..channel]
}

/// Codes of a run, `[frame][channel][node]`, into `codes`, whose length says how many frames there are.
pub fn run_codes<T: Code>(
    shape: FrameShape,
    bytes: &[u8],
    codes: &mut [T],
    place: &Place,
) -> Result<()> {
    let frames = codes.len() / (shape.channels * shape.nodes());
    let run = RunParts::read(shape, frames, bytes).map_err(|expected| {
        let found = format!("a run of {} bytes for {frames} frames", bytes.len());
        Error::malformed(place.clone(), found, expected)
    })?;
    if frames <= 2 * FEW {
        restore_all::<T, FEW>(shape, &run, codes);
    } else {
        restore_all::<T, MANY>(shape, &run, codes);
    }
    Ok(())
}

/// Restores a run's frames, `L` at once.
fn restore_all<T: Code, const L: usize>(shape: FrameShape, run: &RunParts, codes: &mut [T]) {
    let mut scratch = Scratch::<T, L>::new(shape.nodes());
    for (batch, codes) in codes.chunks_mut(L * shape.channels * shape.nodes()).enumerate() {
        run.restore(batch * L, codes, &mut scratch);
    }
}
