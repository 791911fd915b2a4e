//! Pictures of splats, by the rules of 3D Gaussian Splatting (Kerbl et al. 2023), and derivatives
//! of a picture's error.
//!
//! `alpha = min(0.99, opacity * exp(-d^T inverse d / 2))` at a pixel's middle; below 1/255 nothing is
//! drawn, and a ray ends where less than 1/10000 would pass. Splats are sorted by the depth of their
//! centres, for the whole picture.

use multiversion::multiversion;

use super::project::{ByProjected, Eye, FAINT, GaussianSplat, Projected, by_parameters, project};
use crate::base::error::Result;
use crate::base::parallel;
use crate::model::activate::lanes;
use crate::model::camera::Camera;

/// Pixels along a side of a tile.
const TILE: usize = 16;
/// Pixels of a tile.
const PIXELS: usize = TILE * TILE;
const LARGEST: f32 = 0.99;
const OPAQUE: f32 = 1e-4;
/// Splats that a thread projects at once.
const CHUNK: usize = 4096;

/// A picture: colours over the background, row by row.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Colours, not limited above.
    pub color: Vec<[f32; 3]>,
    /// What passes all splats.
    pub transmittance: Vec<f32>,
}

/// What a picture was made of.
#[derive(Debug)]
pub(super) struct Drawn {
    eye: Eye,
    projected: Vec<Option<Projected>>,
    /// Of each tile, row by row: the splats from front to back.
    tiles: Vec<Vec<u32>>,
    columns: usize,
    pub(super) picture: Picture,
    /// Of each tile's pixels: splats of its list up to the last one that was drawn.
    ends: Vec<Vec<u32>>,
}

/// A picture of splats from a camera.
///
/// # Errors
/// A request to stop.
pub fn rasterize(
    splats: &[GaussianSplat],
    camera: &Camera,
    background: [f32; 3],
) -> Result<Picture> {
    Ok(draw(splats, camera, background)?.picture)
}

/// The box of a tile's pixels that a splat reaches.
#[inline(always)]
fn reached(splat: &Projected, first: [usize; 2], size: [usize; 2]) -> [[usize; 2]; 2] {
    let mut ranges = [[0; 2]; 2];
    for axis in 0..2 {
        let (low, high) =
            (splat.middle[axis] - splat.reach[axis], splat.middle[axis] + splat.reach[axis]);
        let from = low.floor().max(first[axis] as f32) as usize;
        let to = (high.ceil().max(0.0) as usize).min(first[axis] + size[axis]);
        ranges[axis] = [from, to.max(from)];
    }
    ranges
}

/// A splat's opacities along a part of a row of pixels.
struct Row {
    /// The first pixel, and the one behind the last.
    from: usize,
    to: usize,
    /// From the splat's middle to that of the first pixel.
    offset: [f32; 2],
    /// The Gaussian at each pixel.
    gaussians: [f32; TILE],
}

impl Row {
    /// The part of row `y`, between two columns of a tile, where something is drawn.
    #[inline(always)]
    fn of(splat: &Projected, y: usize, [x0, x1]: [usize; 2]) -> Self {
        let dy = y as f32 + 0.5 - splat.middle[1];
        let [xx, xy, yy] = splat.inverse;
        // xx dx^2 + 2 xy dy dx + yy dy^2 <= drawn
        let half = xy * dy / xx;
        let root = half * half - (yy * dy * dy - splat.drawn) / xx;
        if root <= 0.0 {
            return Self { from: x0, to: x0, offset: [0.0; 2], gaussians: [0.0; TILE] };
        }
        let (middle, reach) = (splat.middle[0] - 0.5 - half, root.sqrt());
        let from = ((middle - reach).ceil().max(0.0) as usize).clamp(x0, x1);
        let to = ((middle + reach + 1.0).floor().max(0.0) as usize).clamp(from, x1);
        let offset = [from as f32 + 0.5 - splat.middle[0], dy];
        let mut gaussians = [0.0; TILE];
        // Of a whole tile's width: a fixed count becomes vectors.
        for (number, gaussian) in gaussians.iter_mut().enumerate() {
            let dx = offset[0] + number as f32;
            *gaussian = lanes::exp(-0.5 * (xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy));
        }
        Self { from, to, offset, gaussians }
    }
}

/// The opacity where a splat has a Gaussian; none where nothing is drawn.
#[inline(always)]
fn opacity_of(splat: &Projected, gaussian: f32) -> Option<f32> {
    let alpha = (splat.opacity * gaussian).min(LARGEST);
    (alpha >= FAINT).then_some(alpha)
}

