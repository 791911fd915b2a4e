//! A field through all its levels, slab by slab, as they are to be stored.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use super::BakeOptions;
use crate::error::{Error, Result};
use crate::field::{Planes, verify_crc32};
use crate::fit::Fitted;
use crate::grid::NodeMask;
use crate::mips::{Cascade, Lift, Regions, Settler, Slab};
use crate::progress::{Progress, Step};
use crate::prune::Pruned;

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
    /// Streams the field through all levels. `take(level, slab)` gets every slab of every level, each
    /// level's in order; `step` is what its progress is told as.
    pub fn run(
        &self,
        step: Step,
        progress: &dyn Progress,
        mut take: impl FnMut(usize, &Slab) -> Result<()> + Send,
    ) -> Result<Streamed> {
        let Self { planes, options, pruned, fitted, in_turn } = *self;
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
        let mut settlers =
            Settler::of_levels(matter, pruned.levels.iter().map(|level| &level.needed));
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
                let Some(color) = channel.checked_sub(1) else {
                    let read = planes.read(channel, x, region, plane)?;
                    bytes_read.fetch_add(read.bytes, Ordering::Relaxed);
                    return Ok(());
                };
                let region = whole.as_ref().map_or(region, |(_, whole)| whole.plane(x));
                let read = planes.read(channel, x, region, plane)?;
                bytes_read.fetch_add(read.bytes, Ordering::Relaxed);
                let mut hashers = hashers.lock().unwrap_or_else(PoisonError::into_inner);
                hashers[color * nx + x] = read.checksum;
                Ok(())
            },
            |level, slab| {
                if level == 0 {
                    progress.advance(step, slab.count() as u64);
                }
                if progress.cancelled() {
                    return Err(Error::cancelled());
                }
                match &mut settlers[level] {
                    Some(settler) => settler.take(slab, |slab| {
                        if let Some(fitted) = fitted {
                            fitted.replace(level, slab);
                        }
                        take(level, slab)
                    }),
                    None => take(level, slab),
                }
            },
        )?;
        let hashers = hashers.into_inner().unwrap_or_else(PoisonError::into_inner);
        if let Some((expected, _)) = whole {
            verify_crc32("k0", &hashers, expected)?;
        }
        Ok(Streamed {
            bytes_read: bytes_read.into_inner(),
            checksums: hashers.into_iter().map(crc32fast::Hasher::finalize).collect(),
        })
    }
}
