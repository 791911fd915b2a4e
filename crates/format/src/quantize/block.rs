//! Cuts one block of a slab of codes to a frame.

use std::ops::Range;
use std::sync::Arc;

use super::coarsen::{Coarsener, Coarsening};
use super::code::{Quantizer, decode_values};
use super::code_word::Code;
use super::frame::{Frame, FrameShape};
use super::planes::CodeSlab;
use crate::model::baked::{Codes, DensityDomain, Encoding, with_codes};
use crate::model::grid::{NodeMask, row};
use crate::model::scene::Activation;

/// A block of a slab of codes.
#[derive(Debug, Clone, Copy)]
pub struct BlockSource<'a> {
    /// The block's planes are among these.
    pub slab: &'a CodeSlab,
    /// Nodes whose values count.
    pub retained: &'a NodeMask,
    /// The block's place along x, y and z.
    pub place: [usize; 3],
}

impl<'a> BlockSource<'a> {
    /// First and end node of a block of `edge` along each axis, clamped to the grid.
    fn span(&self, edge: usize) -> [Range<usize>; 3] {
        let sizes = self.retained.nodes().0;
        [0, 1, 2].map(|axis| {
            let start = self.place[axis] * edge;
            start.min(sizes[axis])..(start + edge).min(sizes[axis])
        })
    }

    /// Rows of the block along z within the grid: x, y, and their offset in the block.
    fn places(&self, edge: usize) -> impl Iterator<Item = (usize, usize, usize)> + Clone {
        let [xs, ys, _] = self.span(edge);
        let first = [xs.start, ys.start];
        let at = move |x, y| ((x - first[0]) * edge + y - first[1]) * edge;
        xs.flat_map(move |x| ys.clone().map(move |y| (x, y, at(x, y))))
    }

    /// Copies the codes of a channel of the slab. Codes of nodes outside the grid stay.
    fn copy<T: Code>(&self, edge: usize, channel: usize, codes: &mut [T]) {
        let [xs, ys, zs] = self.span(edge);
        let nz = self.retained.nodes().0[2];
        for (x, codes) in xs.zip(codes.chunks_exact_mut(edge * edge)) {
            let rows = &T::of(self.slab.plane(x, channel))[ys.start * nz..ys.end * nz];
            for (row, codes) in rows.chunks_exact(nz).zip(codes.chunks_exact_mut(edge)) {
                copy_row(&row[zs.clone()], codes);
            }
        }
    }

    /// True for each retained node of a block of `edge`.
    pub fn retained_nodes(&self, edge: usize) -> Arc<[bool]> {
        let mut retained = vec![false; edge.pow(3)];
        let [_, _, zs] = self.span(edge);
        for (x, y, at) in self.places(edge) {
            row::unpack(self.retained.row(x, y), zs.start, &mut retained[at..at + zs.len()]);
        }
        retained.into()
    }

    /// True for each node of a block of `edge` within the grid.
    pub fn own_nodes(&self, edge: usize) -> Arc<[bool]> {
        let mut own = vec![false; edge.pow(3)];
        let [_, _, zs] = self.span(edge);
        for (_, _, at) in self.places(edge) {
            own[at..at + zs.len()].fill(true);
        }
        own.into()
    }
}

/// Encodes blocks of one group of one level.
#[derive(Debug, Clone)]
pub struct BlockEncoder {
    encoding: Encoding,
    shape: FrameShape,
    dont_care_max: u32,
    coarsener: Option<Coarsener>,
}

impl BlockEncoder {
    /// For frames of `channels` and blocks of `edge` nodes. Don't-care nodes get values that stay
    /// invisible.
    pub fn new(encoding: Encoding, channels: usize, edge: usize, activation: &Activation) -> Self {
        let shape = FrameShape { number: encoding.number, channels, edge };
        let coarsener = Coarsener::new(&encoding, activation);
        let invisible = |domain: DensityDomain| domain.invisible(activation);
        let limit = encoding.decode.density().map_or(f32::MAX, invisible);
        let dont_care_max = highest_code_up_to(&encoding, limit);
        Self { encoding, shape, dont_care_max, coarsener }
    }

    /// The encoding of every block.
    pub fn encoding(&self) -> &Encoding {
        &self.encoding
    }

    /// The shape of every frame.
    pub fn shape(&self) -> FrameShape {
        self.shape
    }

    /// The highest code of don't-care nodes, which must stay invisible.
    pub fn dont_care_max(&self) -> u32 {
        self.dont_care_max
    }

    /// The codes of a block, whose channels start at `first_channel` of the slab, and the largest
    /// move of a retained node's colour or opacity by `coarsening`. Only nodes in `retained` count;
    /// the others hold the cheapest codes.
    pub fn frame(
        &self,
        source: BlockSource,
        retained: Arc<[bool]>,
        first_channel: usize,
        coarsening: Option<Coarsening>,
    ) -> (Frame, f64) {
        let FrameShape { number, channels, edge } = self.shape;
        let nodes = self.shape.nodes();
        let mut codes = Codes::zeroed(number, channels * nodes);
        with_codes!(&mut codes, codes => {
            for (channel, codes) in (first_channel..).zip(codes.chunks_exact_mut(nodes)) {
                source.copy(edge, channel, codes);
            }
        });
        let mut moved = 0.0;
        if let (Some(coarsener), Some(coarsening)) = (&self.coarsener, coarsening) {
            let limit = self.dont_care_max;
            moved = with_codes!(&mut codes, codes => {
                coarsener.coarsen(self.shape, codes, &retained, limit, coarsening)
            });
        }
        (Frame { codes, retained }, moved)
    }
}

/// Copies a row; inlined for eight, the usual number.
#[inline(always)]
fn copy_row<T: Copy>(row: &[T], to: &mut [T]) {
    match (<&[T; 8]>::try_from(row), to.first_chunk_mut()) {
        (Ok(row), Some(to)) => *to = *row,
        _ => to[..row.len()].copy_from_slice(row),
    }
}

/// The highest code with a value of at most `limit`; the lowest code if there is none.
fn highest_code_up_to(encoding: &Encoding, limit: f32) -> u32 {
    let (mut codes, mut values) = ([0u32], [0.0]);
    Quantizer::new(encoding.clone()).encode(&[limit], &mut codes);
    // The nearest code may lie above the limit; the one below it cannot.
    decode_values(encoding, codes.into_iter(), &mut values);
    if values[0] > limit { codes[0].saturating_sub(1) } else { codes[0] }
}
