//! A file of grids.

use sha2::{Digest, Sha256};

use super::metadata::{MetaValue, metadata, text};
use super::tree::{GridContent, Ordered};
use crate::base::bytes::{ByteSink, Output};
use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::format::UpAxis;
use crate::volume::SparseVolume;

/// `" BDV"` as a number of 64 bits.
const MAGIC: u64 = 0x5644_4220;
/// Version of the file, and of the first library version that wrote it.
const VERSIONS: [u32; 3] = [224, 10, 0];
/// Offset of the uuid.
const UUID: u64 = 8 + 12 + 1;
/// zlib streams of active values only.
const COMPRESSION: u32 = 1 | 2;
/// Leaves whose values are computed at once.
const AT_ONCE: usize = 256;

/// A grid to be written.
pub struct GridPlan<'a> {
    /// Its name.
    pub name: String,
    /// `fog volume` or `unknown`.
    pub class: &'static str,
    /// Its values.
    pub content: GridContent<'a>,
    /// More metadata.
    pub metadata: Vec<(&'static str, MetaValue)>,
}

/// Writes a file. The uuid is derived from the bytes.
///
/// # Errors
/// Errors of writing, and a request to stop.
pub fn write_file(
    output: &mut Output,
    volume: &SparseVolume,
    up: UpAxis,
    texts: Vec<(&str, MetaValue)>,
    grids: &[GridPlan],
    progress: &dyn Progress,
) -> Result<Vec<u64>> {
    let mut sum = Sha256::new();
    let mut header = MAGIC.to_le_bytes().to_vec();
    header.extend(VERSIONS.iter().flat_map(|number| number.to_le_bytes()));
    header.push(1);
    header.extend([b'0'; 36]);
    header.extend(metadata(texts));
    header.extend((grids.len() as u32).to_le_bytes());
    sum.update(&header);
    output.append(&header)?;
    let mut counts = Vec::new();
    for grid in grids {
        counts.push(write_grid(output, volume, up, grid, &mut sum, progress)?);
    }
    let digest: [u8; 32] = sum.finalize().into();
    output.patch(UUID, uuid(&digest).as_bytes())?;
    Ok(counts)
}

/// The uuid of content, of version 8, which allows the writer's own rule.
fn uuid(digest: &[u8; 32]) -> String {
    let mut bytes = [0; 16];
    bytes.copy_from_slice(&digest[..16]);
    bytes[6] = bytes[6] & 0x0f | 0x80;
    bytes[8] = bytes[8] & 0x3f | 0x80;
    let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    let parts = [0..8, 8..12, 12..16, 16..20, 20..32].map(|range| &digits[range]);
    parts.join("-")
}

fn write_grid(
    output: &mut Output,
    volume: &SparseVolume,
    up: UpAxis,
    grid: &GridPlan,
    sum: &mut Sha256,
    progress: &dyn Progress,
) -> Result<u64> {
    let content = &grid.content;
    let kind = match (content.width, content.half) {
        (1, false) => "Tree_float_5_4_3",
        (1, true) => "Tree_float_5_4_3_HalfFloat",
        (_, false) => "Tree_vec3s_5_4_3",
        (_, true) => "Tree_vec3s_5_4_3_HalfFloat",
    };
    let descriptor = [text(&grid.name), text(kind), text("")].concat();
    output.append(&descriptor)?;
    let places = output.length();
    output.append(&[0; 24])?;
    let start = output.length();
    let ordered = Ordered::new(&volume.leaves, content);
    let [low, high] = ordered.corners();
    let mut values = vec![
        ("class", MetaValue::Text(grid.class.to_owned())),
        ("file_bbox_max", MetaValue::Voxel(high)),
        ("file_bbox_min", MetaValue::Voxel(low)),
        ("file_compression", MetaValue::Text("zip + active values".to_owned())),
        ("file_voxel_count", MetaValue::Int(ordered.count() as i64)),
        ("is_saved_as_half_float", MetaValue::Bool(content.half)),
        ("name", MetaValue::Text(grid.name.clone())),
    ];
    values.extend(grid.metadata.iter().cloned());
    let mut head = COMPRESSION.to_le_bytes().to_vec();
    head.extend(metadata(values));
    head.extend(text("AffineMap"));
    head.extend(map(volume, up).as_flattened().iter().flat_map(|number| number.to_le_bytes()));
    head.extend(ordered.topology(content));
    sum.update(&descriptor);
    sum.update(&head);
    output.append(&head)?;
    let blocks = output.length();
    for first in (0..ordered.leaves()).step_by(AT_ONCE) {
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
        let bytes = ordered.values(content, first, AT_ONCE)?;
        sum.update(&bytes);
        output.append(&bytes)?;
    }
    let end = output.length();
    output.patch(places, [start, blocks, end].map(u64::to_le_bytes).as_flattened())?;
    Ok(ordered.count())
}

/// The world's steps along the axes of voxels as rows, then the position of voxel 0.
fn map(volume: &SparseVolume, up: UpAxis) -> [[f64; 4]; 4] {
    let [sx, sy, sz] = volume.lattice.spacing;
    let [x, y, z] = volume.lattice.first;
    match up {
        UpAxis::Z => {
            [[sx, 0.0, 0.0, 0.0], [0.0, sy, 0.0, 0.0], [0.0, 0.0, sz, 0.0], [x, y, z, 1.0]]
        }
        UpAxis::Y => {
            [[sx, 0.0, 0.0, 0.0], [0.0, 0.0, -sy, 0.0], [0.0, sz, 0.0, 0.0], [x, z, -y, 1.0]]
        }
    }
}
