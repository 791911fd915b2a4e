//! One grid of a file.

use super::codec::Codec;
use super::placed::{Placed, read_map};
use super::tree::Tree;
use crate::base::bytes::ByteReader;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::input::tensor::{GRIDS, TensorFile, Value, VdbValue, read_metadata, read_text};

/// Types that are read, the numbers of a value, and true for half floats.
const TYPES: [(&str, usize, bool); 4] = [
    ("Tree_float_5_4_3", 1, false),
    ("Tree_float_5_4_3_HalfFloat", 1, true),
    ("Tree_vec3s_5_4_3", 3, false),
    ("Tree_vec3s_5_4_3_HalfFloat", 3, true),
];

/// A grid.
#[derive(Debug, Clone)]
pub struct VdbGrid {
    /// Its metadata.
    pub metadata: Vec<(String, VdbValue)>,
    /// Numbers of a value: 1 or 3.
    pub width: usize,
    /// The value of voxels that are not stored.
    pub background: [f32; 3],
    /// The place of its voxels in the world.
    pub placed: Placed,
    /// Its voxels.
    pub tree: Tree,
}

impl VdbGrid {
    /// A text of the metadata.
    pub fn text(&self, name: &str) -> Option<&str> {
        match self.metadata.iter().find(|(own, _)| own == name) {
            Some((_, VdbValue::Text(text))) => Some(text),
            _ => None,
        }
    }

    /// A number of the metadata.
    pub fn number(&self, name: &str) -> Option<f32> {
        match self.metadata.iter().find(|(own, _)| own == name) {
            Some((_, VdbValue::Float(number))) => Some(*number),
            _ => None,
        }
    }
}

/// Names and types of a file's grids.
pub fn grid_names(file: &TensorFile) -> Vec<(&str, &str)> {
    let grids = file.root.get(GRIDS).map_or(&[][..], Value::entries);
    let named = grids.iter().filter_map(|(name, grid)| match grid.get("type") {
        Some(Value::Text(kind)) => Some((name.as_str(), kind.as_str())),
        _ => None,
    });
    named.collect()
}

/// Reads a grid with all its voxels.
///
/// # Errors
/// `Unsupported` for other types and transforms, `Malformed` and `Truncated` for damaged files, and
/// more memory than the budget has.
pub fn read_grid(
    file: &TensorFile,
    name: &str,
    limits: &Limits,
    budget: &mut Budget,
) -> Result<VdbGrid> {
    let place = || Place::Key(format!("{GRIDS}.{name}"));
    let entry = file.root.at(&[GRIDS, name]);
    let entry = entry.ok_or_else(|| Error::malformed(place(), "no such grid", "one"))?;
    let kind = grid_names(file).iter().find(|(own, _)| *own == name).map_or("", |(_, kind)| kind);
    let found = TYPES.iter().find(|(own, ..)| *own == kind);
    let Some(&(_, width, half)) = found else {
        let expected = "floats or vectors of three floats in a tree 5-4-3, full or half";
        return Err(Error::unsupported(place(), format!("a grid of type {kind}"), expected));
    };
    let number = |key: &str| {
        let value = entry.get(key).ok_or_else(|| Error::malformed(place(), "no places", "some"));
        value?.integer(key).map(i64::cast_unsigned)
    };
    let [start, blocks, end] = [number("start")?, number("blocks")?, number("end")?];
    let (length, what) = (end.saturating_sub(start), "bytes of a grid");
    budget.spend(length, what, &place())?;
    let bytes = file.file.read_bounded(start, length, what, limits.memory)?;
    let mut reader = ByteReader::new(&bytes, start);
    let compression = reader.u32()?;
    let metadata = read_metadata(&mut reader, limits)?;
    let map_place = reader.place();
    let map = read_text(&mut reader)?;
    let placed = read_map(&mut reader, &map, &map_place)?;
    let mut codec = Codec { width, half, compression, background: [0.0; 3] };
    let mut tree = Tree::topology(&mut reader, &mut codec, limits, budget)?;
    if reader.offset() != blocks {
        let found = format!("a tree that ends at {}", reader.offset());
        return Err(Error::malformed(reader.place(), found, format!("{blocks}, as stated")));
    }
    tree.buffers(&mut reader, &codec)?;
    if reader.left() > 0 {
        let found = format!("{} bytes after the last leaf", reader.left());
        return Err(Error::malformed(reader.place(), found, "none"));
    }
    let values = tree.leaves.iter().flat_map(|leaf| &leaf.values);
    let bad = values.clone().filter(|value| !value.is_finite()).count() as u64;
    if bad > 0 {
        return Err(Error::new(ErrorKind::NonFinite { count: bad, first: [0; 4] }, place()));
    }
    budget.give_back(end.saturating_sub(start));
    Ok(VdbGrid { metadata, width, background: codec.background, placed, tree })
}
