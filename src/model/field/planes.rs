//! Values of a trained field as everything downstream sees them: read by position where somebody
//! needs them, emptied outside the free-space mask, counted where they are not finite.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::model::field::{RadianceField, Volume};
use crate::model::grid::{NodeMask, row};

/// Raw density of a node that is not there. Far below any threshold, and what unseen nodes of
/// trained scenes hold.
pub const EMPTY_DENSITY: f32 = -100.0;

/// Runs of values closer than this many bytes are read as one: a gap costs less than a call.
const BRIDGED_BYTES: usize = 1024;

/// What happens to values that are not finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Nonfinite {
    /// The bake is refused, with their count and the first one's place.
    #[default]
    Refuse,
    /// The node is empty: density as outside the scene, colour as never trained.
    Empty,
}

/// Reads a field's planes from any thread.
#[derive(Debug)]
pub struct Planes<'a> {
    field: &'a RadianceField,
    /// Nodes that are no corner of any cell which the free-space mask touches.
    outside: Option<NodeMask>,
    nonfinite: Nonfinite,
    found: Mutex<Found>,
    /// Density was read once; what is not finite in it is known.
    density_is_known: AtomicBool,
}

/// What one call read.
#[derive(Debug, Clone)]
pub struct PlaneRead {
    /// Bytes.
    pub bytes: u64,
    /// CRC-32 of them, in order.
    pub checksum: crc32fast::Hasher,
}

/// Values that are not finite, among those read.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Found {
    /// How many.
    pub count: u64,
    /// The first one's channel, x, y and z; density is channel 0.
    pub first: Option<[usize; 4]>,
}

impl<'a> Planes<'a> {
    /// Planes of `field`; `inside` are the nodes that keep their density.
    pub fn new(field: &'a RadianceField, outside: Option<NodeMask>, nonfinite: Nonfinite) -> Self {
        Self {
            field,
            outside,
            nonfinite,
            found: Mutex::default(),
            density_is_known: AtomicBool::new(false),
        }
    }

    /// The field that is read.
    pub fn field(&self) -> &'a RadianceField {
        self.field
    }

    /// Density and colour channels.
    pub fn channels(&self) -> usize {
        1 + self.field.color_channels()
    }

    /// Fills the nodes in `region` (rows of bits along z) of plane `x`. Channel 0 is density, the
    /// others are colour. Nodes around the region may be filled too.
    pub fn read(
        &self,
        channel: usize,
        x: usize,
        region: &[u64],
        out: &mut [f32],
    ) -> Result<PlaneRead> {
        let Some((volume, volume_channel)) = self.field.volume_of(channel) else {
            return Err(Error::new(ErrorKind::Overflow { what: "channel" }, Place::File));
        };
        let mut scratch = Vec::new();
        let mut read = PlaneRead { bytes: 0, checksum: crc32fast::Hasher::new() };
        let nz = volume.nodes.0[2];
        for run in runs(volume, region) {
            let at = [x, run.start / nz, run.start % nz];
            let values = &mut out[run.clone()];
            volume.read_run(volume_channel, at, values, &mut scratch, |stored| {
                read.checksum.update(stored);
                read.bytes += stored.len() as u64;
            })?;
            if !all_finite(values) {
                self.mend(channel, x, run.start, nz, values);
            }
        }
        if let Some(outside) = self.outside.as_ref().filter(|_| channel == 0) {
            empty(outside, x, out);
        }
        Ok(read)
    }

    /// What was found since the last call, or the error that it is. All of density must have been
    /// read before the first call; from then on it is not counted again.
    pub fn take_nonfinite(&self) -> Result<Found> {
        self.density_is_known.store(true, Ordering::Relaxed);
        let mut found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        let found = std::mem::take(&mut *found);
        match (self.nonfinite, found.first) {
            (Nonfinite::Refuse, Some(first)) => {
                let tensor = if first[0] == 0 { "density" } else { "k0" };
                // Colour counts its own channels.
                let first = [first[0].saturating_sub(1), first[1], first[2], first[3]];
                let kind = ErrorKind::NonFinite { count: found.count, first };
                Err(Error::new(kind, Place::Tensor(tensor.to_owned())))
            }
            _ => Ok(found),
        }
    }

    /// Replaces and counts values that are not finite.
    fn mend(&self, channel: usize, x: usize, start: usize, nz: usize, values: &mut [f32]) {
        let empty = if channel == 0 { EMPTY_DENSITY } else { 0.0 };
        let mut here = Found::default();
        for (i, value) in values.iter_mut().enumerate().filter(|(_, value)| !value.is_finite()) {
            *value = empty;
            here.count += 1;
            here.first.get_or_insert([channel, x, (start + i) / nz, (start + i) % nz]);
        }
        if channel == 0 && self.density_is_known.load(Ordering::Relaxed) {
            return;
        }
        let mut found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        found.count += here.count;
        found.first = match (found.first, here.first) {
            (Some(old), Some(new)) => Some(old.min(new)),
            (old, new) => old.or(new),
        };
    }

    /// The checksum that the file states of all of density.
    pub fn density_crc32(&self) -> Option<u32> {
        stated_crc32(&self.field.density)
    }

    /// The checksum that the file states of all of colour, where it is one tensor.
    pub fn color_crc32(&self) -> Option<u32> {
        match self.field.color.as_slice() {
            [color] => stated_crc32(color),
            _ => None,
        }
    }
}

