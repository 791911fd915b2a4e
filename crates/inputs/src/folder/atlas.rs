//! A sparse grid of blocks, from the pictures of its atlas.

use std::collections::BTreeMap;

use super::block::Block;
use super::pictures::{Folder, RGB, RGBA};
use super::texels::{Texel, Texels};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, Budget, LimitName, Limits};
use crate::snerg::layout::EMPTY;
use crate::source::SideFile;

/// The number of an empty block.
const NOTHING: u32 = u32::MAX;

/// The layout of an atlas in folders of one kind.
#[derive(Debug, Clone, Copy)]
pub struct AtlasFiles {
    /// The picture with the blocks' places.
    pub indices: &'static str,
    /// The names of a pair of pictures: of colours, and of features.
    pub names: fn(usize) -> [String; 2],
    /// Planes of the atlas in each of them, one below the other.
    pub planes: usize,
    /// True for texels that count as zeros.
    pub is_nothing: fn(&Texel) -> bool,
}

/// Sizes of a grid of blocks and of its atlas.
#[derive(Debug, Clone, Copy)]
pub struct AtlasLayout {
    pub files: AtlasFiles,
    /// Blocks of the grid along each axis.
    pub counts: [usize; 3],
    /// Texels along an edge of a block, including its apron.
    pub edge: usize,
    /// Texels of the atlas.
    pub size: [usize; 3],
    /// True if there are pictures of features.
    pub has_features: bool,
}

impl AtlasLayout {
    /// Width and height of a picture.
    fn picture(&self) -> [usize; 2] {
        let [width, height, _] = self.size;
        [width, self.files.planes * height]
    }

    /// Checks all pictures. Returns a digest of each.
    fn look(&self, folder: &Folder) -> Result<Vec<SideFile>> {
        let ([x, y, z], [_, _, depth]) = (self.counts, self.size);
        let indices = self.files.indices.to_owned();
        let mut found = vec![folder.look("indices", indices, [x, y * z], &[RGB, RGBA])?];
        for number in 0..depth / self.files.planes {
            let [colors, features] = (self.files.names)(number);
            found.push(folder.look("colors", colors, self.picture(), &[RGBA])?);
            if self.has_features {
                found.push(folder.look("features", features, self.picture(), &[RGBA])?);
            }
        }
        Ok(found)
    }
}

/// The places of a grid's blocks in an atlas with checked pictures.
#[derive(Debug, Clone)]
pub struct Places {
    layout: AtlasLayout,
    /// Numbers of the grid's blocks, x fastest.
    numbers: Vec<u32>,
    /// The number of the block at each place, z first.
    places: BTreeMap<[usize; 3], u32>,
}

impl Places {
    /// Checks all pictures, and reads the index picture. Returns a digest of each.
    ///
    /// # Errors
    /// Errors of the pictures, and `Malformed` for places outside of the atlas.
    pub fn find(
        folder: &Folder,
        layout: AtlasLayout,
        limits: &Limits,
    ) -> Result<(Self, Vec<SideFile>)> {
        let AtlasLayout { files, counts, edge, size, .. } = layout;
        let looked = layout.look(folder)?;
        let place = Place::Entry(files.indices.to_owned());
        let total = limits::product(&counts.map(|count| count as u64), "blocks", &place)?;
        limits::check(LimitName::Blocks, "blocks", total as u64, limits.blocks, &place)?;
        let [x, y, z] = counts;
        let picture = folder.read(files.indices, [x, y * z], limits)?;
        let (mut numbers, mut places) = (Vec::with_capacity(total), BTreeMap::new());
        for &[i, j, k, _] in picture.bytes.as_chunks::<4>().0 {
            if i == EMPTY {
                numbers.push(NOTHING);
                continue;
            }
            let [x, y, z] = [i, j, k].map(usize::from);
            let fits = |(at, size): (usize, usize)| (at + 1) * edge <= size;
            if ![x, y, z].into_iter().zip(size).all(fits) {
                let found = format!("block {:?} in an atlas of {size:?} texels", [x, y, z]);
                let expected = format!("blocks of {edge} texels inside it");
                return Err(Error::malformed(place, found, expected));
            }
            let next = u32::try_from(places.len()).unwrap_or(NOTHING);
            numbers.push(*places.entry([z, y, x]).or_insert(next));
        }
        Ok((Self { layout, numbers, places }, looked))
    }

    /// Bytes of the blocks in memory, at most, and of a pair of pictures.
    pub fn memory_bytes(&self) -> u64 {
        let texels = self.places.len() * self.layout.edge.pow(3);
        let [width, height] = self.layout.picture();
        (size_of::<Texel>() * (texels + width * height)) as u64
    }

    /// Reads all pictures that hold blocks.
    ///
    /// # Errors
    /// Errors of the pictures, and more memory than allowed.
    pub fn load(&self, folder: &Folder, budget: &mut Budget, limits: &Limits) -> Result<Atlas> {
        let AtlasLayout { files, counts, edge, size: [width, height, depth], .. } = self.layout;
        let place = Place::Entry(files.indices.to_owned());
        let count = self.places.len();
        budget.spend(count as u64 * Block::new(edge).bytes(), "bytes of blocks", &place)?;
        let mut blocks: Vec<Block> = (0..count).map(|_| Block::new(edge)).collect();
        let size = self.layout.picture();
        let decoded = (size_of::<Texel>() * files.planes * width * height) as u64;
        for number in 0..depth / files.planes {
            let planes = files.planes * number..files.planes * (number + 1);
            let layers = [planes.start / edge, 0, 0]..[(planes.end - 1) / edge + 1, 0, 0];
            let wanted = self.places.range(layers);
            if wanted.clone().next().is_none() {
                continue;
            }
            budget.spend(decoded, "bytes of pictures", &place)?;
            let names = (files.names)(number);
            let texels = Texels::read(folder, &names, self.layout.has_features, size, limits)?;
            for ([z, y, x], number) in wanted {
                let Some(block) = blocks.get_mut(*number as usize) else { continue };
                let before = block.bytes();
                for plane in planes.clone().filter(|plane| plane / edge == *z) {
                    for row in 0..edge {
                        let line = (plane - planes.start) * height + y * edge + row;
                        let row_of_texels = texels.run(line * width + x * edge, edge).enumerate();
                        row_of_texels.filter(|(_, texel)| !(files.is_nothing)(texel)).for_each(
                            |(column, texel)| block.push([column, row, plane % edge], texel),
                        );
                    }
                }
                budget.spend(block.bytes() - before, "bytes of texels", &place)?;
            }
            budget.give_back(decoded);
        }
        blocks.iter_mut().for_each(Block::finish);
        Ok(Atlas { counts, numbers: self.numbers.clone(), blocks })
    }
}

/// The blocks of a grid in memory.
#[derive(Debug)]
pub struct Atlas {
    /// Blocks of the grid along each axis.
    pub counts: [usize; 3],
    /// Numbers of the grid's blocks, x fastest.
    numbers: Vec<u32>,
    blocks: Vec<Block>,
}

impl Atlas {
    /// A block of the grid, unless empty.
    #[inline]
    pub fn block(&self, [x, y, z]: [usize; 3]) -> Option<&Block> {
        let [nx, ny, _] = self.counts;
        let number = *self.numbers.get((z * ny + y) * nx + x)?;
        // Nothing has the number NOTHING.
        self.blocks.get(number as usize).filter(|_| x < nx && y < ny)
    }
}