/// Draws a picture, and keeps what derivatives need.
pub(super) fn draw(
    splats: &[GaussianSplat],
    camera: &Camera,
    background: [f32; 3],
) -> Result<Drawn> {
    let eye = Eye::of(camera);
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
    let (width, height) = (camera.lens.width, camera.lens.height);
    let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
    let mut tiles = vec![Vec::new(); columns * rows];
    for (_, number) in order {
        let Some(splat) = &projected[number as usize] else { continue };
        let [[left, right], [top, bottom]] = reached(splat, [0, 0], [width, height]);
        for row in top / TILE..bottom.div_ceil(TILE) {
            for column in left / TILE..right.div_ceil(TILE) {
                tiles[row * columns + column].push(number);
            }
        }
    }
    let drawn = parallel::map(tiles.len(), |tile| {
        let first = [tile % columns * TILE, tile / columns * TILE];
        Ok(draw_tile(&projected, &tiles[tile], first, [width, height], background))
    })?;
    let mut picture =
        Picture { color: vec![[0.0; 3]; width * height], transmittance: vec![1.0; width * height] };
    let mut ends = Vec::with_capacity(drawn.len());
    for (tile, (color, passes, end)) in drawn.into_iter().enumerate() {
        let (x, y) = (tile % columns * TILE, tile / columns * TILE);
        let count = TILE.min(width - x);
        for row in 0..TILE.min(height - y) {
            let (to, from) = ((y + row) * width + x, row * TILE);
            picture.color[to..to + count].copy_from_slice(&color[from..from + count]);
            picture.transmittance[to..to + count].copy_from_slice(&passes[from..from + count]);
        }
        ends.push(end);
    }
    Ok(Drawn { eye, projected, tiles, columns, picture, ends })
}

type Tile = (Vec<[f32; 3]>, Vec<f32>, Vec<u32>);

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn draw_tile(
    projected: &[Option<Projected>],
    list: &[u32],
    first: [usize; 2],
    size: [usize; 2],
    background: [f32; 3],
) -> Tile {
    let (mut color, mut passes) = (vec![[0.0f32; 3]; PIXELS], vec![1.0f32; PIXELS]);
    let (mut ends, mut done) = (vec![0u32; PIXELS], vec![false; PIXELS]);
    let sides = [0, 1].map(|axis| TILE.min(size[axis] - first[axis]));
    let mut left = sides[0] * sides[1];
    for (number, splat) in list.iter().enumerate() {
        if left == 0 {
            break;
        }
        let Some(splat) = &projected[*splat as usize] else { continue };
        let [columns, [y0, y1]] = reached(splat, first, sides);
        for y in y0..y1 {
            let row = Row::of(splat, y, columns);
            for (x, gaussian) in (row.from..row.to).zip(row.gaussians) {
                let pixel = (y - first[1]) * TILE + x - first[0];
                if done[pixel] {
                    continue;
                }
                let Some(alpha) = opacity_of(splat, gaussian) else { continue };
                let next = passes[pixel] * (1.0 - alpha);
                if next < OPAQUE {
                    done[pixel] = true;
                    left -= 1;
                    continue;
                }
                let weight = alpha * passes[pixel];
                for (sum, own) in color[pixel].iter_mut().zip(splat.color) {
                    *sum += weight * own;
                }
                passes[pixel] = next;
                ends[pixel] = number as u32 + 1;
            }
        }
    }
    for (color, passes) in color.iter_mut().zip(&passes) {
        color.iter_mut().zip(background).for_each(|(sum, behind)| *sum += passes * behind);
    }
    (color, passes, ends)
}

impl Drawn {
    /// Derivatives of an error by each splat's numbers, of those by the picture's colours. Splats
    /// that do not show have none.
    pub(super) fn by_splats(
        &self,
        splats: &[GaussianSplat],
        by_picture: &[[f32; 3]],
        background: [f32; 3],
    ) -> Result<Vec<Option<GaussianSplat>>> {
        let of_tiles = parallel::map(self.tiles.len(), |tile| {
            Ok(by_tile(self, tile, by_picture, background))
        })?;
        // In the order of tiles, whatever thread was first.
        let mut sums: Vec<Option<ByProjected>> = vec![None; splats.len()];
        for (list, of_tile) in self.tiles.iter().zip(of_tiles) {
            for (splat, by) in list.iter().zip(of_tile) {
                let Some(by) = by else { continue };
                let sum = sums[*splat as usize].get_or_insert_default();
                sum.opacity += by.opacity;
                sum.middle.iter_mut().zip(by.middle).for_each(|(sum, own)| *sum += own);
                sum.covariance.iter_mut().zip(by.covariance).for_each(|(sum, own)| *sum += own);
                sum.color.iter_mut().zip(by.color).for_each(|(sum, own)| *sum += own);
            }
        }
        let chunks: Vec<_> = splats.chunks(CHUNK).zip(sums.chunks(CHUNK)).collect();
        let out = parallel::map(chunks.len(), |number| {
            let (splats, sums) = chunks[number];
            let by = splats.iter().zip(sums);
            let by = by.map(|(splat, by)| by.map(|by| by_parameters(splat, &self.eye, &by)));
            Ok(by.collect::<Vec<_>>())
        })?;
        Ok(out.concat())
    }

