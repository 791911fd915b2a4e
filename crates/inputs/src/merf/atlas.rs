//! The sparse grid, out of the pictures of its atlas.

use std::collections::BTreeMap;

use super::parameters::{Names, Sparse};
use super::texel::{Texel, pair};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, Budget, LimitName, Limits};
use crate::folder::{Folder, RGB, RGBA, whole};
use crate::snerg::layout::EMPTY;
use crate::source::SideFile;

/// The number of a block that shows nothing.
const NOTHING: u32 = u32::MAX;

/// The blocks of a sparse grid in memory.
#[derive(Debug)]
pub(super) struct Atlas {
    sparse: Sparse,
    /// Numbers of the grid's blocks, x fastest.
    numbers: Vec<u32>,
    /// The blocks, one after the other, each x fastest.
    texels: Vec<Texel>,
}

/// Looks at the pictures.
pub(super) fn look(folder: &Folder, names: Names, sparse: &Sparse) -> Result<Vec<SideFile>> {
    let count = sparse.blocks();
    let indices = names.indices().to_owned();
    let mut found = vec![folder.look("indices", indices, [count, count * count], &[RGB, RGBA])?];
    let [width, height, depth] = sparse.atlas;
    for z in 0..depth {
        let [colors, features] = names.atlas(z);
        found.push(folder.look("colors", colors, [width, height], &[RGBA])?);
        found.push(folder.look("features", features, [width, height], &[RGBA])?);
    }
    Ok(found)
}

/// Bytes of the blocks in memory, at most.
pub(super) fn memory_bytes(sparse: &Sparse) -> u64 {
    let texels: u64 = sparse.atlas.iter().map(|size| *size as u64).product();
    4 * (sparse.blocks() as u64).pow(3) + size_of::<Texel>() as u64 * texels
}

impl Atlas {
    /// Reads the pictures that hold blocks.
    pub(super) fn read(
        folder: &Folder,
        names: Names,
        sparse: Sparse,
        budget: &mut Budget,
        limits: &Limits,
    ) -> Result<Self> {
        let (count, edge) = (sparse.blocks(), sparse.block + 1);
        let place = Place::Entry(names.indices().to_owned());
        let total = limits::product(&[count as u64; 3], "blocks", &place)?;
        limits::check(LimitName::Blocks, "blocks", total as u64, limits.blocks, &place)?;
        let picture = folder.read(names.indices(), [count, count * count], limits)?;
        let (mut numbers, mut places) = (Vec::with_capacity(total), BTreeMap::new());
        for &[i, j, k, _] in picture.bytes.as_chunks::<4>().0 {
            if i == EMPTY {
                numbers.push(NOTHING);
                continue;
            }
            let [x, y, z] = [i, j, k].map(usize::from);
            let fits = |(at, size): (usize, usize)| (at + 1) * edge <= size;
            if ![x, y, z].into_iter().zip(sparse.atlas).all(fits) {
                let found =
                    format!("block {:?} in an atlas of {:?} texels", [x, y, z], sparse.atlas);
                let expected = format!("blocks of {edge} texels inside of it");
                return Err(Error::malformed(place, found, expected));
            }
            let next = u32::try_from(places.len()).unwrap_or(NOTHING);
            numbers.push(*places.entry([z, y, x]).or_insert(next));
        }
        let of_block = edge.pow(3);
        let bytes = (size_of::<Texel>() * of_block * places.len()) as u64;
        budget.spend(bytes, "bytes of texels", &place)?;
        let mut texels = vec![[0; 8]; of_block * places.len()];
        let [width, height, depth] = sparse.atlas;
        for plane in 0..depth {
            let layer = places.range([plane / edge, 0, 0]..[plane / edge + 1, 0, 0]);
            if layer.clone().next().is_none() {
                continue;
            }
            let picture = pair(folder, &names.atlas(plane), [width, height], limits)?;
            for ([_, y, x], number) in layer {
                let first = *number as usize * of_block + plane % edge * edge * edge;
                for row in 0..edge {
                    let from = (y * edge + row) * width + x * edge;
                    let to = first + row * edge;
                    let (Some(to), Some(from)) =
                        (texels.get_mut(to..to + edge), picture.get(from..from + edge))
                    else {
                        continue;
                    };
                    to.copy_from_slice(from);
                }
            }
        }
        Ok(Self { sparse, numbers, texels })
    }

    /// The block at a place of the grid, if it shows something.
    fn block(&self, [x, y, z]: [usize; 3]) -> Option<&[Texel]> {
        let count = self.sparse.blocks();
        let number = *self.numbers.get((z * count + y) * count + x)?;
        let inside = x < count && y < count && number != NOTHING;
        let texels = (self.sparse.block + 1).pow(3);
        let first = inside.then_some(number as usize * texels)?;
        self.texels.get(first..first + texels)
    }

    /// Adds the codes at a position in voxels, 0 being the middle of the first one. Positions
    /// without a block take the nearest one up to `reach` away, from where it ends. False if there
    /// is none.
    pub(super) fn add(&self, at: [f64; 3], reach: f64, sums: &mut [f64; 8]) -> bool {
        let edge = self.sparse.block as f64;
        let number = |at: f64| whole((at / edge).floor());
        let own = at.map(number);
        let [xs, ys, zs] = at.map(|at| number(at - reach)..=number(at + reach));
        let near = xs.flat_map(|x| {
            let (ys, zs) = (ys.clone(), zs.clone());
            ys.flat_map(move |y| zs.clone().map(move |z| [x, y, z]))
        });
        let found = std::iter::once(own)
            .chain(near.filter(|_| reach > 0.0))
            .find_map(|number| Some((number, self.block(number)?)));
        let Some((number, texels)) = found else { return false };
        self.interpolate(at, number, texels, sums);
        true
    }

    fn interpolate(&self, at: [f64; 3], number: [usize; 3], texels: &[Texel], sums: &mut [f64; 8]) {
        let size = self.sparse.block;
        let mut corners = [[(0, 0.0); 2]; 3];
        for ((corners, at), number) in corners.iter_mut().zip(at).zip(number) {
            let local = (at - (number * size) as f64).clamp(0.0, size as f64);
            let low = whole(local).min(size - 1);
            *corners = [(low, 1.0 - (local - low as f64)), (low + 1, local - low as f64)];
        }
        let [xs, ys, zs] = corners;
        for (z, of_z) in zs {
            for (y, of_y) in ys {
                for (x, of_x) in xs {
                    let place = (z * (size + 1) + y) * (size + 1) + x;
                    let Some(texel) = texels.get(place) else { continue };
                    let weight = of_x * of_y * of_z;
                    let terms = sums.iter_mut().zip(texel);
                    terms.for_each(|(sum, code)| *sum += weight * f64::from(*code));
                }
            }
        }
    }
}
