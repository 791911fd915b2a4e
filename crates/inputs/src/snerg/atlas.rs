//! The blocks of a folder, out of the pictures of its atlas.

use super::block::{Block, Texel};
use super::files::Pictures;
use super::parameters::Parameters;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, Budget, LimitName, Limits};
use crate::base::parallel;
use crate::snerg::layout::{APRON, EMPTY, INDICES, PLANES, feature_name, rgba_name};

/// The places of a grid's blocks in the atlas, x fastest.
#[derive(Debug, Clone)]
pub(super) struct Places {
    /// Blocks of the grid along each axis.
    pub(super) counts: [usize; 3],
    /// The place of each block, in blocks; none where it shows nothing.
    places: Vec<Option<[usize; 3]>>,
}

impl Places {
    /// Reads the picture of indices.
    pub(super) fn read(
        pictures: &Pictures,
        parameters: &Parameters,
        limits: &Limits,
    ) -> Result<Self> {
        let counts = parameters.blocks();
        let [x, y, z] = counts;
        let place = Place::Entry(INDICES.to_owned());
        let total = limits::product(&counts.map(|count| count as u64), "blocks", &place)?;
        limits::check(LimitName::Blocks, "blocks", total as u64, limits.blocks, &place)?;
        let picture = pictures.folder.read(INDICES, [x, y * z], limits)?;
        let mut places = Vec::with_capacity(total);
        for &[i, j, k, _] in picture.bytes.as_chunks::<4>().0 {
            if i == EMPTY {
                places.push(None);
                continue;
            }
            let at = [i, j, k].map(usize::from);
            let fits = at
                .iter()
                .zip(parameters.atlas)
                .all(|(at, size)| (at + 1) * parameters.edge() <= size);
            if !fits {
                let found = format!("block {at:?} in an atlas of {:?} texels", parameters.atlas);
                let expected = format!("blocks of {} texels inside of it", parameters.edge());
                return Err(Error::malformed(place, found, expected));
            }
            places.push(Some(at));
        }
        Ok(Self { counts, places })
    }

    fn number(&self, [x, y, z]: [usize; 3]) -> usize {
        let [nx, ny, _] = self.counts;
        (z * ny + y) * nx + x
    }

    /// Blocks that show something.
    pub(super) fn full_count(&self) -> usize {
        self.full().count()
    }

    /// Numbers and places of the blocks that show something.
    fn full(&self) -> impl Iterator<Item = (usize, [usize; 3])> {
        self.places.iter().enumerate().filter_map(|(number, place)| Some((number, (*place)?)))
    }
}

/// The blocks of a grid in memory.
#[derive(Debug)]
pub(super) struct Atlas {
    places: Places,
    /// Voxels along an edge of a block.
    block: usize,
    /// By the number of each block.
    blocks: Vec<Option<Box<Block>>>,
}

impl Atlas {
    /// Reads all pictures that hold blocks.
    pub(super) fn load(
        pictures: &Pictures,
        places: &Places,
        parameters: &Parameters,
        limits: &Limits,
    ) -> Result<Self> {
        let mut blocks: Vec<Option<Box<Block>>> = Vec::new();
        blocks.resize_with(places.places.len(), || None);
        let mut budget = Budget::new(limits);
        let (edge, place) = (parameters.edge(), Place::Entry(INDICES.to_owned()));
        let [width, height, _] = parameters.atlas;
        let decoded = (2 * 4 * PLANES * width * height) as u64;
        for slice in 0..parameters.slices {
            let planes = PLANES * slice..PLANES * (slice + 1);
            let layers = planes.start / edge..=(planes.end - 1) / edge;
            let wanted: Vec<(usize, [usize; 3])> =
                places.full().filter(|(_, [_, _, z])| layers.contains(z)).collect();
            if wanted.is_empty() {
                continue;
            }
            budget.spend(decoded, "bytes of pictures", &place)?;
            let size = [width, PLANES * height];
            let half = limits.shared_by(2);
            let (colors, features) = parallel::join(
                || pictures.folder.read(&rgba_name(slice), size, &half),
                || match pictures.features {
                    true => pictures.folder.read(&feature_name(slice), size, &half).map(Some),
                    false => Ok(None),
                },
            );
            let (colors, features) = (colors?, features?);
            for (number, at) in wanted {
                let Some(slot) = blocks.get_mut(number) else { continue };
                let block = slot.get_or_insert_with(|| Box::new(Block::new(edge)));
                let before = block.bytes();
                let [x, y, z] = at.map(|at| at * edge);
                for plane in planes.clone().filter(|plane| (z..z + edge).contains(plane)) {
                    for row in 0..edge {
                        let first = ((plane - planes.start) * height + y + row) * width + x;
                        let of = |bytes: &[u8]| -> Vec<[u8; 4]> {
                            let row = bytes.get(4 * first..4 * (first + edge));
                            row.unwrap_or_default().as_chunks::<4>().0.to_vec()
                        };
                        let features = features.as_ref().map(|picture| of(&picture.bytes));
                        let features = features.unwrap_or_else(|| vec![[0; 4]; edge]);
                        for (column, (color, feature)) in
                            of(&colors.bytes).into_iter().zip(features).enumerate()
                        {
                            let ([r, g, b, a], [f, h, i, j]) = (color, feature);
                            let texel: Texel = [r, g, b, a, f, h, i, j];
                            block.push([column, row, plane - z], texel);
                        }
                    }
                }
                let is_new = planes.start <= z;
                let grown = block.bytes() - if is_new { 0 } else { before };
                budget.spend(grown, "bytes of texels", &place)?;
            }
            budget.give_back(decoded);
        }
        blocks.iter_mut().flatten().for_each(|block| block.finish());
        Ok(Self { places: places.clone(), block: parameters.block, blocks })
    }

    /// Voxels along an edge of a block.
    pub(super) fn block_size(&self) -> usize {
        self.block
    }

    /// A block of the grid, if it shows something.
    #[inline]
    pub(super) fn block(&self, at: [usize; 3]) -> Option<&Block> {
        self.blocks.get(self.places.number(at)).and_then(Option::as_deref)
    }

    /// Calls `visit` with all voxels of some opacity in a plane.
    pub(super) fn plane(&self, axis: usize, at: usize, mut visit: impl FnMut([usize; 3], Texel)) {
        let [nx, ny, nz] = self.places.counts;
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let block = [x, y, z];
                    if block.get(axis) != Some(&(at / self.block)) {
                        continue;
                    }
                    let Some(texels) = self.block(block) else { continue };
                    let own = [0, 1, 2].map(|other| match other == axis {
                        true => at % self.block..at % self.block + 1,
                        false => 0..self.block,
                    });
                    let [xs, ys, zs] = own;
                    for k in zs {
                        for (i, j) in ys.clone().flat_map(|j| xs.clone().map(move |i| (i, j))) {
                            let texel = texels.texel([i, j, k].map(|at| at + APRON));
                            if texel != [0; 8] {
                                let [x, y, z] = block.map(|at| at * self.block);
                                visit([x + i, y + j, z + k], texel);
                            }
                        }
                    }
                }
            }
        }
    }
}
