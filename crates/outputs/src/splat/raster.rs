//! Pictures of splats, by the rules of 3D Gaussian Splatting (Kerbl et al. 2023), and derivatives
//! of a picture's error.
//!
//! `alpha = min(0.99, opacity * exp(-d^T inverse d / 2))` at a pixel's middle; values below 1/255
//! are not drawn, and a ray ends when its transmittance would fall below 1/10000. Splats are sorted
//! by the depth of their centres, for the whole picture.

use super::project::{ByProjected, Eye, GaussianSplat, Projected, Rules, project};
use super::tile::{self, PixelRow, Place, TILE};
use crate::base::error::Result;
use crate::base::parallel;
use crate::model::camera::Camera;

/// Splats per thread and batch.
const CHUNK: usize = 4096;

/// A picture: colours over the background, row by row.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Colours, without an upper limit.
    pub color: Vec<[f32; 3]>,
}

/// The inputs of a picture.
#[derive(Debug)]
pub(super) struct Drawn {
    pub(super) eye: Eye,
    projected: Vec<Option<Projected>>,
    /// For each tile, row by row: the splats from front to back.
    lists: Vec<Vec<u32>>,
    /// Of each tile.
    rows: Vec<Vec<PixelRow>>,
}

/// A picture of splats from a camera.
///
/// # Errors
/// A request to stop.
pub fn rasterize(
    splats: &[GaussianSplat],
    camera: &Camera,
    background: [f32; 3],
    rules: Rules,
) -> Result<Picture> {
    Ok(draw(splats, camera, rules)?.picture(background))
}

/// Draws a picture, and keeps the data for derivatives.
pub(super) fn draw(splats: &[GaussianSplat], camera: &Camera, rules: Rules) -> Result<Drawn> {
    let eye = Eye::of(camera, rules);
    let chunks: Vec<&[GaussianSplat]> = splats.chunks(CHUNK).collect();
    let projected = parallel::map(chunks.len(), |number| {
        Ok(chunks[number].iter().map(|splat| project(splat, &eye)).collect::<Vec<_>>())
    })?;
    let projected = projected.concat();
    let mut order: Vec<(f32, u32)> = projected
        .iter()
        .zip(0..)
        .filter_map(|(splat, number)| Some(((*splat)?.depth, number)))
        .collect();
    order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let sides = [eye.lens.width, eye.lens.height];
    let [columns, rows] = sides.map(|side| side.div_ceil(TILE));
    let mut lists = vec![Vec::new(); columns * rows];
    for (_, number) in order {
        let Some(splat) = &projected[number as usize] else { continue };
        let [across, down] = [0, 1].map(|axis| {
            let [low, high] = [-1.0, 1.0].map(|by| splat.middle[axis] + by * splat.reach[axis]);
            let end = (high.ceil().max(0.0) as usize).min(sides[axis]).div_ceil(TILE);
            (low.floor().max(0.0) as usize / TILE).min(end)..end
        });
        for row in down {
            for column in across.clone() {
                lists[row * columns + column].push(number);
            }
        }
    }
    let mut drawn = Drawn { eye, projected, lists, rows: Vec::new() };
    drawn.rows = parallel::map(drawn.lists.len(), |number| {
        Ok(tile::draw(&drawn.projected, &drawn.lists[number], drawn.place(number)))
    })?;
    Ok(drawn)
}

impl Drawn {
    /// A tile's place.
    fn place(&self, number: usize) -> Place {
        let size = [self.eye.lens.width, self.eye.lens.height];
        let columns = size[0].div_ceil(TILE);
        let first = [number % columns * TILE, number / columns * TILE];
        Place { first, sides: [0, 1].map(|axis| TILE.min(size[axis] - first[axis])) }
    }

    /// The colours over a background.
    pub(super) fn picture(&self, background: [f32; 3]) -> Picture {
        let width = self.eye.lens.width;
        let mut color = vec![[0.0; 3]; width * self.eye.lens.height];
        for (number, rows) in self.rows.iter().enumerate() {
            let Place { first, sides } = self.place(number);
            for (y, row) in rows.iter().enumerate() {
                let start = (first[1] + y) * width + first[0];
                for (x, color) in color[start..start + sides[0]].iter_mut().enumerate() {
                    *color = [0, 1, 2]
                        .map(|channel| row.color[channel][x] + row.passes[x] * background[channel]);
                }
            }
        }
        Picture { color }
    }

    /// Derivatives of an error by each splat's projection, from those by the picture's colours.
    /// Invisible splats have none.
    pub(super) fn by_projected(
        &self,
        by_picture: &[[f32; 3]],
        background: [f32; 3],
    ) -> Result<Vec<Option<ByProjected>>> {
        let width = self.eye.lens.width;
        let of_tiles = parallel::map(self.lists.len(), |number| {
            let place = self.place(number);
            let mut by_pixels = [[[0.0; TILE]; 3]; TILE];
            for (y, row) in by_pixels.iter_mut().enumerate().take(place.sides[1]) {
                let start = (place.first[1] + y) * width + place.first[0];
                for (x, by) in by_picture[start..start + place.sides[0]].iter().enumerate() {
                    (0..3).for_each(|channel| row[channel][x] = by[channel]);
                }
            }
            let (list, rows) = (&self.lists[number], &self.rows[number]);
            Ok(tile::derivatives(&self.projected, list, place, rows, &by_pixels, background))
        })?;
        // In the order of tiles, independent of threads.
        let mut sums: Vec<Option<ByProjected>> = vec![None; self.projected.len()];
        for (list, of_tile) in self.lists.iter().zip(of_tiles) {
            for (splat, by) in list.iter().zip(of_tile) {
                let Some(by) = by else { continue };
                sums[*splat as usize].get_or_insert_default().add(&by);
            }
        }
        Ok(sums)
    }

    /// Raises weights to the largest share of a pixel's light that each splat has.
    pub(super) fn weights(&self, weights: &mut [f32]) -> Result<()> {
        let of_tiles = parallel::map(self.lists.len(), |number| {
            let (list, rows) = (&self.lists[number], &self.rows[number]);
            Ok(tile::weights(&self.projected, list, self.place(number), rows))
        })?;
        for (list, own) in self.lists.iter().zip(of_tiles) {
            for (splat, own) in list.iter().zip(own) {
                let weight = &mut weights[*splat as usize];
                *weight = weight.max(own);
            }
        }
        Ok(())
    }
}
