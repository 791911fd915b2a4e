//! Compresses planes of a level to runs, as they arrive.
//!
//! Each plane is quantized on its own, on the thread that made it. Blocks are cut from slabs of
//! codes, and wait as frames until there are enough runs for all threads to compress.

use std::ops::Range;
use std::sync::{Arc, Mutex};

use super::MaxErrors;
use super::importance::LevelImportance;
use super::run_store::RunStore;
use crate::base::error::{Error, Place, Result};
use crate::base::lock::lock;
use crate::base::parallel;
use crate::container::{CompressedRun, EncodedAtlas, EncodedLevel, frames_per_run};
use crate::model::baked::{ColorLayout, Encoding, GROUPS, Group, Table};
use crate::model::field::Activation;
use crate::model::grid::NodeMask;
use crate::quantize::{
    BlockEncoder, BlockSource, Coarsening, CodePlanes, Frame, GroupCodes, Moved,
};

/// Frames wait until they have this many bytes, so that all threads compress at once.
pub(super) const PENDING_BYTES: usize = 4 << 20;

/// Options that all groups of a level share.
#[derive(Debug, Clone)]
pub struct EncodeOptions<'a> {
    /// The level's name, for errors.
    pub name: String,
    /// The parts of a node's values beside density.
    pub layout: ColorLayout,
    /// Raw density to opacity: don't-care nodes stay below the threshold of visibility.
    pub activation: Activation,
    /// Compression level of zstd.
    pub zstd_level: i32,
    /// The bound that values are held to as they are encoded.
    pub bound: ErrorBound,
    /// The place for compressed runs, if not just memory.
    pub store: Option<&'a RunStore>,
    /// The importance of the nodes, if colour errors may depend on it.
    pub importance: Option<Importance<'a>>,
}

/// How far colours may move by the importance of their nodes.
#[derive(Debug, Clone, Copy)]
pub struct Importance<'a> {
    /// Of the level's nodes.
    pub level: &'a LevelImportance,
    /// Codes by which colours may move at a node of importance 1.
    pub coarseness: f32,
}

/// The bound that values are held to as they are encoded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ErrorBound {
    /// No check: the encodings were made for these very values, and their bound is proved.
    Proved,
    /// The bound of each encoding. Values may differ from those that the encoding was made for.
    Encoding,
    /// These bounds, unless an encoding's bound is smaller.
    Asked(MaxErrors),
}

impl ErrorBound {
    /// The bound of a group whose encoding has the bound `encoding`.
    fn of(self, group: Group, encoding: f32) -> Option<f32> {
        match self {
            Self::Proved => None,
            Self::Encoding => Some(encoding),
            Self::Asked(errors) => Some(errors.of(group).min(encoding)),
        }
    }
}

/// Encodes one level: planes come from any thread, slabs in order.
#[derive(Debug)]
pub struct LevelEncoder<'a> {
    table: Table,
    retained: &'a NodeMask,
    codes: CodePlanes<'a>,
    /// The group of each channel.
    channel_groups: Vec<Group>,
    options: EncodeOptions<'a>,
    groups: Vec<GroupEncoder>,
    /// The frames of each group. Locked only briefly, because blocks are made in parallel.
    frames: Mutex<Vec<GroupFrames>>,
}

#[derive(Debug)]
struct GroupEncoder {
    group: Group,
    /// The group's first channel in a slab.
    first_channel: usize,
    encoder: BlockEncoder,
}

/// The blocks of a group that were made so far.
#[derive(Debug, Default)]
struct GroupFrames {
    /// The largest change of a colour or opacity by coarsening.
    moved: f64,
    /// Frames that are not compressed yet.
    pending: Vec<Frame>,
    runs: Vec<CompressedRun>,
}

