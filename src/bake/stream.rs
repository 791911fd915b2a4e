//! A field through all its levels, plane by plane, as they are to be stored.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use super::BakeOptions;
use crate::bake::fit::Fitted;
use crate::base::error::{Error, Result};
use crate::base::progress::{Progress, Step};
use crate::levels::mips::{Cascade, Lift, Regions, Settlers};
use crate::levels::prune::Pruned;
use crate::model::field::{Planes, verify_crc32};
use crate::model::grid::NodeMask;

/// What the levels of a bake are made of.
#[derive(Debug, Clone, Copy)]
pub struct Stream<'a> {
    /// The field.
    pub planes: &'a Planes<'a>,
    /// How levels are made, and how thick slabs are.
    pub options: &'a BakeOptions,
    /// The nodes that must come out right.
    pub pruned: &'a Pruned,
    /// Levels that were fitted.
    pub fitted: Option<&'a Fitted>,
    /// Whether slabs are taken before the next ones are made.
    pub in_turn: bool,
    /// Whether only some of the planes are needed, for a forecast: others are left out, and checksums of all are not held
    /// to what the file states.
    pub is_part: bool,
}

/// What a pass read.
#[derive(Debug)]
pub struct Streamed {
    /// Bytes of density and colour.
    pub bytes_read: u64,
    /// CRC-32 of what was read of each colour channel of each plane.
    pub checksums: Vec<u32>,
}

impl Stream<'_> {
    /// Streams the field through all levels. `put(level, x, channel, plane)` gets every plane, from any thread, and
    /// `take(level, planes)` is told which have come, a slab at a time, each
    /// level's in order; `step` is what its progress is told as.
    pub fn run(
        &self,
        step: Step,
        progress: &dyn Progress,
        put: impl Fn(usize, usize, usize, &[f32]) -> Result<()> + Sync + Send,
        mut take: impl FnMut(usize, Range<usize>) -> Result<()> + Send,
    ) -> Result<Streamed> {
        let Self { planes, options, pruned, fitted, in_turn, is_part } = *self;
        let scene = &planes.field().scene;
        let matter = options.filter.matter(&scene.activation);
        let mut needed = Vec::with_capacity(pruned.levels.len());
        for (level, pruned) in pruned.levels.iter().enumerate() {
            // Matter settles with the colour of the nodes around it.
            needed.push(match matter.is_some() && level > 0 {
                true => pruned.needed.cells_with_a_corner()?.corners()?,
                false => pruned.needed.clone(),
            });
        }
        let regions = Regions::new(needed, pruned.matter.as_ref(), options.filter.kernel())?;
        let channels = planes.channels();
        let seen = matter.zip(pruned.visibility.as_ref());
        let lift = Lift::of_levels(seen, options.filter.filters_density(), channels);
        let of_levels = pruned.levels.iter().map(|level| &level.needed);
        let settlers = Settlers::new(matter, channels, of_levels);
        // Of a coarser level as it is to be stored.
        let settled = |level, x, channel, plane: &mut [f32]| {
            if let Some(fitted) = fitted {
                fitted.replace(level, x, channel, plane);
            }
            put(level, x, channel, plane)
        };
        let nx = scene.nodes.0[0];
        progress.begin(step, nx as u64);
        let bytes_read = AtomicU64::new(0);
        let hashers = Mutex::new(vec![crc32fast::Hasher::new(); nx * (channels - 1)]);
        // A file that states a checksum of all of colour is held to it: a wrong byte costs more than reading what
        // nobody needs.
        let whole = planes.color_crc32().map(|expected| (expected, NodeMask::full(scene.nodes)));
        let cascade = Cascade::new(&regions, channels, lift, options.block_size).in_turn(in_turn);
        cascade.run(
            |x, channel, region, plane| {
                let color = channel.checked_sub(1);
                let is_left_out = is_part && region.iter().all(|&row| row == 0);
                let whole = whole.as_ref().filter(|_| color.is_some() && !is_left_out);
                let region = whole.map_or(region, |(_, whole)| whole.plane(x));
                let read = planes.read(channel, x, region, plane)?;
                bytes_read.fetch_add(read.bytes, Ordering::Relaxed);
                if let Some(color) = color {
                    let mut hashers = hashers.lock().unwrap_or_else(PoisonError::into_inner);
                    hashers[color * nx + x] = read.checksum;
                }
                put(0, x, channel, plane)
            },
            |level, x, channel, plane| settlers.pass([level, x, channel], plane, settled),
            |level, planes| {
                if level == 0 {
                    progress.advance(step, planes.len() as u64);
                }
                if progress.cancelled() {
                    return Err(Error::cancelled());
                }
                settlers.settle(level, planes, settled, |planes| take(level, planes))
            },
        )?;
        let hashers = hashers.into_inner().unwrap_or_else(PoisonError::into_inner);
        if let Some((expected, _)) = whole.filter(|_| !is_part) {
            verify_crc32("k0", &hashers, expected)?;
        }
        Ok(Streamed {
            bytes_read: bytes_read.into_inner(),
            checksums: hashers.into_iter().map(crc32fast::Hasher::finalize).collect(),
        })
    }
}
