//! Passes over a trained field, and the record of their reads.

use std::sync::{Mutex, PoisonError};

use super::PlaneSource;
use crate::base::error::Result;
use crate::base::lock::lock;
use crate::model::field::{NonfiniteCount, PlaneRead, Planes, verify_crc32};
use crate::model::grid::NodeMask;

/// The checksums that a pass compares with those in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verify {
    /// None.
    Nothing,
    /// Density's checksum. The pass must require all of density.
    Density,
    /// Colour's checksum. All of colour is read, not only required nodes, because an undetected
    /// error costs more than the reading.
    Colors,
    /// None, but colours are read as for [`Verify::Colors`] in planes with a required node. A
    /// forecast then measures the same work as a bake.
    ColorsOfWindow,
}

/// One pass over a trained field.
#[derive(Debug)]
pub struct FieldPass<'a> {
    planes: &'a Planes<'a>,
    verify: Verify,
    /// Every node and the file's checksum, if all of colour is read.
    all_colors: Option<(u32, NodeMask)>,
    /// The record of each plane, `[channel][x]`.
    reads: Mutex<Vec<Option<PlaneRead>>>,
}

/// The record of a pass.
#[derive(Debug, Default)]
pub struct ReadSummary {
    /// Bytes that were read.
    pub bytes: u64,
    /// Values of density that were replaced.
    pub nonfinite_density: NonfiniteCount,
    /// Values of colour that were replaced.
    pub nonfinite_color: NonfiniteCount,
    /// CRC-32 of each plane of density, where the pass verifies density.
    pub density_checksums: Vec<u32>,
}

impl ReadSummary {
    /// Values of density and colour that were replaced.
    pub fn nonfinite(&self) -> NonfiniteCount {
        let mut all = self.nonfinite_density;
        all.join(self.nonfinite_color);
        all
    }
}

impl<'a> FieldPass<'a> {
    /// A pass over `planes` that verifies the checksums in `verify`.
    pub fn new(planes: &'a Planes<'a>, verify: Verify) -> Self {
        let nodes = planes.field().scene.nodes;
        let reads_all = matches!(verify, Verify::Colors | Verify::ColorsOfWindow);
        let stated = planes.color_crc32().filter(|_| reads_all);
        let all_colors = stated.map(|expected| (expected, NodeMask::full(nodes)));
        let reads = Mutex::new(vec![None; planes.channels() * nodes.0[0]]);
        Self { planes, verify, all_colors, reads }
    }

    /// The record, after all planes were read.
    ///
    /// # Errors
    ///
    /// A checksum that differs from the one in the file.
    pub fn finish(self) -> Result<ReadSummary> {
        let nx = self.planes.field().scene.nodes.0[0];
        let reads = self.reads.into_inner().unwrap_or_else(PoisonError::into_inner);
        let (density, color) = reads.split_at(nx);
        let hashers = |reads: &'_ [Option<PlaneRead>]| -> Vec<crc32fast::Hasher> {
            reads.iter().flatten().map(|read| read.checksum.clone()).collect()
        };
        let density_hashers = hashers(density);
        match (self.verify, &self.all_colors) {
            (Verify::Density, _) => {
                if let Some(expected) = self.planes.density_crc32() {
                    verify_crc32("density", &density_hashers, expected)?;
                }
            }
            (Verify::Colors, Some((expected, _))) => {
                verify_crc32("k0", &hashers(color), *expected)?;
            }
            _ => {}
        }
        let mut summary = ReadSummary::default();
        density.iter().flatten().for_each(|read| summary.nonfinite_density.join(read.nonfinite));
        color.iter().flatten().for_each(|read| summary.nonfinite_color.join(read.nonfinite));
        summary.bytes = reads.iter().flatten().map(|read| read.bytes).sum();
        summary.density_checksums =
            density_hashers.into_iter().map(crc32fast::Hasher::finalize).collect();
        Ok(summary)
    }
}

impl PlaneSource for FieldPass<'_> {
    fn channels(&self) -> usize {
        self.planes.channels()
    }

    fn read(&self, channel: usize, x: usize, required: &[u64], values: &mut [f32]) -> Result<()> {
        let in_window = self.verify == Verify::Colors || required.iter().any(|&row| row != 0);
        let all = self.all_colors.as_ref().filter(|_| channel > 0 && in_window);
        let required = all.map_or(required, |(_, all)| all.plane(x));
        let checksummed = all.is_some() || (channel == 0 && self.verify == Verify::Density);
        let read = self.planes.read(channel, x, required, values, checksummed)?;
        let nx = self.planes.field().scene.nodes.0[0];
        let mut reads = lock(&self.reads);
        reads[channel * nx + x] = Some(read);
        Ok(())
    }
}