impl<'a> LevelEncoder<'a> {
    /// For the stored blocks of `table`; `encodings` by [`Group`], and planes whose channels are
    /// those of the present groups in that order.
    pub fn new(
        table: Table,
        retained: &'a NodeMask,
        encodings: [Option<&Encoding>; GROUPS],
        options: EncodeOptions<'a>,
    ) -> Self {
        let edge = table.grid().edge;
        let (mut groups, mut channel_groups, mut bounds) = (Vec::new(), Vec::new(), Vec::new());
        for (group, encoding) in Group::ALL.into_iter().zip(encodings) {
            let Some(encoding) = encoding else { continue };
            let channels = group.channels(options.layout);
            let bound = options.bound.of(group, encoding.max_error);
            groups.push(GroupEncoder {
                group,
                first_channel: channel_groups.len(),
                encoder: BlockEncoder::new(encoding.clone(), channels, edge, &options.activation),
            });
            channel_groups.extend(std::iter::repeat_n(group, channels));
            bounds.push(GroupCodes {
                encoding,
                channels,
                bound,
                everywhere: is_quantized_outside_mask(group),
            });
        }
        let codes = CodePlanes::new(retained, options.activation, bounds);
        let frames = groups.iter().map(|_| GroupFrames::default()).collect();
        let frames = Mutex::new(frames);
        Self { table, retained, codes, channel_groups, options, groups, frames }
    }

    /// Takes plane `x` of a channel; channels are counted across the groups in order. Can be called
    /// from any thread.
    ///
    /// # Errors
    ///
    /// A retained value that moves by more than the bound, if there is one.
    pub fn put(&self, x: usize, channel: usize, values: &[f32]) -> Result<()> {
        let Some(moved) = self.codes.put(x, channel, values) else { return Ok(()) };
        let Moved { at: [y, z], bound } = moved;
        let group = self.channel_groups[channel].name();
        let place = format!("{}.{group}", self.options.name);
        let found = format!("a value at node {:?} that moves by more than {bound}", [x, y, z]);
        let expected = "values as they were unpacked, or other bits";
        Err(Error::malformed(Place::Tensor(place), found, expected))
    }

    /// Encodes the stored blocks of the planes that have arrived. Calls are in order, one block's
    /// thickness of planes each.
    pub fn take(&self, planes: Range<usize>) -> Result<()> {
        let grid = self.table.grid();
        let row = planes.start / grid.edge;
        let slab = self.codes.take(planes);
        let [_, by, bz] = grid.counts();
        let places: Vec<[usize; 3]> = (0..by * bz)
            .map(|block| [row, block / bz, block % bz])
            .filter(|&place| self.table.frame(place).is_some())
            .collect();
        let (groups, retained) = (&self.groups, self.retained);
        let importance = self.options.importance;
        let frames = parallel::map(places.len(), |i| {
            let source = BlockSource { slab: &slab, retained, place: places[i] };
            let counted = source.retained_nodes(grid.edge);
            let inherits = self.table.is_inherited(places[i]);
            // Colours of inherited blocks are interpolated from the next coarser level.
            let stored = |group: &&GroupEncoder| !inherits || !group.group.is_color();
            let frame = |group: &GroupEncoder| {
                let group = Some(group).filter(stored);
                group.map(|group| group.frame(source, counted.clone(), importance))
            };
            Ok(groups.iter().map(frame).collect::<Vec<_>>())
        })?;
        self.codes.reuse(slab);
        if self.add(frames) >= PENDING_BYTES {
            self.compress(false)?;
        }
        Ok(())
    }

    /// Adds blocks, each with a frame or none for every group. Returns the bytes that now wait.
    fn add(&self, blocks: Vec<Vec<Option<(Frame, f64)>>>) -> usize {
        let mut all = lock(&self.frames);
        for block in blocks {
            for (group, frame) in all.iter_mut().zip(block) {
                let Some((frame, moved)) = frame else { continue };
                group.moved = group.moved.max(moved);
                group.pending.push(frame);
            }
        }
        let bytes = |(group, frames): (&GroupEncoder, &GroupFrames)| {
            frames.pending.len() * group.encoder.shape().bytes()
        };
        self.groups.iter().zip(&*all).map(bytes).sum()
    }

