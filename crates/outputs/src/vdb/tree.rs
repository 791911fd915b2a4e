//! The topology of a tree 5-4-3, and the values of its leaves.
//!
//! Nodes have no active tiles, so they have no values. With compression, this is still written as a
//! length of zero in 8 bytes, except for half floats, of which readers expect nothing.

use std::collections::BTreeMap;

use half::f16;
use miniz_oxide::DataFormat;
use miniz_oxide::deflate::CompressionLevel;
use miniz_oxide::deflate::core::{CompressorOxide, TDEFLFlush, TDEFLStatus, compress};

use crate::base::error::Result;
use crate::base::parallel;
use crate::picture::finite_half;
use crate::volume::{Leaf, LeafMask, points};

/// Voxels along the edge of a child of the root, as a power of two.
const ROOT_CHILD: usize = 12;
/// Inactive values are all the background.
const BACKGROUND: u8 = 0;
/// Half floats compress little: slower levels save less than a hundredth.
const LEVEL: CompressionLevel = CompressionLevel::BestSpeed;
/// Leaves for which a compressor is made: its tables are larger than they are.
const PER_COMPRESSOR: usize = 32;

/// The leaves below each child of a node, by the child's place.
type Children<'a> = BTreeMap<usize, Vec<&'a (&'a Leaf, LeafMask)>>;

/// The content of a leaf in a grid.
pub struct GridContent<'a> {
    /// Numbers of a value: 1 or 3.
    pub width: usize,
    /// Half floats instead of float32.
    pub half: bool,
    /// The points that are active.
    pub active: &'a (dyn Fn(&Leaf) -> LeafMask + Sync),
    /// The value of a point; numbers beyond the width are ignored.
    pub value: &'a (dyn Fn(&Leaf, usize) -> [f32; 3] + Sync),
}

/// The leaves of a grid in the order of the file.
pub struct Ordered<'a> {
    leaves: Vec<(&'a Leaf, LeafMask)>,
}

impl<'a> Ordered<'a> {
    /// Those with active points.
    pub fn new(leaves: &'a [Leaf], content: &GridContent) -> Self {
        let masked = leaves.iter().map(|leaf| (leaf, (content.active)(leaf)));
        let mut leaves: Vec<(&Leaf, LeafMask)> =
            masked.filter(|(_, mask)| mask.iter().any(|&word| word != 0)).collect();
        leaves.sort_by_key(|(leaf, _)| (root(leaf), offset(leaf, 4, 31), offset(leaf, 0, 15)));
        Self { leaves }
    }

    /// Active points.
    pub fn count(&self) -> u64 {
        let masks = self.leaves.iter().flat_map(|(_, mask)| mask);
        masks.map(|word| u64::from(word.count_ones())).sum()
    }

    /// The least and the greatest active voxel.
    pub fn corners(&self) -> [[i32; 3]; 2] {
        let mut corners: Option<[[i32; 3]; 2]> = None;
        for (leaf, mask) in &self.leaves {
            for point in points(mask) {
                let inside = [point >> 6, point >> 3 & 7, point & 7].map(|at| at as i32);
                let at: [i32; 3] = std::array::from_fn(|axis| 8 * leaf.at[axis] + inside[axis]);
                let [low, high] = corners.get_or_insert([at, at]);
                for axis in 0..3 {
                    low[axis] = low[axis].min(at[axis]);
                    high[axis] = high[axis].max(at[axis]);
                }
            }
        }
        corners.unwrap_or_default()
    }

    /// The topology: root, nodes, masks of leaves.
    pub fn topology(&self, content: &GridContent) -> Vec<u8> {
        let mut bytes = 1u32.to_le_bytes().to_vec();
        bytes.extend(vec![0; 4 * content.width]);
        let mut roots: BTreeMap<[i32; 3], Children> = BTreeMap::new();
        for leaf in &self.leaves {
            let nodes = roots.entry(root(leaf.0)).or_default();
            nodes.entry(offset(leaf.0, 4, 31)).or_default().push(leaf);
        }
        bytes.extend(0u32.to_le_bytes());
        bytes.extend((roots.len() as u32).to_le_bytes());
        for (origin, nodes) in &roots {
            bytes.extend(origin.iter().flat_map(|at| at.to_le_bytes()));
            node(&mut bytes, 1 << 15, nodes.keys().copied(), content);
            for leaves in nodes.values() {
                let places = leaves.iter().map(|(leaf, _)| offset(leaf, 0, 15));
                node(&mut bytes, 1 << 12, places, content);
                for (_, mask) in leaves {
                    bytes.extend(mask.iter().flat_map(|word| word.to_le_bytes()));
                }
            }
        }
        bytes
    }

    /// The values of the leaves from `first` on, at most `count` of them, one after the other.
    pub fn values(&self, content: &GridContent, first: usize, count: usize) -> Result<Vec<u8>> {
        let leaves = &self.leaves[first..(first + count).min(self.leaves.len())];
        let parts: Vec<_> = leaves.chunks(PER_COMPRESSOR).collect();
        let parts = parallel::map(parts.len(), |number| {
            let mut compressor = CompressorOxide::with_format_and_level(DataFormat::Zlib, LEVEL);
            let (mut bytes, mut plain, mut packed) = (Vec::new(), Vec::new(), Vec::new());
            for (leaf, mask) in parts[number] {
                plain.clear();
                for point in points(mask) {
                    for number in (content.value)(leaf, point).into_iter().take(content.width) {
                        match content.half {
                            true => plain.extend(f16::to_le_bytes(finite_half(number))),
                            false => plain.extend(number.to_le_bytes()),
                        }
                    }
                }
                bytes.extend(mask.iter().flat_map(|word| word.to_le_bytes()));
                bytes.push(BACKGROUND);
                packed.resize(plain.len(), 0);
                compressor.reset();
                match compress(&mut compressor, &plain, &mut packed, TDEFLFlush::Finish) {
                    (TDEFLStatus::Done, _, length) if length < plain.len() => {
                        bytes.extend((length as i64).to_le_bytes());
                        bytes.extend(&packed[..length]);
                    }
                    _ => {
                        bytes.extend((-(plain.len() as i64)).to_le_bytes());
                        bytes.extend(&plain);
                    }
                }
            }
            Ok(bytes)
        })?;
        Ok(parts.concat())
    }

    /// Leaves.
    pub fn leaves(&self) -> usize {
        self.leaves.len()
    }
}

/// The masks and values of a node with children at some of its places.
fn node(
    bytes: &mut Vec<u8>,
    places: usize,
    children: impl Iterator<Item = usize>,
    content: &GridContent,
) {
    let mut mask = vec![0u8; places / 8];
    children.for_each(|place| mask[place / 8] |= 1 << (place % 8));
    bytes.extend(mask);
    bytes.extend(vec![0; places / 8]);
    bytes.push(BACKGROUND);
    if !content.half {
        bytes.extend(0i64.to_le_bytes());
    }
}

/// The first voxel of the root's child that a leaf is below.
fn root(leaf: &Leaf) -> [i32; 3] {
    leaf.at.map(|at| (at * 8) >> ROOT_CHILD << ROOT_CHILD)
}

/// The place of a leaf in a node whose children have `1 << shift` leaves along an edge.
fn offset(leaf: &Leaf, shift: u32, most: i32) -> usize {
    let [x, y, z] = leaf.at.map(|at| (at >> shift & most) as usize);
    let side = most as usize + 1;
    (x * side + y) * side + z
}