    /// Raises weights to the largest share of a pixel's light that each splat has.
    pub(super) fn weights(&self, weights: &mut [f32]) -> Result<()> {
        let of_tiles = parallel::map(self.tiles.len(), |tile| Ok(self.weights_of(tile)))?;
        for (list, own) in self.tiles.iter().zip(of_tiles) {
            for (splat, own) in list.iter().zip(own) {
                let weight = &mut weights[*splat as usize];
                *weight = weight.max(own);
            }
        }
        Ok(())
    }

    /// Those of a tile's splats.
    fn weights_of(&self, tile: usize) -> Vec<f32> {
        let (first, sides) = self.sides(tile);
        let (mut passes, ends) = ([1.0f32; PIXELS], &self.ends[tile]);
        let weight = |(number, splat): (usize, &u32)| {
            let mut most = 0.0f32;
            let Some(own) = &self.projected[*splat as usize] else { return most };
            let [columns, [y0, y1]] = reached(own, first, sides);
            for y in y0..y1 {
                let row = Row::of(own, y, columns);
                for (x, gaussian) in (row.from..row.to).zip(row.gaussians) {
                    let pixel = (y - first[1]) * TILE + x - first[0];
                    if number as u32 >= ends[pixel] {
                        continue;
                    }
                    let Some(alpha) = opacity_of(own, gaussian) else { continue };
                    most = most.max(alpha * passes[pixel]);
                    passes[pixel] *= 1.0 - alpha;
                }
            }
            most
        };
        self.tiles[tile].iter().enumerate().map(weight).collect()
    }

    fn sides(&self, tile: usize) -> ([usize; 2], [usize; 2]) {
        let first = [tile % self.columns * TILE, tile / self.columns * TILE];
        let size = [self.eye.lens.width, self.eye.lens.height];
        (first, [0, 1].map(|axis| TILE.min(size[axis] - first[axis])))
    }
}

/// Derivatives by the projections of a tile's splats, from back to front.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn by_tile(
    drawn: &Drawn,
    tile: usize,
    by_picture: &[[f32; 3]],
    background: [f32; 3],
) -> Vec<Option<ByProjected>> {
    let (first, sides) = drawn.sides(tile);
    let (list, ends) = (&drawn.tiles[tile], &drawn.ends[tile]);
    let width = drawn.eye.lens.width;
    let mut passes = [1.0f32; PIXELS];
    // What comes from behind the splat at hand.
    let mut behind = [background; PIXELS];
    for (pixel, passes) in passes.iter_mut().enumerate() {
        let (x, y) = (pixel % TILE, pixel / TILE);
        if x < sides[0] && y < sides[1] {
            *passes = drawn.picture.transmittance[(first[1] + y) * width + first[0] + x];
        }
    }
    let mut out = vec![None; list.len()];
    for (number, splat) in list.iter().enumerate().rev() {
        let Some(splat) = &drawn.projected[*splat as usize] else { continue };
        let ([columns, [y0, y1]], mut shows) = (reached(splat, first, sides), false);
        let mut sum = ByProjected::default();
        for y in y0..y1 {
            let row = Row::of(splat, y, columns);
            for (x, gaussian) in (row.from..row.to).zip(row.gaussians) {
                let pixel = (y - first[1]) * TILE + x - first[0];
                if number as u32 >= ends[pixel] {
                    continue;
                }
                let Some(alpha) = opacity_of(splat, gaussian) else { continue };
                shows = true;
                let before = passes[pixel] / (1.0 - alpha);
                let wanted = by_picture[y * width + x];
                let by_alpha = sum.add_color(splat, [alpha, before], wanted, &mut behind[pixel]);
                passes[pixel] = before;
                // At the limit of opacity nothing changes it.
                if splat.opacity * gaussian < LARGEST {
                    let dx = row.offset[0] + (x - row.from) as f32;
                    let offset = [dx, row.offset[1]];
                    sum.add_opacity(splat, offset, by_alpha * gaussian, by_alpha * alpha);
                }
            }
        }
        out[number] = shows.then_some(sum);
    }
    out
}
