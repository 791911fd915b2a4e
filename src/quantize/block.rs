//! One block of a slab to codes.

use std::ops::Range;
use std::sync::Arc;

use super::coarsen::{Coarsener, Coarsening};
use super::code::Quantizer;
use super::run::{Frame, FrameShape};
use super::wide::Code;
use crate::baked::{Codes, Encoding, NumberType};
use crate::field::Activation;
use crate::grid::{NodeMask, row};
use crate::mips::Slab;

/// Where a block's values are.
#[derive(Debug, Clone, Copy)]
pub struct BlockSource<'a> {
    /// The block's planes are among these.
    pub slab: &'a Slab,
    /// Nodes whose values count.
    pub needed: &'a NodeMask,
    /// The block's place along x, y and z.
    pub place: [usize; 3],
}

impl<'a> BlockSource<'a> {
    /// First and end node of a block of `edge` along each axis, as far as the grid goes.
    fn span(&self, edge: usize) -> [Range<usize>; 3] {
        let sizes = self.needed.nodes().0;
        [0, 1, 2].map(|axis| {
            let start = self.place[axis] * edge;
            start.min(sizes[axis])..(start + edge).min(sizes[axis])
        })
    }

    /// Rows of the block along z that the grid has: x, y, and where in the block they start.
    fn places(&self, edge: usize) -> impl Iterator<Item = (usize, usize, usize)> + Clone {
        let [xs, ys, _] = self.span(edge);
        let first = [xs.start, ys.start];
        let at = move |x, y| ((x - first[0]) * edge + y - first[1]) * edge;
        xs.flat_map(move |x| ys.clone().map(move |y| (x, y, at(x, y))))
    }

    /// The same rows with their values in a channel of the slab.
    fn rows(
        &self,
        edge: usize,
        channel: usize,
    ) -> impl Iterator<Item = (usize, &'a [f32])> + Clone {
        let (slab, nz) = (self.slab, self.needed.nodes().0[2]);
        let [_, _, zs] = self.span(edge);
        self.places(edge).map(move |(x, y, at)| {
            let plane = slab.plane(x - slab.first, channel);
            (at, &plane[y * nz + zs.start..y * nz + zs.end])
        })
    }

    /// Whose values count, of the nodes of a block of `edge`.
    pub fn needed_nodes(&self, edge: usize) -> Arc<[bool]> {
        let mut needed = vec![false; edge.pow(3)];
        let [_, _, zs] = self.span(edge);
        for (x, y, at) in self.places(edge) {
            row::unpack(self.needed.row(x, y), zs.start, &mut needed[at..at + zs.len()]);
        }
        needed.into()
    }
}

/// Encodes blocks of one group of one level.
#[derive(Debug, Clone)]
pub struct BlockEncoder {
    quantizer: Quantizer,
    shape: FrameShape,
    unneeded_limit: u32,
    coarsener: Option<Coarsener>,
}

impl BlockEncoder {
    /// For frames of `channels` and blocks of `edge` nodes. Nodes that nobody needs get values that nobody
    /// sees.
    pub fn new(encoding: Encoding, channels: usize, edge: usize, activation: &Activation) -> Self {
        let shape = FrameShape { number: encoding.number, channels, edge };
        let coarsener = Coarsener::new(&encoding, activation);
        let unneeded = encoding.decode.unseen(activation);
        let quantizer = Quantizer::new(encoding);
        let unneeded_limit = highest_code_up_to(&quantizer, unneeded);
        Self { quantizer, shape, unneeded_limit, coarsener }
    }

    /// The encoding of every block.
    pub fn encoding(&self) -> &Encoding {
        self.quantizer.encoding()
    }

    /// The shape of every frame.
    pub fn shape(&self) -> FrameShape {
        self.shape
    }

    /// The highest code of nodes that nobody needs: they must not become visible.
    pub fn unneeded_limit(&self) -> u32 {
        self.unneeded_limit
    }

