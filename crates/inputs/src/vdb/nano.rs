//! Grids of NanoVDB files: the same trees as OpenVDB's, in the memory layout of a graphics card.
//!
//! ```text
//! grid   672 bytes: at 40 its name, at 440 a matrix of 9 doubles and at 584 a place of 3,
//!        then the tree: i64 x 4, of which the last is the root's place from here
//! root   24 bytes, u32 tiles, background, ...;  tile: u64 key, i64 child, u32 active, value
//! node   32 bytes, mask of active tiles, mask of children, ...;  for each place a value or, as an
//!        i64, how far its child is from the node
//! leaf   16 bytes, of which the last one has the bits of FpN; mask of active voxels; then values, or
//!        f32 least, f32 quantum, 8 bytes and codes:  value = code quantum + least
//! key    x, y and z of a root's child in units of 4096 voxels, 21 bits each, z lowest
//! ```
//!
//! Every part starts at a multiple of 32 bytes. The layout is written down in `NanoVDB.h`.

use std::collections::HashSet;
use std::io::Read as _;

use flate2::read::ZlibDecoder;

use super::blosc;
use super::placed::{Placed, placed};
use super::tree::{LEAF_VOXELS, Tile, Tree, VdbLeaf, is_on};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{self, Budget, LimitName, Limits};

/// Bytes of a grid before its tree.
const GRID_BYTES: usize = 672;
/// Bytes that Blosc compresses at once, at most.
const BLOSC_BYTES: u64 = 1 << 30;
/// Maximum expansion of zlib or LZ4, in bytes per byte.
const MOST_PACKED: u64 = 1100;
/// Children along an edge as a power of two, of a root's child and of its children, and voxels of a
/// child likewise.
const NODES: [[u32; 2]; 2] = [[5, 7], [4, 3]];
/// Voxels along the edge of a root's child, as a power of two.
const ROOT_CHILD: u32 = 12;
/// Bits of a coordinate in a key.
const KEY_BITS: u32 = 21;

/// The storage of a leaf's voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Leaves {
    /// As float32.
    Floats,
    /// As codes of this many bits.
    Codes(u32),
    /// As codes of a number of bits that each leaf states.
    AnyCodes,
}

/// Supported types, and numbers of a value.
const TYPES: [(&str, usize, Leaves); 6] = [
    ("NanoVDB Float", 1, Leaves::Floats),
    ("NanoVDB Fp4", 1, Leaves::Codes(4)),
    ("NanoVDB Fp8", 1, Leaves::Codes(8)),
    ("NanoVDB Fp16", 1, Leaves::Codes(16)),
    ("NanoVDB FpN", 1, Leaves::AnyCodes),
    ("NanoVDB Vec3f", 3, Leaves::Floats),
];

/// The numbers of a value and their storage in leaves, for supported types.
pub(super) fn shape_of(kind: &str) -> Option<(usize, Leaves)> {
    let found = TYPES.iter().find(|(own, ..)| *own == kind);
    found.map(|&(_, width, leaves)| (width, leaves))
}

/// The bytes of a grid in memory.
pub(super) fn unpacked(
    stored: Vec<u8>,
    codec: &str,
    bytes: u64,
    limits: &Limits,
    place: &Place,
) -> Result<Vec<u8>> {
    limits::check(LimitName::Memory, "bytes of a grid", bytes, limits.memory, place)?;
    let length = limits::product(&[bytes], "bytes of a grid", place)?;
    let malformed = |found: String| Error::malformed(place.clone(), found, "a whole grid");
    if codec != "none" && bytes / MOST_PACKED > stored.len() as u64 {
        return Err(malformed(format!("{} bytes for {bytes}", stored.len())));
    }
    let out = match codec {
        "none" => stored,
        "zip" => {
            let packed = part(&stored, 0).ok_or_else(|| malformed("no length".to_owned()))?.0;
            let mut plain = Vec::new();
            let stream = ZlibDecoder::new(packed).take(bytes + 1).read_to_end(&mut plain);
            stream.map_err(|error| malformed(format!("a zlib stream: {error}")))?;
            if plain.len() > length {
                return Err(malformed(format!("more than {length} bytes in a zlib stream")));
            }
            plain
        }
        _ => {
            let (mut out, mut at) = (Vec::new(), 0);
            while out.len() < length {
                let left = (length - out.len()) as u64;
                let (packed, next) =
                    part(&stored, at).ok_or_else(|| malformed("a cut stream".to_owned()))?;
                let most = limits::product(&[left.min(BLOSC_BYTES)], "bytes of a grid", place)?;
                out.extend(blosc::decompress(packed, most, place)?);
                at = next;
            }
            out
        }
    };
    if out.len() < length {
        return Err(malformed(format!("{} of {length} bytes", out.len())));
    }
    Ok(out)
}

