//! One grid of a file.

use super::codec::{Codec, Precision};
use super::nano;
use super::placed::{Placed, read_map};
use super::tree::Tree;
use crate::base::bytes::ByteReader;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{Budget, LimitName, Limits};
use crate::tensor::{FileKind, GRIDS, TensorFile, Value, VdbValue, read_metadata, read_text};

/// Supported types, the numbers of a value, and their precision.
const TYPES: [(&str, usize, Precision); 5] = [
    ("Tree_float_5_4_3", 1, Precision::Full),
    ("Tree_float_5_4_3_HalfFloat", 1, Precision::SavedAsHalf),
    ("Tree_half_5_4_3", 1, Precision::Half),
    ("Tree_vec3s_5_4_3", 3, Precision::Full),
    ("Tree_vec3s_5_4_3_HalfFloat", 3, Precision::SavedAsHalf),
];

/// The metadata key for the meaning of a grid's numbers.
pub(super) const CLASS: &str = "class";
/// Bytes of a grid in which its metadata lies.
const HEAD_BYTES: u64 = 1 << 20;

/// A grid.
#[derive(Debug, Clone)]
pub struct VdbGrid {
    /// Its metadata.
    pub metadata: Vec<(String, VdbValue)>,
    /// Numbers of a value: 1 or 3.
    pub width: usize,
    /// The background value, of voxels that are not stored.
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

/// True for types of grids with one number per voxel.
pub(super) fn is_scalar(kind: &str) -> bool {
    TYPES.iter().any(|(own, width, _)| *own == kind && *width == 1)
        || nano::shape_of(kind).is_some_and(|(width, _)| width == 1)
}

/// A number of a grid's entry: a place in the file.
fn place_of(entry: &Value, key: &str, place: &Place) -> Result<u64> {
    let value = entry.get(key).ok_or_else(|| Error::malformed(place.clone(), "no places", "some"));
    value?.integer(key).map(i64::cast_unsigned)
}

fn entry_of<'a>(file: &'a TensorFile, name: &str) -> Result<(&'a Value, Place)> {
    let place = Place::Key(format!("{GRIDS}.{name}"));
    let grids = file.root.get(GRIDS).map_or(&[][..], Value::entries);
    match grids.iter().find(|(own, _)| own == name) {
        Some((_, entry)) => Ok((entry, place)),
        None => Err(Error::malformed(place, "no such grid", "one")),
    }
}

/// The class of a grid; reads only its start.
///
/// # Errors
/// As [`read_grid`].
pub(super) fn read_class(file: &TensorFile, name: &str, limits: &Limits) -> Result<Option<String>> {
    let (entry, place) = entry_of(file, name)?;
    if let Some(Value::Text(class)) = entry.get(CLASS) {
        return Ok(Some(class.clone()));
    }
    let [start, end] = [place_of(entry, "start", &place)?, place_of(entry, "end", &place)?];
    let length = end.saturating_sub(start).min(HEAD_BYTES);
    let bytes = file.file.read(start, length, HEAD_BYTES)?;
    let mut reader = ByteReader::new(&bytes, start);
    reader.u32()?;
    let class = read_metadata(&mut reader, limits)?.into_iter().find(|(name, _)| name == CLASS);
    Ok(class.and_then(|(_, value)| match value {
        VdbValue::Text(class) => Some(class),
        _ => None,
    }))
}

/// Reads a grid with all its voxels, or with the voxels of the grid whose tree it shares.
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
    let (entry, own_place) = entry_of(file, name)?;
    let place = || own_place.clone();
    if let Some(Value::Text(parent)) = entry.get("parent") {
        return read_instance(file, entry, &own_place, parent, limits, budget);
    }
    let kind = grid_names(file).iter().find(|(own, _)| *own == name).map_or("", |(_, kind)| kind);
    if file.kind == FileKind::NanoVdb {
        return read_nano(file, entry, (kind, &own_place), limits, budget);
    }
    let found = TYPES.iter().find(|(own, ..)| *own == kind);
    let Some(&(_, width, precision)) = found else {
        let expected = "floats or vectors of three floats in a tree 5-4-3, full or half";
        return Err(Error::unsupported(place(), format!("a grid of type {kind}"), expected));
    };
    let number = |key: &str| place_of(entry, key, &own_place);
    let [start, blocks, end] = [number("start")?, number("blocks")?, number("end")?];
    let (length, what) = (end.saturating_sub(start), "bytes of a grid");
    budget.spend(length, what, &place())?;
    let bytes = file.file.read_bounded(start, length, (LimitName::Memory, what), limits.memory)?;
    let mut reader = ByteReader::new(&bytes, start);
    let compression = reader.u32()?;
    let metadata = read_metadata(&mut reader, limits)?;
    let map_place = reader.place();
    let map = read_text(&mut reader)?;
    let placed = read_map(&mut reader, &map, &map_place)?;
    let mut codec = Codec { width, precision, compression, background: [0.0; 3] };
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

/// A grid of a NanoVDB file.
fn read_nano(
    file: &TensorFile,
    entry: &Value,
    (kind, place): (&str, &Place),
    limits: &Limits,
    budget: &mut Budget,
) -> Result<VdbGrid> {
    let Some(shape) = nano::shape_of(kind) else {
        let expected = "Float, Fp4, Fp8, Fp16, FpN or Vec3f";
        let error = Error::unsupported(place.clone(), format!("a grid of type {kind}"), expected);
        return Err(error.advise("convert it to floats, or save it as .vdb"));
    };
    let number = |key: &str| place_of(entry, key, place);
    let [start, end, bytes] = [number("start")?, number("end")?, number("bytes")?];
    let text = |key: &str| match entry.get(key) {
        Some(Value::Text(text)) => text.as_str(),
        _ => "",
    };
    let (length, what) = (end.saturating_sub(start), "bytes of a grid");
    let spent = length.saturating_add(bytes);
    budget.spend(spent, what, place)?;
    let stored = file.file.read_bounded(start, length, (LimitName::Memory, what), limits.memory)?;
    let grid = nano::unpacked(stored, text("codec"), bytes, limits, place)?;
    let (background, placed, tree) = nano::read(&grid, shape, place, budget)?;
    budget.give_back(spent);
    let metadata = vec![(CLASS.to_owned(), VdbValue::Text(text(CLASS).to_owned()))];
    Ok(VdbGrid { metadata, width: shape.0, background, placed, tree })
}

/// A grid with its own metadata and map, and a shared tree.
fn read_instance(
    file: &TensorFile,
    entry: &Value,
    place: &Place,
    parent: &str,
    limits: &Limits,
    budget: &mut Budget,
) -> Result<VdbGrid> {
    let (parent_entry, _) = entry_of(file, parent)?;
    if parent_entry.get("parent").is_some() {
        let found = format!("the tree of {parent:?}, which belongs to another grid");
        return Err(Error::malformed(place.clone(), found, "a grid with a tree of its own"));
    }
    let shared = read_grid(file, parent, limits, budget)?;
    let [start, end] = [place_of(entry, "start", place)?, place_of(entry, "end", place)?];
    let bytes = file.file.read(start, end.saturating_sub(start), limits.header_bytes)?;
    let mut reader = ByteReader::new(&bytes, start);
    reader.u32()?;
    let metadata = read_metadata(&mut reader, limits)?;
    let map_place = reader.place();
    let map = read_text(&mut reader)?;
    let placed = read_map(&mut reader, &map, &map_place)?;
    Ok(VdbGrid { metadata, placed, ..shared })
}
