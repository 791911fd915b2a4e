//! The memory of bakes, within a bound or without one.
//!
//! Everything that a bake holds at once, except compressed runs, depends on sizes and the number of
//! threads alone. So it is computed beforehand, as if no plane were empty: planes on their way
//! through the levels, bits of nodes, visibility. The rest of the bound is for compressed runs
//! ([`super::run_store`]); runs beyond it wait in a nameless file on the output's disk. If the
//! bound is still too small, slabs are encoded before the next ones are made, which halves the
//! planes. The output does not depend on either. A bake without a bound keeps a fixed amount of
//! runs in memory.
//!
//! Memory is that of the process as the operating system counts it, with the program itself.

use super::encode::PENDING_BYTES;
use super::{BakeOptions, plan};
use crate::base::bytes::Storage;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::parallel;
use crate::container::{RUN_BYTES, frames_per_run};
use crate::levels::brightness::MOMENTS;
use crate::levels::pyramid::SLAB;
use crate::levels::{Direction, OpticalDepthGrid};
use crate::model::baked::{Group, NumberType};
use crate::model::field::{Grid, RadianceField};
use crate::model::grid::{BlockGrid, NodeMask, Nodes};
use crate::quantize::{Bits, FrameShape, encoder_bytes};

/// The program, its libraries, and the allocator's own memory; measured.
const PROGRAM_BYTES: u64 = 15_872 << 10;
/// Memory of a thread that compresses runs, beside the frames that it keeps; measured.
const THREAD_BYTES: u64 = 400 << 10;
/// Allocators keep freed memory for the thread that freed it. So each thread accumulates the frames
/// that it made, up to this share of the most that wait at once; measured.
const KEPT_SHARE: (u64, u64) = (1, 2);
/// Upper limit of the frames of which a thread keeps a share.
const KEPT_BYTES: u64 = 8 << 20;

/// Errors from here on fit integers of 16 bits or fewer; smaller ones may need float32.
const FEW_BITS_ERROR: f32 = 1.0 / 16_384.0;

/// Compressed runs that stay in memory if there is no bound. Writing the rest and reading it again
/// costs a fiftieth of a bake; memory for it would be a third of a large scene's.
const UNBOUNDED_RUN_BYTES: u64 = 64 << 20;

/// The way in which a bake keeps to its bound.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryPlan {
    /// True if slabs are encoded while the next ones are made.
    pub pipelined: bool,
    /// Bytes of compressed runs that may stay in memory.
    pub run_bytes: u64,
}

impl MemoryPlan {
    /// For a bake within its bound, or for the fastest bake if there is none.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::TooLittleMemory`] with the least bound that would do.
    pub fn of_bake(field: &RadianceField, options: &BakeOptions) -> Result<Self> {
        let sizes = options.filter.level_sizes(field.scene.nodes, options.levels);
        match options.memory {
            Some(bound) => Self::new(field, options, &sizes, bound),
            None => Ok(Self { pipelined: true, run_bytes: UNBOUNDED_RUN_BYTES }),
        }
    }

    /// The smallest bound that works for a bake; none if its options allow no bound.
    pub fn least(field: &RadianceField, options: &BakeOptions) -> Option<u64> {
        let sizes = options.filter.level_sizes(field.scene.nodes, options.levels);
        let needs = Needs { field, options, sizes: &sizes, threads: parallel::threads() as u64 };
        (!options.holds_level()).then(|| needs.bytes(false))
    }

    /// Peak memory of a bake without a bound, for a container of this many bytes; none if its
    /// options allow no bound.
    pub fn most(field: &RadianceField, options: &BakeOptions, output_bytes: u64) -> Option<u64> {
        let sizes = options.filter.level_sizes(field.scene.nodes, options.levels);
        let needs = Needs { field, options, sizes: &sizes, threads: parallel::threads() as u64 };
        let runs = output_bytes.min(UNBOUNDED_RUN_BYTES);
        (!options.holds_level()).then(|| needs.bytes(true) + runs)
    }

    /// For a bake with options whose bound is `bound`.
    fn new(
        field: &RadianceField,
        options: &BakeOptions,
        sizes: &[Nodes],
        bound: u64,
    ) -> Result<Self> {
        let needs = Needs { field, options, sizes, threads: parallel::threads() as u64 };
        let plan = |pipelined| {
            let run_bytes = bound.checked_sub(needs.bytes(pipelined))?;
            Some(Self { pipelined, run_bytes })
        };
        plan(true).or_else(|| plan(false)).ok_or_else(|| {
            let kind = ErrorKind::TooLittleMemory { least: needs.bytes(false), allowed: bound };
            Error::new(kind, Place::File)
        })
    }
}

