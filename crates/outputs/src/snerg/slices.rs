//! Pictures of four planes of the atlas each.

use std::path::{Path, PathBuf};

use super::layout::{Layout, MIPS};
use super::texels::BlockTexels;
use crate::base::error::Result;
use crate::base::parallel;
use crate::export_files::ExportFiles;
use crate::picture;
use mipvog_inputs::snerg::layout::{PLANES, feature_name, rgba_name};

/// Texels of a box, x fastest, then y.
#[derive(Debug, Clone)]
struct Texture {
    sides: [usize; 3],
    texels: Vec<[u8; 4]>,
}

/// The pictures of one kind and one level, during filling.
#[derive(Debug)]
struct Series {
    level: usize,
    name: fn(usize) -> String,
    /// Planes of an incomplete picture.
    waiting: Vec<[u8; 4]>,
    pictures: usize,
}

/// Writes layers of the atlas from the lowest one on.
#[derive(Debug)]
pub(super) struct Slices {
    layout: Layout,
    /// Of colours, and of features if there are some; fine to coarse.
    series: Vec<Vec<Series>>,
}

impl Texture {
    fn clear(sides: [usize; 3]) -> Self {
        Self { sides, texels: vec![[0; 4]; sides.iter().product()] }
    }

    /// Puts a cube of texels at a place in texels.
    fn put(&mut self, cube: &[[u8; 4]], edge: usize, [x, y]: [usize; 2]) {
        let [width, height, _] = self.sides;
        for (row, texels) in cube.chunks_exact(edge).enumerate() {
            let (z, dy) = (row / edge, row % edge);
            let start = (z * height + y + dy) * width + x;
            self.texels[start..start + edge].copy_from_slice(texels);
        }
    }

    /// Means of cubes of eight texels. Values are premultiplied, so means are correct.
    fn halved(&self) -> Self {
        let [width, height, _] = self.sides;
        let sides = self.sides.map(|side| side / 2);
        let mut half = Self::clear(sides);
        for (number, to) in half.texels.iter_mut().enumerate() {
            let at =
                [number % sides[0], number / sides[0] % sides[1], number / sides[0] / sides[1]];
            let corner = |i: usize| {
                let [x, y, z] = [0, 1, 2].map(|axis| 2 * at[axis] + (i >> axis & 1));
                self.texels[(z * height + y) * width + x]
            };
            for (channel, to) in to.iter_mut().enumerate() {
                let sum: u16 = (0..8).map(|i| u16::from(corner(i)[channel])).sum();
                *to = ((sum + 4) / 8) as u8;
            }
        }
        half
    }
}

impl Series {
    /// The names of a level's pictures. Those of coarser levels are Mip-VoG's.
    fn file_name(&self, picture: usize) -> String {
        let name = (self.name)(picture);
        match self.level {
            0 => name,
            level => name.replacen(&format!("_{picture:03}"), &format!("_{level}{picture:02}"), 1),
        }
    }

    /// Adds planes, and writes complete pictures.
    fn push(&mut self, texture: &Texture, folder: &Path, files: &mut ExportFiles) -> Result<()> {
        let [width, height, _] = texture.sides;
        self.waiting.extend_from_slice(&texture.texels);
        let size = PLANES * width * height;
        let full = self.waiting.len() / size;
        let pictures = parallel::map(full, |number| {
            let texels = &self.waiting[number * size..(number + 1) * size];
            picture::png(width, PLANES * height, texels.as_flattened())
        })?;
        for bytes in pictures {
            let path: PathBuf = folder.join(self.file_name(self.pictures));
            files.add(path, &bytes)?;
            self.pictures += 1;
        }
        self.waiting.drain(..full * size);
        Ok(())
    }
}

impl Slices {
    pub(super) fn new(layout: Layout, features: bool, mips: bool) -> Self {
        let names: &[fn(usize) -> String] =
            if features { &[rgba_name, feature_name] } else { &[rgba_name] };
        let levels = if mips { 0..=MIPS } else { 0..=0 };
        let series = |&name: &fn(usize) -> String| {
            let of_level = |level| Series { level, name, waiting: Vec::new(), pictures: 0 };
            levels.clone().map(of_level).collect()
        };
        Self { layout, series: names.iter().map(series).collect() }
    }

    /// Writes the next layer; `blocks` are its blocks in the order of their places.
    pub(super) fn push(
        &mut self,
        blocks: &[BlockTexels],
        folder: &Path,
        files: &mut ExportFiles,
    ) -> Result<()> {
        let [width, height, _] = self.layout.texels();
        let edge = self.layout.edge;
        for (kind, levels) in self.series.iter_mut().enumerate() {
            let mut texture = Texture::clear([width, height, edge]);
            for (number, block) in blocks.iter().enumerate() {
                let [x, y, _] = self.layout.place(number);
                let cube = if kind == 0 { &block.rgba } else { &block.features };
                texture.put(cube, edge, [x * edge, y * edge]);
            }
            for series in levels {
                series.push(&texture, folder, files)?;
                if self.layout.edge >> series.level > 1 {
                    texture = texture.halved();
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_rounded_and_names_are_those_of_the_viewers() {
        let mut texture = Texture::clear([2, 2, 2]);
        texture.texels[3] = [255, 8, 4, 3];
        let half = texture.halved();
        assert_eq!((half.sides, &half.texels[..]), ([1; 3], &[[32, 1, 1, 0]][..]));
        let series = |level| Series { level, name: rgba_name, waiting: Vec::new(), pictures: 0 };
        assert_eq!(series(0).file_name(12), "rgba_012.png");
        assert_eq!(series(2).file_name(1), "rgba_201.png");
    }

    #[test]
    fn a_cube_goes_to_its_place() {
        let mut texture = Texture::clear([4, 2, 2]);
        let cube: Vec<[u8; 4]> = (1..=8).map(|value| [value; 4]).collect();
        texture.put(&cube, 2, [2, 0]);
        let at = |x: usize, y: usize, z: usize| texture.texels[(z * 2 + y) * 4 + x][0];
        assert_eq!([at(2, 0, 0), at(3, 0, 0), at(2, 1, 0), at(3, 1, 1)], [1, 2, 3, 8]);
        assert_eq!(at(0, 0, 0), 0);
    }
}
