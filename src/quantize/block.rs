//! One block of a slab to codes.

use super::coarsen::{Coarsener, Coarsening};
use super::code::Quantizer;
use super::run::{Frame, FrameShape};
use super::wide::Code;
use crate::baked::{Codes, Encoding, NumberType};
use crate::field::Activation;
use crate::grid::{NodeMask, mask};
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

    /// The codes of a block whose channels start at `first_channel` of the slab, coarser ones where
    /// `coarsening` says so, and the most that the colour or opacity of a needed node was moved for that.
    /// Codes of nodes that the grid does not have are 0.
    pub fn frame(
        &self,
        source: BlockSource,
        first_channel: usize,
        coarsening: Option<Coarsening>,
    ) -> (Frame, f64) {
        let mut needed = vec![false; self.shape.nodes()];
        let mut codes = match self.shape.number {
            NumberType::U8 => Codes::U8(self.codes(source, first_channel, &mut needed)),
            NumberType::U16 | NumberType::F16 => {
                Codes::U16(self.codes(source, first_channel, &mut needed))
            }
            NumberType::F32 => Codes::U32(self.codes(source, first_channel, &mut needed)),
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

    fn codes<T: Code>(
        &self,
        source: BlockSource,
        first_channel: usize,
        needed: &mut [bool],
    ) -> Vec<T> {
        let nodes = self.shape.nodes();
        let mut codes = vec![T::default(); self.shape.channels * nodes];
        for (channel, codes) in codes.chunks_exact_mut(nodes).enumerate() {
            self.gather(source, first_channel + channel, codes, needed);
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
        let BlockSource { slab, needed: mask, place } = source;
        let (edge, encoding) = (self.shape.edge, self.encoding());
        let (mut codes, mut needed) = (vec![0u32; edge.pow(3)], vec![false; edge.pow(3)]);
        self.gather(source, channel, &mut codes, &mut needed);
        let mut decoded = vec![0.0; edge.pow(3)];
        super::code::decode_values(encoding, codes.into_iter(), &mut decoded);
        let [_, _, nz] = mask.nodes().0;
        let activated = |value: f32| encoding.decode.activated(value.into(), activation);
        let mut kept = true;
        for at in (0..needed.len()).filter(|&at| needed[at]) {
            let [x, y, z] = [at / (edge * edge), at / edge % edge, at % edge];
            let plane = slab.plane(place[0] * edge + x - slab.first, channel);
            let value = plane[(place[1] * edge + y) * nz + place[2] * edge + z];
            let error = || (activated(decoded[at]) - activated(value)).abs();
            kept &= decoded[at] == value || error() <= bound.into();
        }
        kept
    }

    /// Quantizes the nodes that the grid has; the others stay unneeded.
    fn gather<T: Code>(
        &self,
        source: BlockSource,
        channel: usize,
        codes: &mut [T],
        needed: &mut [bool],
    ) {
        let BlockSource { slab, needed: mask, place } = source;
        let edge = self.shape.edge;
        let sizes = mask.nodes().0;
        let [start, end] =
            [0, 1].map(|up| [0, 1, 2].map(|axis| ((place[axis] + up) * edge).min(sizes[axis])));
        let count = end[2] - start[2];
        for x in start[0]..end[0] {
            let plane = slab.plane(x - slab.first, channel);
            for y in start[1]..end[1] {
                let at = ((x - start[0]) * edge + y - start[1]) * edge;
                let values = &plane[y * sizes[2] + start[2]..][..count];
                self.quantizer.encode(values, &mut codes[at..at + count]);
                let row = mask.row(x, y);
                for (z, needed) in needed[at..at + count].iter_mut().enumerate() {
                    *needed = mask::get(row, start[2] + z);
                }
            }
        }
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