/// Length-prefixed bytes, and the start of the next ones.
fn part(bytes: &[u8], at: usize) -> Option<(&[u8], usize)> {
    let length = bytes.get(at..)?.first_chunk::<8>()?;
    let start = at + 8;
    let end = start.checked_add(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    Some((bytes.get(start..end)?, end))
}

/// A grid in memory.
struct Bytes<'a> {
    bytes: &'a [u8],
    width: usize,
    leaves: Leaves,
    place: &'a Place,
    /// Places of visited nodes: no node has two parents.
    met: HashSet<usize>,
}

/// Reads the background, the place of the voxels and the tree of a grid.
///
/// # Errors
/// `Malformed` for places outside the grid and nodes with two parents, `NonFinite`, errors of maps,
/// and more memory than the budget has.
pub(super) fn read(
    bytes: &[u8],
    (width, leaves): (usize, Leaves),
    place: &Place,
    budget: &mut Budget,
) -> Result<([f32; 3], Placed, Tree)> {
    let mut grid = Bytes { bytes, width, leaves, place, met: HashSet::new() };
    let placed = grid.placed()?;
    let root = grid.moved(GRID_BYTES, i64::from_le_bytes(grid.array(GRID_BYTES + 24)?))?;
    let background = grid.value(root + 28)?;
    let tiles = u32::from_le_bytes(grid.array(root + 24)?) as usize;
    let first = aligned(root + 28 + 12 * width + 8);
    let tile_bytes = aligned(20 + 4 * width);
    if tiles.checked_mul(tile_bytes).is_none_or(|all| all > bytes.len()) {
        let found = format!("{tiles} tiles in a grid of {} bytes", bytes.len());
        return Err(Error::malformed(place.clone(), found, "as many as fit"));
    }
    let mut tree = Tree { leaves: Vec::new(), tiles: Vec::new() };
    for at in (0..tiles).map(|number| first + number * tile_bytes) {
        let origin = grid.origin(u64::from_le_bytes(grid.array(at)?))?;
        let child = i64::from_le_bytes(grid.array(at + 8)?);
        if child != 0 {
            let node = grid.moved(root, child)?;
            grid.node(&mut tree, node, &NODES, origin, budget)?;
        } else if u32::from_le_bytes(grid.array(at + 16)?) != 0 {
            let value = grid.value(at + 20)?;
            tree.push_tile(Tile { origin, side: 1 << ROOT_CHILD, value }, budget)?;
        }
    }
    let numbers = tree.leaves.iter().flat_map(|leaf| &leaf.values);
    let bad = numbers.filter(|value| !value.is_finite()).count() as u64;
    if bad > 0 {
        return Err(Error::new(ErrorKind::NonFinite { count: bad, first: [0; 4] }, place.clone()));
    }
    Ok((background, placed, tree))
}

/// The next multiple of 32.
fn aligned(at: usize) -> usize {
    at.next_multiple_of(32)
}

