//! Converts frames of one group to the bytes of a run, before compression, and back.
//!
//! ```text
//! u8 modes; their weights; u8 mode of each frame; live bits of each frame;
//! residual bytes of live nodes
//! ```
//!
//! A node whose codes equal the mean of its lower neighbours in every channel is not *live*, and
//! has no residuals: don't-care nodes take that mean, and cost one bit for all channels together.
//! Each frame belongs to the mode in which it takes the fewest bits ([`super::modes`]). Each mode
//! has its own weights, and its residuals are contiguous, so that an entropy coder can have a table
//! for each. Everything depends on the codes alone: the same codes give the same bytes, and a
//! writer need not know the retained nodes.

use super::code_word::Code;
use super::frame::{Frame, FrameShape, RunBytes};
use super::read_run::{RunParts, Scratch};
use super::write_run::Encoder;
use crate::base::error::{Error, Place, Result};
use crate::model::baked::NumberType;

/// Frames that are processed together; fewer for few frames.
const MANY: usize = 64;
const FEW: usize = 4;

/// Maximum bytes of memory for making a run of this many frames, beside the frames.
pub fn encoder_bytes(shape: FrameShape, frames: usize) -> usize {
    let lanes = if frames <= 2 * FEW { FEW } else { MANY };
    let code = shape.number.bytes();
    // A channel's codes, and its differences in numbers twice as wide; retained, live and residual
    // lanes; rows of a batch; then residuals in the order of frames, and their bytes.
    let lane = (3 * shape.channels + 3) * code;
    let frame = (1 + shape.channels) * code;
    (frames.next_multiple_of(lanes) * lane + (lanes + frames) * frame) * shape.nodes()
}

/// The bytes of a run of `frames`, at least one, whose codes are of the shape's number type. Codes
/// of don't-care nodes become at most `dont_care_max`.
pub fn run_bytes(shape: FrameShape, frames: &[Frame], dont_care_max: u32) -> RunBytes {
    let few = frames.len() <= 2 * FEW;
    match (shape.number, few) {
        (NumberType::U8, false) => Encoder::<u8, MANY>::new(shape, frames, dont_care_max).run(),
        (NumberType::U8, true) => Encoder::<u8, FEW>::new(shape, frames, dont_care_max).run(),
        (NumberType::U16 | NumberType::F16, false) => {
            Encoder::<u16, MANY>::new(shape, frames, dont_care_max).run()
        }
        (NumberType::U16 | NumberType::F16, true) => {
            Encoder::<u16, FEW>::new(shape, frames, dont_care_max).run()
        }
        (NumberType::F32, false) => Encoder::<u32, MANY>::new(shape, frames, dont_care_max).run(),
        (NumberType::F32, true) => Encoder::<u32, FEW>::new(shape, frames, dont_care_max).run(),
    }
}

/// Decodes a run into `codes`, `[frame][channel][node]`, whose length gives the number of frames.
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
