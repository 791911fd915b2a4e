//! Colours of inherited blocks, interpolated from the next coarser level.
//!
//! An inherited block has no stored colours. Each of its nodes gets the next coarser level's
//! decoded colours at the same place of the box, interpolated in f64 and then rounded to the
//! nearest code of its own level, so that all codes of a level are of the same kind. Everything is
//! exact or rounded once to f64, in a specified order: `formats/mipvog.md`, section 5.

use crate::base::parallel;
use crate::model::baked::{
    BakedLevel, Codes, Encoding, Group, LevelMetadata, NumberType, Occupancy, Table, with_codes,
};
use crate::model::grid::BlockGrid;

use super::code_word::Code;

/// Marks blocks without a frame.
const NO_FRAME: u32 = u32::MAX;

/// Colours of the inherited blocks of one group of one level.
pub struct InheritedColors<'a> {
    grid: BlockGrid,
    channels: usize,
    number: NumberType,
    /// Midpoints between the values of neighbouring codes of the inheriting level.
    borders: Vec<f64>,
    coarser: BlockGrid,
    /// Of each of the coarser level's blocks.
    frames: Vec<u32>,
    codes: &'a Codes,
    /// Values of the coarser level's codes.
    values: Vec<f64>,
    empty: f64,
}

/// A node of an axis between two of the coarser level's: the lower one, and the share of the upper
/// one.
type Tap = (usize, f64);

impl<'a> InheritedColors<'a> {
    /// For blocks of `level` from `coarser`, whose metadata is `coarser_metadata`; none if a level
    /// does not have the group's `channels` in integer codes.
    pub fn new(
        level: &LevelMetadata,
        (coarser_metadata, coarser): (&LevelMetadata, &'a BakedLevel),
        group: Group,
        channels: usize,
    ) -> Option<Self> {
        let [own, other] =
            [level, coarser_metadata].map(|of| of.encoding(group).filter(is_integer));
        let (own, other) = (own?, other?);
        let values: Vec<f64> = own.values().map(f64::from).collect();
        let mut frames = vec![NO_FRAME; coarser.table.grid().total()];
        let mut next = 0;
        for (frame, occupancy) in frames.iter_mut().zip(coarser.table.occupancy()) {
            if *occupancy != Occupancy::Empty {
                *frame = next;
                next += 1;
            }
        }
        Some(Self {
            grid: level.grid(),
            channels,
            number: own.number,
            borders: values.windows(2).map(|pair| (pair[0] + pair[1]) / 2.0).collect(),
            coarser: coarser_metadata.grid(),
            frames,
            codes: coarser.atlases[group.index()].as_ref()?,
            values: other.values().map(f64::from).collect(),
            empty: other.empty.into(),
        })
    }

    /// The codes of a block, `[channel][node]`; 0 for nodes outside the grid.
    pub fn block(&self, place: [usize; 3]) -> Vec<u32> {
        let edge = self.grid.edge;
        let axes = [0, 1, 2].map(|axis| self.axis(axis, place[axis]));
        let mut codes = vec![0; self.channels * edge.pow(3)];
        let [first, last] = [0, 1].map(|up| {
            [0, 1, 2].map(|axis| {
                let ends = [axes[axis].first(), axes[axis].last()][up];
                ends.map_or(0, |&(low, _)| low + up)
            })
        });
        let sides = [0, 1, 2].map(|axis| last[axis] - first[axis] + 1);
        let mut around = vec![0.0; sides.iter().product()];
        for (channel, codes) in codes.chunks_exact_mut(edge.pow(3)).enumerate() {
            for (i, value) in around.iter_mut().enumerate() {
                let inside = [i / (sides[1] * sides[2]), i / sides[2] % sides[1], i % sides[2]];
                *value = self.value(channel, [0, 1, 2].map(|axis| first[axis] + inside[axis]));
            }
            for (x, &(low_x, share_x)) in axes[0].iter().enumerate() {
                for (y, &(low_y, share_y)) in axes[1].iter().enumerate() {
                    for (z, &(low_z, share_z)) in axes[2].iter().enumerate() {
                        let along_z = |up_x: usize, up_y: usize| {
                            let row =
                                (low_x - first[0] + up_x) * sides[1] + low_y - first[1] + up_y;
                            let at = row * sides[2] + low_z - first[2];
                            interpolate(around[at], around[at + 1], share_z)
                        };
                        let along_y = |up| interpolate(along_z(up, 0), along_z(up, 1), share_y);
                        let value = interpolate(along_y(0), along_y(1), share_x);
                        let code = self.borders.partition_point(|&border| border <= value);
                        codes[(x * edge + y) * edge + z] = code as u32;
                    }
                }
            }
        }
        codes
    }

    /// Positions of the block's nodes of an axis in the coarser level.
    fn axis(&self, axis: usize, block: usize) -> Vec<Tap> {
        let [nodes, coarser] = [self.grid, self.coarser].map(|grid| grid.nodes.0[axis]);
        let start = block * self.grid.edge;
        let tap = |node: usize| {
            let at = node * (coarser - 1);
            let low = (at / (nodes - 1)).min(coarser - 2);
            (low, (at - low * (nodes - 1)) as f64 / (nodes - 1) as f64)
        };
        (start..nodes.min(start + self.grid.edge)).map(tap).collect()
    }

    /// A decoded value of the coarser level.
    fn value(&self, channel: usize, node: [usize; 3]) -> f64 {
        let BlockGrid { edge, .. } = self.coarser;
        let [_, by, bz] = self.coarser.counts();
        let [i, j, k] = node.map(|at| at / edge);
        let frame = self.frames[(i * by + j) * bz + k];
        if frame == NO_FRAME {
            return self.empty;
        }
        let [x, y, z] = node.map(|at| at % edge);
        let inside = (x * edge + y) * edge + z;
        let at = (frame as usize * self.channels + channel) * edge.pow(3) + inside;
        self.values[self.codes.code(at) as usize]
    }

    /// Codes of every block of `table` that has a frame, from the stored blocks' codes.
    pub fn restore(&self, table: &Table, stored: &Codes) -> Codes {
        let count = table.frames() * self.channels * self.grid.block_nodes();
        let mut codes = Codes::zeroed(self.number, count);
        with_codes!(&mut codes, codes => self.restore_codes(table, stored, codes));
        codes
    }

    fn restore_codes<T: Code>(&self, table: &Table, stored: &Codes, codes: &mut [T]) {
        let size = self.channels * self.grid.block_nodes();
        let mut next = T::of(stored).chunks_exact(size);
        let mut inherited = Vec::new();
        for (place, to) in table.stored().zip(codes.chunks_exact_mut(size)) {
            match table.is_inherited(place) {
                true => inherited.push((place, to)),
                false => to.copy_from_slice(next.next().unwrap_or(&[])),
            }
        }
        let done = parallel::map_mut(&mut inherited, |_, (place, to)| {
            for (to, code) in to.iter_mut().zip(self.block(*place)) {
                *to = T::narrow(code);
            }
            Ok(())
        });
        debug_assert!(done.is_ok(), "interpolation cannot fail");
    }
}

fn is_integer(encoding: &&Encoding) -> bool {
    !encoding.number.is_float()
}

/// Between two values, each operation rounded.
fn interpolate(low: f64, high: f64, share: f64) -> f64 {
    low + share * (high - low)
}