    /// The largest error of a group's decoded values, by [`Group`]: the error of its encoding plus
    /// the error of coarsening.
    pub fn max_errors(&self) -> [Option<f32>; GROUPS] {
        let mut errors = [None; GROUPS];
        for (group, frames) in self.groups.iter().zip(&*lock(&self.frames)) {
            errors[group.group.index()] = Some(group.encoder.encoding().error_after(frames.moved));
        }
        errors
    }

    /// Compresses the remaining frames.
    pub fn finish(self) -> Result<EncodedLevel> {
        self.compress(true)?;
        let mut atlases = [const { None }; GROUPS];
        let frames = std::mem::take(&mut *lock(&self.frames));
        for (group, frames) in self.groups.iter().zip(frames) {
            let atlas = EncodedAtlas::new(frames_per_run(group.encoder.shape()), frames.runs)?;
            atlases[group.group.index()] = Some(atlas);
        }
        Ok(EncodedLevel { table: self.table, atlases })
    }

    /// Compresses all full runs, and with `rest` the last ones too.
    fn compress(&self, rest: bool) -> Result<()> {
        let mut runs = Vec::new();
        for (number, waiting) in lock(&self.frames).iter_mut().enumerate() {
            let length = frames_per_run(self.groups[number].encoder.shape());
            let mut frames = std::mem::take(&mut waiting.pending).into_iter();
            while frames.len() >= length || (rest && frames.len() > 0) {
                runs.push((number, frames.by_ref().take(length).collect::<Vec<_>>()));
            }
            waiting.pending = frames.collect();
        }
        let (groups, level) = (&self.groups, self.options.zstd_level);
        let compressed = parallel::map(runs.len(), |i| {
            let (number, frames) = &runs[i];
            let encoder = &groups[*number].encoder;
            let dont_care_max = encoder.dont_care_max();
            let mut run = CompressedRun::new(encoder.shape(), frames, dont_care_max, level)?;
            self.options.store.map_or(Ok(()), |store| store.keep(&mut run))?;
            Ok(run)
        })?;
        let mut all = lock(&self.frames);
        for ((number, _), run) in runs.into_iter().zip(compressed) {
            all[number].runs.push(run);
        }
        Ok(())
    }
}

impl Importance<'_> {
    /// Importance of a block's nodes; 0 beyond the grid.
    fn block(&self, source: BlockSource, edge: usize) -> Vec<f32> {
        let sizes = source.retained.nodes().0;
        let node_importance = |node: usize| {
            let inside = [node / (edge * edge), node / edge % edge, node % edge];
            let [x, y, z] = [0, 1, 2].map(|axis| source.place[axis] * edge + inside[axis]);
            let has = x < sizes[0] && y < sizes[1] && z < sizes[2];
            if has { self.level.node(sizes, [x, y, z]) } else { 0.0 }
        };
        (0..edge.pow(3)).map(node_importance).collect()
    }
}

/// True for a group whose values count at all nodes: anisotropy could make a node visible that is
/// not retained.
fn is_quantized_outside_mask(group: Group) -> bool {
    group == Group::Anisotropy
}

impl GroupEncoder {
    /// A block's codes, all channels; the nodes `retained` count.
    fn frame(
        &self,
        source: BlockSource,
        retained: Arc<[bool]>,
        importance: Option<Importance>,
    ) -> (Frame, f64) {
        let retained = match is_quantized_outside_mask(self.group) {
            true => source.own_nodes(self.encoder.shape().edge),
            false => retained,
        };
        let coarser = importance.filter(|_| self.group.is_color());
        let block = coarser.map(|all| all.block(source, self.encoder.shape().edge));
        let coarsening = coarser
            .zip(block.as_deref())
            .map(|(all, importance)| Coarsening { importance, coarseness: all.coarseness });
        self.encoder.frame(source, retained, self.first_channel, coarsening)
    }
}
