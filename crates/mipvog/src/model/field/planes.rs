//! Values of a trained field as all later stages read them: only required nodes, emptied outside
//! the free-space mask, and with values that are not finite replaced.

use multiversion::multiversion;
use serde::{Deserialize, Serialize};

use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::model::field::{Grid, RadianceField, Volume};
use crate::model::grid::{NodeMask, Nodes, row};

/// Runs of values closer than this many bytes are read as one, because a gap costs less than a
/// call.
const BRIDGED_BYTES: usize = 4096;

/// Treatment of values that are not finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Nonfinite {
    /// The bake fails, and states their count and the place of the first one.
    #[default]
    Refuse,
    /// The node becomes empty: density as outside the scene, colour as if never trained.
    Empty,
}

/// Reads a field's planes from any thread. It keeps no record: each call reports its reads.
#[derive(Debug)]
pub struct Planes<'a> {
    field: &'a RadianceField,
    /// Nodes that are not a corner of any cell that the free-space mask touches.
    outside: Option<NodeMask>,
    nonfinite: Nonfinite,
}

/// The record of one call.
#[derive(Debug, Clone)]
pub struct PlaneRead {
    /// Bytes that were read.
    pub bytes: u64,
    /// CRC-32 of the bytes in order; of no bytes if no checksum was requested.
    pub checksum: crc32fast::Hasher,
    /// Values that were replaced.
    pub nonfinite: NonfiniteCount,
}

/// Values that are not finite, among those that were read.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct NonfiniteCount {
    /// Their number.
    pub count: u64,
    /// The first one's channel, x, y and z; density is channel 0.
    pub first: Option<[usize; 4]>,
}

impl NonfiniteCount {
    /// Adds the counts of another read.
    pub fn join(&mut self, other: Self) {
        self.count += other.count;
        self.first = match (self.first, other.first) {
            (Some(own), Some(other)) => Some(own.min(other)),
            (own, other) => own.or(other),
        };
    }
}

