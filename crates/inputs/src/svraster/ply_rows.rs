//! The voxels of svraster-webgl's PLY files.
//!
//! Each vertex is a voxel: its middle, the lower half of its path, its level, harmonics (function
//! by function, each red, green and blue) and the raw densities at its corners. The middle and the
//! level give its place.

use std::sync::Arc;

use super::octree::{Cube, SIDE};
use super::settings::{Settings, check_harmonics};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, Budget};
use crate::tensor::{TensorFile, Value};

/// The remedy for PLY files without separate densities at corners.
pub(super) const DAMAGED: &str =
    "a converter under NumPy 2 loses the densities at corners: bake the .pt file itself";
/// Bytes that are read at once, at most.
const READ_BYTES: usize = 1 << 22;

/// Offsets of the numbers of a voxel.
#[derive(Debug)]
pub(super) struct PlyRows {
    file: Arc<SourceFile>,
    start: u64,
    stride: usize,
    pub(super) count: usize,
    middle: [usize; 3],
    level: usize,
    harmonics: Vec<usize>,
    corners: [usize; 8],
}

/// The places and corners of all voxels.
pub(super) struct PlyVoxels {
    pub(super) cubes: Vec<Cube>,
    pub(super) levels: Vec<u8>,
    pub(super) corners: Vec<[f32; 8]>,
}

fn property(file: &TensorFile, name: &str, kinds: &[&str]) -> Result<usize> {
    let place = Place::Key(format!("properties.{name}"));
    let expected = format!("a property of type {}", kinds.join(" or "));
    let Some(entry) = file.root.at(&["properties", name]) else {
        return Err(Error::malformed(place, "nothing", expected));
    };
    match (entry.get("type"), entry.get("at")) {
        (Some(Value::Text(kind)), Some(at)) if kinds.contains(&kind.as_str()) => {
            Ok(usize::try_from(at.integer(name)?).unwrap_or(usize::MAX))
        }
        (kind, _) => {
            let found = kind.map_or_else(|| "nothing".to_owned(), Value::describe);
            Err(Error::malformed(place, found, expected))
        }
    }
}

impl PlyRows {
    pub(super) fn find(file: &TensorFile) -> Result<Self> {
        let number = |key: &str| -> Result<u64> {
            let value = file.root.get(key).map_or(Ok(0), |value| value.integer(key))?;
            Ok(u64::try_from(value).unwrap_or(0))
        };
        let float = |name: &str| property(file, name, &["float", "float32"]);
        let mut harmonics = Vec::new();
        for name in ["f_dc_0", "f_dc_1", "f_dc_2"] {
            harmonics.push(float(name)?);
        }
        let has = |name: &str| file.root.at(&["properties", name]).is_some();
        let rest = (0..48).map(|at| format!("f_rest_{at}")).take_while(|name| has(name));
        for name in rest {
            harmonics.push(float(&name)?);
        }
        let place = Place::Key("properties.f_rest_0".to_owned());
        check_harmonics(harmonics.len(), &place)?;
        let mut corners = [0; 8];
        for (at, corner) in corners.iter_mut().enumerate() {
            *corner = float(&format!("grid{at}_value"))?;
        }
        let place = Place::File;
        Ok(Self {
            file: Arc::clone(&file.file),
            start: number("start")?,
            stride: limits::product(&[number("stride")?], "bytes of a voxel", &place)?,
            count: limits::product(&[number("count")?], "voxels", &place)?,
            middle: [float("x")?, float("y")?, float("z")?],
            level: property(file, "octlevel", &["uchar", "uint8"])?,
            harmonics,
            corners,
        })
    }

    /// Harmonics of a colour channel.
    pub(super) fn functions(&self) -> usize {
        self.harmonics.len() / 3
    }

    /// Calls `visit` with the bytes of each voxel.
    fn for_each(&self, mut visit: impl FnMut(usize, &[u8]) -> Result<()>) -> Result<()> {
        let at_once = (READ_BYTES / self.stride.max(1)).max(1);
        let (mut first, mut bytes) = (0, Vec::new());
        while first < self.count {
            let count = at_once.min(self.count - first);
            bytes.resize(count * self.stride, 0);
            self.file.read_into(self.start + (first * self.stride) as u64, &mut bytes)?;
            for (number, row) in (first..).zip(bytes.chunks_exact(self.stride)) {
                visit(number, row)?;
            }
            first += count;
        }
        Ok(())
    }

