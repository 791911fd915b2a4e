//! Trees of three levels: nodes with 32, 16 and 8 cubes per side.
//!
//! ```text
//! i32 1, background, u32 tiles of the root, u32 children of the root
//! tile       i32 x 3 origin, value, u8 active
//! child      i32 x 3 origin, then the node of 32^3
//! node       mask of children, mask of active tiles, values of all places, then its children
//! leaf       mask of active voxels
//! buffers    for each leaf in the same order: the mask again, values
//! ```

use super::codec::{Codec, Inflater};
use crate::base::bytes::ByteReader;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, Budget, LimitName, Limits};

/// Voxels of a leaf.
pub const LEAF_VOXELS: usize = 512;
/// Nodes' children along an edge as a power of two, and voxels of a child likewise.
const NODES: [[u32; 2]; 2] = [[5, 7], [4, 3]];
/// Voxels along the edge of a child of the root, as a power of two.
const ROOT_CHILD: u32 = 12;

/// A cube of voxels of one value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tile {
    /// The first voxel.
    pub origin: [i32; 3],
    /// Voxels along the edge.
    pub side: u32,
    /// The value.
    pub value: [f32; 3],
}

/// A leaf: eight voxels per side.
#[derive(Debug, Clone, PartialEq)]
pub struct VdbLeaf {
    /// The first voxel.
    pub origin: [i32; 3],
    /// Active voxels, z fastest.
    pub active: [u64; 8],
    /// Values of all voxels, numbers of a value together.
    pub values: Vec<f32>,
}

/// The voxels of a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Tree {
    /// In the order of the file.
    pub leaves: Vec<VdbLeaf>,
    /// Active tiles.
    pub tiles: Vec<Tile>,
}

impl Tree {
    /// Reads topology up to the buffers, which begin at `blocks` of the file.
    ///
    /// # Errors
    /// `Truncated` and `Malformed`, and more memory than the budget has.
    pub fn topology(
        reader: &mut ByteReader,
        codec: &mut Codec,
        limits: &Limits,
        budget: &mut Budget,
    ) -> Result<Self> {
        let (place, buffers) = (reader.place(), reader.u32()?);
        if buffers != 1 {
            let found = format!("{buffers} buffers per leaf");
            return Err(Error::unsupported(place, found, "1"));
        }
        codec.background = codec.full_value(reader)?;
        let place = reader.place();
        let [tiles, children] = [reader.u32()?, reader.u32()?];
        limits::check(LimitName::Blocks, "tiles of a root", tiles.into(), limits.blocks, &place)?;
        limits::check(
            LimitName::Blocks,
            "children of a root",
            children.into(),
            limits.blocks,
            &place,
        )?;
        let mut tree = Self { leaves: Vec::new(), tiles: Vec::new() };
        for _ in 0..tiles {
            let (origin, value) = (origin(reader)?, codec.full_value(reader)?);
            if reader.u8()? != 0 {
                tree.push_tile(Tile { origin, side: 1 << ROOT_CHILD, value }, budget)?;
            }
        }
        let mut inflater = Inflater::default();
        for _ in 0..children {
            let place = reader.place();
            let origin = origin(reader)?;
            let edge = 1 << ROOT_CHILD;
            let fits = |at: &i32| at % edge == 0 && at.checked_add(edge).is_some();
            if !origin.iter().all(fits) {
                let found = format!("a node at {origin:?}");
                return Err(Error::malformed(place, found, "multiples of 4096"));
            }
            tree.node(reader, (codec, &mut inflater), &NODES, origin, budget)?;
        }
        Ok(tree)
    }

    pub(super) fn push_tile(&mut self, tile: Tile, budget: &mut Budget) -> Result<()> {
        budget.spend(size_of::<Tile>() as u64, "bytes of tiles", &Place::File)?;
        self.tiles.push(tile);
        Ok(())
    }

    /// A node and all below it.
    fn node(
        &mut self,
        reader: &mut ByteReader,
        (codec, inflater): (&Codec, &mut Inflater),
        shapes: &[[u32; 2]],
        origin: [i32; 3],
        budget: &mut Budget,
    ) -> Result<()> {
        let Some((&[edge, child_edge], below)) = shapes.split_first() else {
            let mut active = [0; 8];
            for word in &mut active {
                *word = reader.u64()?;
            }
            let bytes = size_of::<VdbLeaf>() + LEAF_VOXELS * codec.width * 4;
            budget.spend(bytes as u64, "bytes of leaves", &Place::File)?;
            self.leaves.push(VdbLeaf { origin, active, values: Vec::new() });
            return Ok(());
        };
        let places = 1usize << (3 * edge);
        let words = places / 64;
        let mut mask = || (0..words).map(|_| reader.u64()).collect::<Result<Vec<u64>>>();
        let (children, active) = (mask()?, mask()?);
        let at = |number: usize| {
            let mut place = origin;
            for (axis, at) in place.iter_mut().enumerate() {
                let along = number >> (edge as usize * (2 - axis)) & ((1 << edge) - 1);
                *at += i32::try_from(along).unwrap_or(0) << child_edge;
            }
            place
        };
        let mut tiles = Vec::new();
        codec.read(reader, (places, &active), inflater, |number, value| {
            if is_on(&active, number) && !is_on(&children, number) {
                tiles.push(Tile { origin: at(number), side: 1 << child_edge, value });
            }
        })?;
        for tile in tiles {
            self.push_tile(tile, budget)?;
        }
        for number in (0..places).filter(|&number| is_on(&children, number)) {
            self.node(reader, (codec, inflater), below, at(number), budget)?;
        }
        Ok(())
    }

    /// Reads the values of all leaves, whose memory is already counted in the budget.
    ///
    /// # Errors
    /// `Truncated` and `Malformed`.
    pub fn buffers(&mut self, reader: &mut ByteReader, codec: &Codec) -> Result<()> {
        let mut inflater = Inflater::default();
        for leaf in &mut self.leaves {
            let place = reader.place();
            for word in &leaf.active {
                if reader.u64()? != *word {
                    let found = format!("another mask of the leaf at {:?}", leaf.origin);
                    return Err(Error::malformed(place, found, "that of its topology"));
                }
            }
            let mut values = Vec::with_capacity(LEAF_VOXELS * codec.width);
            let voxels = (LEAF_VOXELS, &leaf.active[..]);
            codec.read(reader, voxels, &mut inflater, |_, value| {
                values.extend(value.into_iter().take(codec.width));
            })?;
            leaf.values = values;
        }
        Ok(())
    }
}

/// True for a bit of a mask.
pub fn is_on(mask: &[u64], at: usize) -> bool {
    mask.get(at / 64).is_some_and(|word| word >> (at % 64) & 1 == 1)
}

fn origin(reader: &mut ByteReader) -> Result<[i32; 3]> {
    Ok([reader.i32()?, reader.i32()?, reader.i32()?])
}
