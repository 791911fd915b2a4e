//! Planes of values to planes of codes.
//!
//! Values are quantized plane by plane, while they are in a processor's caches; codes have at most
//! a quarter of the size. Codes wait until all planes of a slab are complete, and blocks are cut
//! from them.

use std::ops::Range;
use std::sync::{Arc, Mutex};

use super::code::{Quantizer, decode_codes};
use super::code_word::Code;
use crate::base::lock::lock;
use crate::model::baked::{Codes, Encoding, with_codes};
use crate::model::grid::{NodeMask, row};
use crate::model::scene::Activation;

/// Shorter runs of don't-care nodes are quantized too, because splitting the loop costs more.
const GAP: usize = 16;

/// Quantizes the planes of a level from any thread.
#[derive(Debug)]
pub struct CodePlanes<'a> {
    retained: &'a NodeMask,
    activation: Activation,
    channels: Vec<Channel>,
    /// `[x][channel]`; empty before planes arrive and after they are taken.
    planes: Vec<Vec<Mutex<Codes>>>,
}

#[derive(Debug)]
struct Channel {
    /// The same for all channels of a group.
    quantizer: Arc<Quantizer>,
    bound: Option<f32>,
    everywhere: bool,
    /// Planes for reuse.
    spare: Mutex<Vec<Codes>>,
}

/// A group's part of the planes.
#[derive(Debug, Clone, Copy)]
pub struct GroupCodes<'a> {
    pub encoding: &'a Encoding,
    /// Channels of a node.
    pub channels: usize,
    /// The largest allowed change of a colour or opacity, if bounded.
    pub bound: Option<f32>,
    /// True if all nodes are quantized, retained or not.
    pub everywhere: bool,
}

/// A value whose code exceeds the error bound.
#[derive(Debug, Clone, Copy)]
pub struct Moved {
    /// The node's place along y and z.
    pub at: [usize; 2],
    /// Largest error of its colour or opacity.
    pub bound: f32,
}

/// Codes of consecutive planes.
#[derive(Debug)]
pub struct CodeSlab {
    first: usize,
    /// `[plane][channel]`.
    planes: Vec<Vec<Codes>>,
}

impl CodeSlab {
    /// The codes of one channel of plane `x` of the level.
    pub(super) fn plane(&self, x: usize, channel: usize) -> &Codes {
        &self.planes[x - self.first][channel]
    }
}

impl<'a> CodePlanes<'a> {
    /// For the `retained` nodes of a level and its groups.
    pub fn new<'e>(
        retained: &'a NodeMask,
        activation: Activation,
        groups: impl IntoIterator<Item = GroupCodes<'e>>,
    ) -> Self {
        let mut channels = Vec::new();
        for GroupCodes { encoding, channels: count, bound, everywhere } in groups {
            let quantizer = Arc::new(Quantizer::new(encoding.clone()));
            let channel = || {
                let quantizer = Arc::clone(&quantizer);
                Channel { quantizer, bound, everywhere, spare: Mutex::default() }
            };
            channels.extend(std::iter::repeat_with(channel).take(count));
        }
        let empty = |_| channels.iter().map(|_| Mutex::new(Codes::U8(Vec::new()))).collect();
        let planes = (0..retained.nodes().0[0]).map(empty).collect();
        Self { retained, activation, channels, planes }
    }

    /// Quantizes the retained nodes of a plane. Returns the first node that changes by more than
    /// its group's bound, if any.
    pub fn put(&self, x: usize, channel: usize, values: &[f32]) -> Option<Moved> {
        let Channel { quantizer, bound, everywhere, spare } = &self.channels[channel];
        let used = lock(spare).pop();
        let number = quantizer.encoding().number;
        let mut codes = used.unwrap_or_else(|| Codes::zeroed(number, values.len()));
        match everywhere {
            true => with_codes!(&mut codes, codes => quantizer.encode(values, codes)),
            false => with_codes!(&mut codes, codes => self.quantize(x, quantizer, values, codes)),
        }
        let moved = bound.and_then(|bound| self.moved(x, quantizer, values, &codes, bound));
        *lock(&self.planes[x][channel]) = codes;
        moved
    }

    /// Takes completed planes.
    pub fn take(&self, planes: Range<usize>) -> CodeSlab {
        let take = |plane: &Mutex<Codes>| {
            let mut plane = lock(plane);
            std::mem::replace(&mut *plane, Codes::U8(Vec::new()))
        };
        let first = planes.start;
        let planes = self.planes[planes].iter().map(|plane| plane.iter().map(take).collect());
        CodeSlab { first, planes: planes.collect() }
    }

    /// Takes planes back for reuse.
    pub fn reuse(&self, slab: CodeSlab) {
        for plane in slab.planes {
            for (channel, codes) in self.channels.iter().zip(plane) {
                lock(&channel.spare).push(codes);
            }
        }
    }

    fn quantize<T: Code>(&self, x: usize, quantizer: &Quantizer, values: &[f32], codes: &mut [T]) {
        let nz = self.retained.nodes().0[2];
        let rows = values.chunks_exact(nz).zip(codes.chunks_exact_mut(nz));
        for (y, (values, codes)) in rows.enumerate() {
            for (start, end) in row::spans(self.retained.row(x, y), nz, GAP) {
                quantizer.encode(&values[start..end], &mut codes[start..end]);
            }
        }
    }

    /// Place of the first retained node whose colour or opacity exceeds `bound`.
    fn moved(
        &self,
        x: usize,
        quantizer: &Quantizer,
        values: &[f32],
        codes: &Codes,
        bound: f32,
    ) -> Option<Moved> {
        let (encoding, [_, ny, nz]) = (quantizer.encoding(), self.retained.nodes().0);
        let mut activated =
            Memo::new(|value: f32| encoding.decode.activated(value.into(), &self.activation));
        let mut decoded = vec![0.0; nz];
        for y in 0..ny {
            for (start, end) in row::runs(self.retained.row(x, y)) {
                let run = y * nz + start..y * nz + end;
                let decoded = &mut decoded[..run.len()];
                decode_codes(encoding, codes, run.clone(), decoded);
                let mut is_moved = |(&value, &decoded): (&f32, &f32)| {
                    if decoded == value {
                        return false;
                    }
                    let error = (activated.of(decoded) - activated.of(value)).abs();
                    // NaN always exceeds the bound.
                    error.is_nan() || error > f64::from(bound)
                };
                if let Some(at) = values[run].iter().zip(&*decoded).position(&mut is_moved) {
                    return Some(Moved { at: [y, start + at], bound });
                }
            }
        }
        None
    }
}

/// A function with its latest results: values that were codes before are few.
struct Memo<F> {
    function: F,
    /// A result at the place of each value's bits.
    results: Vec<(u32, f64)>,
}

impl<F: Fn(f32) -> f64> Memo<F> {
    const BITS: u32 = 10;

    fn new(function: F) -> Self {
        // Zero is never looked for anywhere but at its own place.
        let results = vec![(0, function(0.0)); 1 << Self::BITS];
        Self { function, results }
    }

    fn of(&mut self, value: f32) -> f64 {
        let bits = value.to_bits();
        // Fibonacci hashing.
        let place = bits.wrapping_mul(0x9e37_79b1) >> (u32::BITS - Self::BITS);
        let (known, result) = &mut self.results[place as usize];
        if *known != bits {
            (*known, *result) = (bits, (self.function)(value));
        }
        *result
    }
}