    /// The places and corners of voxels.
    ///
    /// # Errors
    /// `Malformed` for a middle that does not belong to a cube of its level.
    pub(super) fn voxels(&self, settings: &Settings, budget: &mut Budget) -> Result<PlyVoxels> {
        let place = Place::Key("properties.x".to_owned());
        let mut cubes = budget.zeroed(self.count, "bytes of voxels", &place)?;
        let mut levels = budget.zeroed(self.count, "bytes of voxels", &place)?;
        let mut corners = budget.zeroed(self.count, "bytes of corners", &place)?;
        let [mut are_even, mut has_density] = [true, false];
        self.for_each(|number, row| {
            let level = row.get(self.level).copied().unwrap_or(0);
            let edge = f64::from(SIDE >> u32::from(level).min(16));
            let mut cube = Cube { corner: [0; 3], edge: SIDE >> u32::from(level).min(16) };
            let axes = cube.corner.iter_mut().zip(self.middle).zip(settings.center);
            for ((corner, at), center) in axes {
                let middle = (f64::from(float(row, at)) - center) / settings.extent + 0.5;
                let low = middle * f64::from(SIDE) - 0.5 * edge;
                let found = (low / edge).round() * edge;
                // Middles are float32: those of the smallest voxels are off by a share of an edge.
                if !((low - found).abs() < 0.25 * edge && found >= 0.0 && found < f64::from(SIDE)) {
                    let found =
                        format!("voxel {number} of level {level} with its centre at {middle}");
                    let expected =
                        "the centre of a cube of the octree, as a fraction of its extent";
                    return Err(Error::malformed(place.clone(), found, expected));
                }
                #[expect(clippy::cast_possible_truncation, reason = "checked above")]
                let found = found as u32;
                *corner = found;
            }
            let raw = self.corners.map(|at| float(row, at));
            are_even &= raw.iter().all(|value| value.to_bits() == raw[0].to_bits());
            has_density |= raw[0] > -10.0;
            let outs = (cubes.get_mut(number), levels.get_mut(number), corners.get_mut(number));
            if let (Some(out), Some(of_level), Some(of_corners)) = outs {
                (*out, *of_level, *of_corners) = (cube, level, raw);
            }
            Ok(())
        })?;
        if are_even && has_density && self.count > 1 {
            let place = Place::Key("properties.grid0_value".to_owned());
            let found = "the same density in all eight corners of every voxel";
            let error = Error::malformed(place, found, "densities that differ between corners");
            return Err(error.advise(DAMAGED));
        }
        Ok(PlyVoxels { cubes, levels, corners })
    }

    /// The harmonics of all voxels, cut to the rows of `out`.
    pub(super) fn harmonics(&self, width: usize, out: &mut [f32]) -> Result<()> {
        self.for_each(|number, row| {
            let out = out.get_mut(number * width..(number + 1) * width).unwrap_or_default();
            out.iter_mut().zip(&self.harmonics).for_each(|(out, at)| *out = float(row, *at));
            Ok(())
        })
    }

    /// Visits samples of the bytes, for a digest.
    pub(super) fn sample(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        let (size, samples) = (self.stride.min(4096) as u64, 64);
        let all = (self.count * self.stride) as u64;
        let mut piece = vec![0; self.stride.min(4096)];
        for sample in 0..samples {
            let at = (all.saturating_sub(size) / (samples - 1)) * sample;
            self.file.read_into(self.start + at, &mut piece)?;
            hash(&piece);
        }
        Ok(())
    }
}

fn float(row: &[u8], at: usize) -> f32 {
    let bytes = row.get(at..).and_then(|bytes| bytes.first_chunk::<4>());
    bytes.map_or(f32::NAN, |bytes| f32::from_le_bytes(*bytes))
}