impl Bytes<'_> {
    fn array<const N: usize>(&self, at: usize) -> Result<[u8; N]> {
        let found = self.bytes.get(at..).and_then(|rest| rest.first_chunk::<N>());
        found.copied().ok_or_else(|| self.outside(at))
    }

    fn outside(&self, at: usize) -> Error {
        let found = format!("a part at byte {at}");
        let expected = format!("one within the {} bytes of the grid", self.bytes.len());
        Error::malformed(self.place.clone(), found, expected)
    }

    fn float(&self, at: usize) -> Result<f32> {
        self.array(at).map(f32::from_le_bytes)
    }

    fn value(&self, at: usize) -> Result<[f32; 3]> {
        let mut value = [0.0; 3];
        for (number, value) in value.iter_mut().take(self.width).enumerate() {
            *value = self.float(at + 4 * number)?;
        }
        Ok(value)
    }

    /// A place this many bytes from another one.
    fn moved(&self, from: usize, by: i64) -> Result<usize> {
        let to = usize::try_from(by).ok().and_then(|by| from.checked_add(by));
        to.filter(|&to| to < self.bytes.len()).ok_or_else(|| self.outside(from))
    }

    fn placed(&self) -> Result<Placed> {
        let double = |number: usize| self.array(296 + 88 + 8 * number).map(f64::from_le_bytes);
        // The file has rows of the world, this program rows of voxels; the matrix is inverted in
        // between.
        let mut rows = [[0.0; 3]; 4];
        for (axis, row) in rows.iter_mut().enumerate() {
            for (world, number) in row.iter_mut().enumerate() {
                *number = double(if axis == 3 { 18 + world } else { 3 * world + axis })?;
            }
        }
        placed(&rows, self.place)
    }

    /// The first voxel of a root's child.
    fn origin(&self, key: u64) -> Result<[i32; 3]> {
        let mut origin = [0; 3];
        for (at, shift) in origin.iter_mut().zip([2 * KEY_BITS, KEY_BITS, 0]) {
            // Coordinates are whole numbers of 32 bits, of which the lowest 12 are 0.
            let bits = (key >> shift) & ((1 << (32 - ROOT_CHILD)) - 1);
            let along = u32::try_from(bits << ROOT_CHILD).unwrap_or(0).cast_signed();
            if along.checked_add(1 << ROOT_CHILD).is_none() {
                let found = format!("a node at {along}");
                return Err(Error::malformed(self.place.clone(), found, "one below 2^31"));
            }
            *at = along;
        }
        Ok(origin)
    }

    fn mask<const N: usize>(&self, at: usize) -> Result<[u64; N]> {
        let mut mask = [0; N];
        for (number, word) in mask.iter_mut().enumerate() {
            *word = u64::from_le_bytes(self.array(at + 8 * number)?);
        }
        Ok(mask)
    }

    /// A node and all below it.
    fn node(
        &mut self,
        tree: &mut Tree,
        node: usize,
        shapes: &[[u32; 2]],
        origin: [i32; 3],
        budget: &mut Budget,
    ) -> Result<()> {
        if !self.met.insert(node) {
            let found = format!("a node at byte {node} in two places");
            return Err(Error::malformed(self.place.clone(), found, "one place for each node"));
        }
        let Some((&[edge, child_edge], below)) = shapes.split_first() else {
            let bytes = size_of::<VdbLeaf>() + LEAF_VOXELS * self.width * 4;
            budget.spend(bytes as u64, "bytes of leaves", &Place::File)?;
            tree.leaves.push(self.leaf(node, origin)?);
            return Ok(());
        };
        let places = 1usize << (3 * edge);
        let words = |at: usize| {
            (0..places / 64)
                .map(|word| self.array(at + 8 * word).map(u64::from_le_bytes))
                .collect::<Result<Vec<u64>>>()
        };
        let (active, children) = (words(node + 32)?, words(node + 32 + places / 8)?);
        let first = aligned(32 + places / 4 + 8 * self.width + 8);
        let each = (4 * self.width).next_multiple_of(8);
        for number in 0..places {
            let at = node + first + number * each;
            let mut place = origin;
            for (axis, along) in place.iter_mut().enumerate() {
                let number = number >> (edge as usize * (2 - axis)) & ((1 << edge) - 1);
                *along += i32::try_from(number).unwrap_or(0) << child_edge;
            }
            if is_on(&children, number) {
                let child = self.moved(node, i64::from_le_bytes(self.array(at)?))?;
                self.node(tree, child, below, place, budget)?;
            } else if is_on(&active, number) {
                let value = self.value(at)?;
                tree.push_tile(Tile { origin: place, side: 1 << child_edge, value }, budget)?;
            }
        }
        Ok(())
    }

    fn leaf(&self, leaf: usize, origin: [i32; 3]) -> Result<VdbLeaf> {
        let active = self.mask(leaf + 16)?;
        let bits = match self.leaves {
            Leaves::Floats => {
                let first = leaf + aligned(80 + 8 * self.width + 8);
                let numbers = 0..LEAF_VOXELS * self.width;
                let values = numbers.map(|number| self.float(first + 4 * number));
                return Ok(VdbLeaf { origin, active, values: values.collect::<Result<_>>()? });
            }
            Leaves::Codes(bits) => bits,
            Leaves::AnyCodes => {
                let [flags] = self.array(leaf + 15)?;
                if flags >> 5 > 4 {
                    let found = format!("codes of 2^{} bits", flags >> 5);
                    return Err(Error::malformed(self.place.clone(), found, "16 bits at most"));
                }
                1 << (flags >> 5)
            }
        };
        let [least, quantum] = [self.float(leaf + 80)?, self.float(leaf + 84)?];
        let code = |voxel: usize| -> Result<u32> {
            let bit = voxel * bits as usize;
            let bytes = match bits {
                16 => u16::from_le_bytes(self.array(leaf + 96 + bit / 8)?),
                _ => u16::from(u8::from_le_bytes(self.array(leaf + 96 + bit / 8)?)) >> (bit % 8),
            };
            Ok(u32::from(bytes) & ((1 << bits) - 1))
        };
        #[expect(clippy::cast_precision_loss, reason = "codes have 16 bits at most")]
        let values = (0..LEAF_VOXELS).map(|voxel| Ok(code(voxel)? as f32 * quantum + least));
        Ok(VdbLeaf { origin, active, values: values.collect::<Result<_>>()? })
    }
}