/// Whether no value is infinite or NaN: no exponent is all ones. Without branches, so that vectors do it.
fn all_finite(values: &[f32]) -> bool {
    const EXPONENT: u32 = 0xff << 23;
    let found = |found, value: &f32| found | u32::from(value.to_bits() & EXPONENT == EXPONENT);
    values.iter().fold(0, found) == 0
}

fn stated_crc32(volume: &Volume) -> Option<u32> {
    volume.storage.crc32().filter(|_| volume.fills_storage())
}

/// Holds the checksums of a tensor's planes, in the order of the file, against the one that the
/// file states for all of it.
pub fn verify_crc32<'h>(
    tensor: &str,
    planes: impl IntoIterator<Item = &'h crc32fast::Hasher>,
    expected: u32,
) -> Result<()> {
    let mut whole = crc32fast::Hasher::new();
    planes.into_iter().for_each(|plane| whole.combine(plane));
    let found = whole.finalize();
    if found == expected {
        return Ok(());
    }
    let kind = ErrorKind::Checksum { what: "its values".to_owned(), found, expected };
    Err(Error::new(kind, Place::Tensor(tensor.to_owned())))
}

/// Runs of consecutive values of a plane that cover the region, short gaps bridged.
fn runs(volume: &Volume, region: &[u64]) -> Vec<std::ops::Range<usize>> {
    let [_, ny, nz] = volume.nodes.0;
    let words = region.len() / ny;
    let gap = BRIDGED_BYTES / volume.element.size();
    let across_rows = volume.rows_are_contiguous();
    let mut runs: Vec<std::ops::Range<usize>> = Vec::new();
    for (y, row) in region.chunks_exact(words).enumerate() {
        for (start, end) in row::runs(row) {
            let run = y * nz + start..y * nz + end;
            match runs.last_mut() {
                Some(last)
                    if run.start - last.end <= gap && (across_rows || last.start >= y * nz) =>
                {
                    last.end = run.end;
                }
                _ => runs.push(run),
            }
        }
    }
    runs
}

/// Lowers what lies outside the mask to emptiness. Lower values stay: levels as trained average
/// them as they are.
fn empty(outside: &NodeMask, x: usize, plane: &mut [f32]) {
    let nz = outside.nodes().0[2];
    for (y, values) in plane.chunks_exact_mut(nz).enumerate() {
        for (start, end) in row::runs(outside.row(x, y)) {
            for value in &mut values[start..end] {
                *value = value.min(EMPTY_DENSITY);
            }
        }
    }
}
