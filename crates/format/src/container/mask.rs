//! The `MASK` chunk: the free-space mask, compressed as one zstd frame.
//!
//! ```text
//! u32 lookup (0 nearest, 1 trilinear), u32 nodes[3], f64 scale[3], f64 shift[3],
//! f32 threshold (0 for nearest), u32 zero, then the zstd frame of one byte (0 or 1) a node for
//! nearest, one f32 a node for trilinear, z fastest
//! ```

use super::runs::{compress, decompress};
use crate::base::bytes::ByteReader;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::model::grid::Nodes;
use crate::model::scene::{FreeSpace, Lookup};

/// Writes the chunk.
pub fn to_bytes(mask: &FreeSpace, level: i32) -> Result<Vec<u8>> {
    let (id, threshold, values): (u32, f32, Vec<u8>) = match &mask.lookup {
        Lookup::Nearest(inside) => {
            (0, 0.0, inside.iter().map(|&inside| u8::from(inside)).collect())
        }
        Lookup::Trilinear { values, threshold } => {
            (1, *threshold, values.iter().flat_map(|value| value.to_le_bytes()).collect())
        }
    };
    let mut bytes = id.to_le_bytes().to_vec();
    for size in mask.nodes.0 {
        bytes.extend(super::runs::fits_u32(size)?.to_le_bytes());
    }
    for value in mask.scale.iter().chain(&mask.shift) {
        bytes.extend(value.to_le_bytes());
    }
    bytes.extend(threshold.to_le_bytes());
    bytes.extend([0; 4]);
    bytes.extend(compress(&values, level)?);
    Ok(bytes)
}

/// Reads the chunk.
pub fn read(
    reader: &mut ByteReader,
    place: &Place,
    limits: &Limits,
    budget: &mut Budget,
) -> Result<FreeSpace> {
    let bad = |found: &str, expected: &str| Error::malformed(place.clone(), found, expected);
    let id = reader.u32()?;
    let sizes = [reader.u32()?, reader.u32()?, reader.u32()?].map(u64::from);
    let nodes = Nodes::checked(sizes, limits, place)?;
    let mut map = [0.0; 6];
    for value in &mut map {
        *value = f64::from_bits(reader.u64()?);
    }
    let [a, b, c, d, e, f] = map;
    let threshold = f32::from_bits(reader.u32()?);
    if map.iter().any(|value| !value.is_finite()) || !threshold.is_finite() {
        return Err(bad("a number that is not finite", "finite numbers"));
    }
    if id == 0 && threshold.to_bits() != 0 {
        return Err(bad("a threshold for a nearest lookup", "0"));
    }
    if reader.u32()? != 0 {
        return Err(bad("a reserved byte that is set", "zeros"));
    }
    let packed = reader.take(reader.left())?;
    let width = if id == 0 { 1 } else { 4 };
    budget.spend(2 * width * nodes.count() as u64, "bytes of free space", place)?;
    let values = decompress(packed, nodes.count() * if id == 0 { 1 } else { 4 }, place)?;
    let lookup = match id {
        0 if values.iter().all(|&byte| byte <= 1) => {
            Lookup::Nearest(values.iter().map(|&byte| byte == 1).collect())
        }
        0 => return Err(bad("a byte other than 0 or 1", "one of them for each node")),
        1 => {
            let floats: Vec<f32> =
                values.as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect();
            if floats.iter().any(|value| !value.is_finite()) {
                return Err(bad("a value that is not finite", "finite values"));
            }
            Lookup::Trilinear { values: floats, threshold }
        }
        _ => {
            let found = format!("lookup {id}");
            return Err(Error::unsupported(place.clone(), found, "0 (nearest) or 1 (trilinear)"));
        }
    };
    Ok(FreeSpace { nodes, scale: [a, b, c], shift: [d, e, f], lookup })
}