impl<'a> Planes<'a> {
    /// Planes of `field`. Nodes in `outside` lose their density. `nonfinite` says whether values
    /// that are not finite are an error.
    pub fn new(field: &'a RadianceField, outside: Option<NodeMask>, nonfinite: Nonfinite) -> Self {
        Self { field, outside, nonfinite }
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
    /// others are colour. Nodes around the region may be filled too. With `checksummed`, the record
    /// has a checksum.
    pub fn read(
        &self,
        channel: usize,
        x: usize,
        region: &[u64],
        out: &mut [f32],
        checksummed: bool,
    ) -> Result<PlaneRead> {
        let Some((grid, grid_channel)) = self.field.grid_of(channel) else {
            return Err(Error::new(ErrorKind::Overflow { what: "channel" }, Place::File));
        };
        let mut scratch = Vec::new();
        let mut read = PlaneRead {
            bytes: 0,
            checksum: crc32fast::Hasher::new(),
            nonfinite: NonfiniteCount::default(),
        };
        let Nodes([_, ny, nz]) = grid.nodes();
        let empty_raw = self.field.scene.activation.empty_raw();
        let empty = if channel == 0 { empty_raw } else { 0.0 };
        let mut replace = |start: usize, values: &mut [f32]| {
            if !all_finite(values) {
                let found = replace_nonfinite([channel, x], start, nz, values, empty);
                read.nonfinite.join(found);
            }
        };
        match grid {
            Grid::Array(volume) => {
                for run in runs(volume, region) {
                    let at = [x, run.start / nz, run.start % nz];
                    let values = &mut out[run.clone()];
                    volume.read_run(grid_channel, at, values, &mut scratch, |stored| {
                        if checksummed {
                            read.checksum.update(stored);
                        }
                        read.bytes += stored.len() as u64;
                    })?;
                    replace(run.start, values);
                }
            }
            Grid::Values(values) => {
                read.bytes = values.read(grid_channel, x, region, out)?;
                for (y, row) in region.chunks_exact(region.len() / ny).enumerate() {
                    for (start, end) in row::runs(row) {
                        replace(y * nz + start, &mut out[y * nz + start..y * nz + end]);
                    }
                }
            }
        }
        if let Some(outside) = self.outside.as_ref().filter(|_| channel == 0) {
            lower(outside, x, out, empty_raw);
        }
        Ok(read)
    }

    /// The count of values that were replaced, unless such values are refused.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::NonFinite`] with the first value's place.
    pub fn accepted(&self, found: NonfiniteCount) -> Result<u64> {
        let Some([channel, x, y, z]) = found.first.filter(|_| self.nonfinite == Nonfinite::Refuse)
        else {
            return Ok(found.count);
        };
        // Colour in one array comes from checkpoints; other arrays have the names of sampled
        // arrays.
        let tensor = match (channel, self.field.color.first()) {
            (0, _) => "density",
            (_, Some(Grid::Array(_))) => "k0",
            _ if self.field.harmonics().is_some() => "sh",
            _ => "color",
        };
        // Colour counts its own channels.
        let first = [channel.saturating_sub(1), x, y, z];
        let kind = ErrorKind::NonFinite { count: found.count, first };
        Err(Error::new(kind, Place::Tensor(tensor.to_owned())))
    }

    /// The file's checksum of all density.
    pub fn density_crc32(&self) -> Option<u32> {
        stated_crc32(&self.field.density)
    }

    /// The file's checksum of all colour, if colour is one tensor.
    pub fn color_crc32(&self) -> Option<u32> {
        match self.field.color.as_slice() {
            [color] => stated_crc32(color),
            _ => None,
        }
    }
}

/// Replaces values that are not finite, and counts them. The first value belongs to node `start` of
/// the plane.
fn replace_nonfinite(
    [channel, x]: [usize; 2],
    start: usize,
    nz: usize,
    values: &mut [f32],
    empty: f32,
) -> NonfiniteCount {
    let mut found = NonfiniteCount::default();
    for (i, value) in values.iter_mut().enumerate().filter(|(_, value)| !value.is_finite()) {
        *value = empty;
        found.count += 1;
        found.first.get_or_insert([channel, x, (start + i) / nz, (start + i) % nz]);
    }
    found
}

/// True if no value is infinite or NaN: no exponent is all ones. Without branches, so that it is
/// vectorized.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn all_finite(values: &[f32]) -> bool {
    const EXPONENT: u32 = 0xff << 23;
    let found = |found, value: &f32| found | u32::from(value.to_bits() & EXPONENT == EXPONENT);
    values.iter().fold(0, found) == 0
}

fn stated_crc32(grid: &Grid) -> Option<u32> {
    let volume = grid.array()?;
    volume.storage.crc32().filter(|_| volume.fills_storage())
}

/// Compares the checksums of a tensor's planes, in file order, with the file's checksum of the
/// whole tensor.
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

impl Grid {
    /// Fills the nodes of `region` (rows of bits along z) of plane `x` of a channel. Others may be
    /// filled or left unchanged. Returns the number of bytes read.
    ///
    /// # Errors
    /// Errors of reading.
    pub fn read_region(
        &self,
        channel: usize,
        x: usize,
        region: &[u64],
        out: &mut [f32],
    ) -> Result<u64> {
        let volume = match self {
            Self::Array(volume) => volume,
            Self::Values(values) => return values.read(channel, x, region, out),
        };
        let (nz, mut bytes, mut scratch) = (volume.nodes.0[2], 0, Vec::new());
        for run in runs(volume, region) {
            let at = [x, run.start / nz, run.start % nz];
            let count = |stored: &[u8]| bytes += stored.len() as u64;
            volume.read_run(channel, at, &mut out[run], &mut scratch, count)?;
        }
        Ok(bytes)
    }
}

/// Runs of consecutive values of a plane that cover the region; short gaps are bridged.
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

/// Lowers nodes outside the mask to the empty value. Lower values stay, because levels as trained
/// average them unchanged.
fn lower(outside: &NodeMask, x: usize, plane: &mut [f32], empty: f32) {
    let nz = outside.nodes().0[2];
    for (y, values) in plane.chunks_exact_mut(nz).enumerate() {
        for (start, end) in row::runs(outside.row(x, y)) {
            for value in &mut values[start..end] {
                *value = value.min(empty);
            }
        }
    }
}
