//! Larger scenes of the same kind: a trained scene upsampled, with noise at opaque nodes.
//!
//! Trilinear upsampling alone would compress and filter better than anything trained, so values of
//! opaque nodes are moved by noise of a tenth of the scene's own spread. The same scene, size
//! and type give the same bytes.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use half::f16;
use mipvog::base::parallel;
use mipvog::model::field::{EMPTY_LOGIT, Grid, RadianceField};
use serde_json::json;

/// Raw density above which a node is opaque.
const OPAQUE: f32 = 0.0;
/// Half the spread of the noise in raw values.
const NOISE: f32 = 0.5;

/// Stored number types.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Element {
    F32,
    F16,
}

impl Element {
    fn bytes(self) -> usize {
        if self == Self::F32 { 4 } else { 2 }
    }

    fn name(self) -> &'static str {
        if self == Self::F32 { "F32" } else { "F16" }
    }
}

/// Writes `field` with `side` nodes along each axis as a safetensors file.
pub fn write(field: &RadianceField, side: usize, element: Element, path: &Path) {
    let channels = field.color_channels();
    let plane = side * side * side * element.bytes();
    let tensor = |channels: usize, start: usize| {
        json!({
            "dtype": element.name(),
            "shape": [1, channels, side, side, side],
            "data_offsets": [start, start + channels * plane],
        })
    };
    let bounds = &field.scene.bounds;
    let ends = (1 + channels) * plane;
    let vector = |start: usize| json!({ "dtype": "F32", "shape": [3], "data_offsets": [ends + start, ends + start + 12] });
    let header = json!({
        "density": tensor(1, 0),
        "k0": tensor(channels, plane),
        "xyz_max": vector(12),
        "xyz_min": vector(0),
    });
    let mut header = header.to_string();
    header.extend(std::iter::repeat_n(' ', header.len().next_multiple_of(8) - header.len()));
    let partial = path.with_extension("partial");
    let mut file = BufWriter::new(File::create(&partial).expect("a folder that can be written"));
    let mut put = |bytes: &[u8]| file.write_all(bytes).expect("room on the disk");
    put(&(header.len() as u64).to_le_bytes());
    put(header.as_bytes());
    let density = values(&field.density, 0);
    let nodes = field.density.nodes().0;
    let mut upsampled = |of: &[f32], channel: u64, is_density: bool| {
        for x in 0..side {
            let rows = parallel::map(side, |y| {
                let mut bytes = Vec::with_capacity(side * element.bytes());
                for z in 0..side {
                    let at = [x, y, z];
                    let raw = trilinear(nodes, &density, at, side);
                    let mut value = if is_density { raw } else { trilinear(nodes, of, at, side) };
                    if raw > OPAQUE {
                        value += NOISE * noise(channel, at);
                    }
                    match element {
                        Element::F32 => bytes.extend(value.to_le_bytes()),
                        Element::F16 => bytes.extend(f16::from_f32(value).to_le_bytes()),
                    }
                }
                Ok(bytes)
            });
            rows.expect("no errors").iter().for_each(|row| put(row));
        }
    };
    upsampled(&density, 0, true);
    let mut channel = 0;
    for volume in &field.color {
        for number in 0..volume.channels() {
            channel += 1;
            upsampled(&values(volume, number), channel, false);
        }
    }
    for corner in [bounds.min, bounds.max] {
        corner.iter().for_each(|value| put(&value.to_le_bytes()));
    }
    file.flush().expect("room on the disk");
    drop(file);
    std::fs::rename(partial, path).expect("a folder that can be written");
}

/// All values of one channel.
fn values(volume: &Grid, channel: usize) -> Vec<f32> {
    let [_, ny, nz] = volume.nodes().0;
    let mut values = vec![EMPTY_LOGIT; volume.nodes().count()];
    for (x, plane) in values.chunks_exact_mut(ny * nz).enumerate() {
        volume.read_plane(channel, x, plane, |_| {}).expect("readable");
    }
    values
}

fn trilinear(nodes: [usize; 3], values: &[f32], at: [usize; 3], side: usize) -> f32 {
    let [(x, fx), (y, fy), (z, fz)] = [0, 1, 2].map(|axis| {
        let u = at[axis] as f64 * (nodes[axis] - 1) as f64 / (side - 1) as f64;
        let low = (u as usize).min(nodes[axis] - 2);
        (low, (u - low as f64) as f32)
    });
    let row = |x: usize, y: usize| {
        let at = (x * nodes[1] + y) * nodes[2] + z;
        values[at] + (values[at + 1] - values[at]) * fz
    };
    let plane = |x: usize| row(x, y) + (row(x, y + 1) - row(x, y)) * fy;
    plane(x) + (plane(x + 1) - plane(x)) * fx
}

/// From -1 to 1, by the finalizer of SplitMix64.
fn noise(channel: u64, [x, y, z]: [usize; 3]) -> f32 {
    let mut hash = (channel << 60) ^ ((x as u64) << 40) ^ ((y as u64) << 20) ^ z as u64;
    hash = (hash ^ hash >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    hash = (hash ^ hash >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    (hash ^ hash >> 31) as u32 as f32 / 2_147_483_648.0 - 1.0
}