    /// The codes of a block, of which the nodes `needed` count, whose channels start at `first_channel` of the slab, coarser ones where
    /// `coarsening` says so, and the most that the colour or opacity of a needed node was moved for that.
    /// Codes of nodes that the grid does not have are 0.
    pub fn frame(
        &self,
        source: BlockSource,
        needed: Arc<[bool]>,
        first_channel: usize,
        coarsening: Option<Coarsening>,
    ) -> (Frame, f64) {
        let mut codes = match self.shape.number {
            NumberType::U8 => Codes::U8(self.codes(source, first_channel)),
            NumberType::U16 | NumberType::F16 => Codes::U16(self.codes(source, first_channel)),
            NumberType::F32 => Codes::U32(self.codes(source, first_channel)),
        };
        let mut moved = 0.0;
        if let (Some(coarsener), Some(coarsening)) = (&self.coarsener, coarsening) {
            let limit = self.unneeded_limit;
            moved = match &mut codes {
                Codes::U8(codes) => {
                    coarsener.coarsen(self.shape, codes, &needed, limit, coarsening)
                }
                Codes::U16(codes) => {
                    coarsener.coarsen(self.shape, codes, &needed, limit, coarsening)
                }
                Codes::U32(codes) => {
                    coarsener.coarsen(self.shape, codes, &needed, limit, coarsening)
                }
            };
        }
        (Frame { codes, needed }, moved)
    }

    /// Codes of all channels, channel by channel.
    fn codes<T: Code>(&self, source: BlockSource, first_channel: usize) -> Vec<T> {
        let nodes = self.shape.nodes();
        let mut codes = vec![T::default(); self.shape.channels * nodes];
        let mut values = vec![0.0; nodes];
        for (channel, codes) in codes.chunks_exact_mut(nodes).enumerate() {
            self.gather(source, first_channel + channel, &mut values, codes);
        }
        codes
    }

    /// Whether what every needed value of one channel of a block comes to is moved by no more than
    /// `bound`.
    pub fn keeps(
        &self,
        bound: f32,
        source: BlockSource,
        channel: usize,
        activation: &Activation,
    ) -> bool {
        let (edge, encoding) = (self.shape.edge, self.encoding());
        let (mut values, mut codes) = (vec![0.0; edge.pow(3)], vec![0u32; edge.pow(3)]);
        self.gather(source, channel, &mut values, &mut codes);
        let mut decoded = values;
        super::code::decode_values(encoding, codes.into_iter(), &mut decoded);
        let needed = source.needed_nodes(edge);
        let activated = |value: f32| encoding.decode.activated(value.into(), activation);
        let mut kept = true;
        for (at, row) in source.rows(edge, channel) {
            for ((&value, &decoded), needed) in row.iter().zip(&decoded[at..]).zip(&needed[at..]) {
                let error = || (activated(decoded) - activated(value)).abs();
                kept &= !needed || decoded == value || error() <= bound.into();
            }
        }
        kept
    }

    /// Quantizes the nodes that the grid has; codes of the others stay. `values` has a block's length.
    fn gather<T: Code>(
        &self,
        source: BlockSource,
        channel: usize,
        values: &mut [f32],
        codes: &mut [T],
    ) {
        let rows = source.rows(self.shape.edge, channel);
        if rows.clone().map(|(_, row)| row.len()).sum::<usize>() == values.len() {
            rows.for_each(|(at, row)| copy_row(row, &mut values[at..]));
            self.quantizer.encode(values, codes);
        } else {
            rows.for_each(|(at, row)| self.quantizer.encode(row, &mut codes[at..at + row.len()]));
        }
    }
}

/// Copies a row; of eight, the usual number, without a call for so few.
#[inline(always)]
fn copy_row(row: &[f32], values: &mut [f32]) {
    match (<&[f32; 8]>::try_from(row), values.first_chunk_mut()) {
        (Ok(row), Some(values)) => *values = *row,
        _ => values[..row.len()].copy_from_slice(row),
    }
}

/// The highest code whose value is at most `limit`; the lowest of all if none is.
fn highest_code_up_to(quantizer: &Quantizer, limit: f32) -> u32 {
    let (mut codes, mut values) = ([0u32], [0.0]);
    quantizer.encode(&[limit], &mut codes);
    // The nearest code may lie above the limit; the one below it cannot.
    super::code::decode_values(quantizer.encoding(), codes.into_iter(), &mut values);
    if values[0] > limit { codes[0].saturating_sub(1) } else { codes[0] }
}