/// The memory of a bake beside compressed runs.
struct Needs<'a> {
    field: &'a RadianceField,
    options: &'a BakeOptions,
    sizes: &'a [Nodes],
    threads: u64,
}

impl Needs<'_> {
    fn bytes(&self, pipelined: bool) -> u64 {
        let common = PROGRAM_BYTES + self.compressing() + self.inputs() + self.masks();
        common + self.pruning().max(self.encoding(pipelined))
    }

    /// Memory of the input: entries that had to be inflated, the free-space mask.
    fn inputs(&self) -> u64 {
        let inflated = self.field.grids().map(|grid| match grid {
            Grid::Array(volume) => match &volume.storage {
                Storage::Memory(bytes) => bytes.len() as u64,
                Storage::File { .. } => 0,
            },
            Grid::Values(values) => values.memory_bytes(),
        });
        let free_space = self.field.free_space.as_ref();
        let free_space = free_space
            .map_or(0, |mask| 4 * mask.nodes.count() as u64 + 3 * NodeMask::bytes(self.sizes[0]));
        inflated.sum::<u64>() + free_space
    }

    /// Memory of node masks, the larger of two stages. While retained nodes are found: opaque and
    /// retained nodes of all levels, and nodes with alpha, cells and corners of level 0. Then:
    /// retained and required nodes of all levels, nodes with alpha, and all of level 0.
    fn masks(&self) -> u64 {
        let all: u64 = self.sizes.iter().map(|&nodes| NodeMask::bytes(nodes)).sum();
        2 * all + 4 * NodeMask::bytes(self.sizes[0])
    }

    /// Input planes of a plane of the next level.
    fn window(&self) -> u64 {
        self.options.filter.weights().len() as u64 + 1
    }

    /// One channel of a plane.
    fn plane(nodes: Nodes) -> u64 {
        4 * (nodes.0[1] * nodes.0[2]) as u64
    }

    /// Planes of density on their way through the levels, and traced light.
    fn pruning(&self) -> u64 {
        // A slab's amounts, the planes at work in each thread, and the planes that wait for the
        // next level; each level a fourth of the last.
        let planes = SLAB as u64 + 2 * self.threads + (SLAB as u64 + self.window()).div_ceil(2);
        // Depths and visibility, and bent normals.
        let light = 2 * self.visibility() + self.bent_normals() + self.importance();
        planes * Self::plane(self.sizes[0]) * 4 / 3 + light
    }

    /// Directional terms of coarser levels, unless a fit makes them.
    fn direction(&self) -> Option<Direction> {
        Direction::of(&*self.options.filter, self.field)
    }

    /// Parts of bent normals along three axes.
    fn bent_normals(&self) -> u64 {
        if self.moments_level().is_some() { self.visibility() * 3 / 2 } else { 0 }
    }

    /// Importance to viewers nearby, of the level on which light is traced and of coarser ones.
    fn importance(&self) -> u64 {
        if self.options.is_seen_nearby() { self.visibility() * 8 / 7 } else { 0 }
    }

    fn visibility(&self) -> u64 {
        let domain = self.options.filter.alpha(&self.field.scene.activation);
        let bytes = |_| 4 * self.sizes[OpticalDepthGrid::level(self.sizes)].count() as u64;
        domain.map_or(0, bytes)
    }

    /// Planes of all channels on their way through the levels, and codes that are not compressed
    /// yet.
    fn encoding(&self, pipelined: bool) -> u64 {
        let slabs = if pipelined { 2 } else { 1 };
        let level_bytes = |level| {
            let planes = self.at_work(level) + self.ring(level) + self.waiting(level, slabs);
            let codes = self.planes(level, slabs * self.thickness()) * self.stored(level);
            let codes = codes * Self::plane(self.sizes[level]) / 4 * self.bytes_per_code(level);
            codes + planes * Self::plane(self.sizes[level]) + self.frames(level)
        };
        (0..self.sizes.len()).map(level_bytes).sum::<u64>()
            + self.visibility()
            + self.bent_normals()
            + self.importance()
    }

    /// Planes at work in each thread; with alpha, also the weights of a slab's colours, and its
    /// alpha and diffuse colours for moments of brightness.
    fn at_work(&self, level: usize) -> u64 {
        match (self.premultiplies(), level) {
            (false, _) => self.threads,
            (true, 0) if self.moments_level() == Some(0) => 5 * self.thickness() + 3 * self.threads,
            (true, 0) => self.thickness() + 2 * self.threads,
            (true, _) => (1 + self.stored(level)) * self.threads,
        }
    }

    /// Planes on their way from a level to the next: half as long along y.
    fn ring(&self, level: usize) -> u64 {
        let moments = self.moments_level().is_some_and(|first| level >= first);
        self.sums(moments) * self.planes(level, self.thickness() + self.window()).div_ceil(2)
    }

    /// Planes from the level before: a slab that waits for the plane after it, and the plane before
    /// it.
    fn waiting(&self, level: usize, slabs: u64) -> u64 {
        if !self.premultiplies() || level == 0 {
            return 0;
        }
        let moments = self.moments_level().is_some_and(|first| level > first);
        self.sums(moments) * self.planes(level, (1 + slabs) * self.thickness() + 1)
    }

    /// This many planes, or all planes of the level if it has fewer.
    fn planes(&self, level: usize, count: u64) -> u64 {
        count.min(self.sizes[level].0[0] as u64)
    }

    /// Planes of a slab.
    fn thickness(&self) -> u64 {
        self.options.block_size as u64
    }

    fn channels(&self) -> u64 {
        1 + self.field.color_channels() as u64
    }

    /// Channels whose codes are stored.
    fn stored(&self, level: usize) -> u64 {
        let direction = self.direction().filter(|_| level > 0);
        self.channels() + direction.map_or(0, |direction| direction.channels(level) as u64)
    }

    /// Sums from which a level is made.
    fn sums(&self, moments: bool) -> u64 {
        let moments = if moments { MOMENTS as u64 } else { 0 };
        self.channels() + u64::from(self.premultiplies()) + moments
    }

    fn premultiplies(&self) -> bool {
        self.options.filter.alpha(&self.field.scene.activation).is_some()
    }

    /// The level from which on moments of brightness go up.
    fn moments_level(&self) -> Option<usize> {
        self.direction().and_then(|direction| direction.moments)
    }

    /// Memory of the threads that compress runs at once; at most one thread per run.
    fn compressing(&self) -> u64 {
        let levels = 0..self.sizes.len();
        let waiting: u64 = levels.map(|level| self.frames(level)).sum();
        // A run that is not full, for each of the groups but one.
        let runs = waiting / RUN_BYTES as u64 + 2;
        let kept = waiting.min(KEPT_BYTES) * KEPT_SHARE.0 / KEPT_SHARE.1;
        self.threads.min(runs) * (THREAD_BYTES + kept.max(self.encoder()))
    }

    /// Memory of the largest encoder of a run: it grows with the block's edge cubed.
    fn encoder(&self) -> u64 {
        let layout = plan::layout(self.field, self.direction().is_some());
        let edge = self.options.block_size;
        let of_level = |level: usize| {
            let number = self.number_type(level);
            let blocks = BlockGrid { nodes: self.sizes[level], edge }.counts().iter().product();
            let of_group = move |group: Group| {
                let shape = FrameShape { number, channels: group.channels(layout), edge };
                encoder_bytes(shape, frames_per_run(shape).min(blocks)) as u64
            };
            Group::ALL.into_iter().filter(move |group| group.channels(layout) > 0).map(of_group)
        };
        (0..self.sizes.len()).flat_map(of_level).max().unwrap_or(0)
    }

    /// The widest type of a level's codes. A search for a number of bytes also tries the smallest
    /// errors.
    fn number_type(&self, level: usize) -> NumberType {
        let options = self.options;
        match (options.max_bytes, options.max_error, options.bits) {
            (Some(_), ..) | (None, None, Bits::F32) => NumberType::F32,
            (None, None, Bits::Integer(..=8)) => NumberType::U8,
            (None, None, _) => NumberType::U16,
            (None, Some(errors), _) => {
                let errors = errors.of_level(level);
                let keep = Group::ALL.into_iter().all(|group| errors.of(group) >= FEW_BITS_ERROR);
                if keep { NumberType::U16 } else { NumberType::F32 }
            }
        }
    }

    fn bytes_per_code(&self, level: usize) -> u64 {
        self.number_type(level).bytes() as u64
    }

    /// Codes of a level that wait until there are enough to compress.
    fn frames(&self, level: usize) -> u64 {
        let grid = BlockGrid { nodes: self.sizes[level], edge: self.options.block_size };
        // And a flag of each node, whether it counts.
        let frame = (grid.edge as u64).pow(3) * (self.channels() * self.bytes_per_code(level) + 1);
        let [rows, by, bz] = grid.counts().map(|count| count as u64);
        let slab = by * bz * frame;
        (PENDING_BYTES as u64 + slab).min(rows * slab)
    }
}
