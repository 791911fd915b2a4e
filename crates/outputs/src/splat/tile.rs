//! Tiles of a picture. A row of a tile's pixels is one vector: loops over its pixels have a fixed
//! count and no branch.

use multiversion::multiversion;

use super::project::{ByProjected, Projected};
use crate::model::activate::lanes;

/// Pixels along a side of a tile.
pub(super) const TILE: usize = 16;
/// Opacities are at most this.
const LARGEST: f32 = 0.99;
/// A ray ends when its transmittance would fall below this.
const OPAQUE: f32 = 1e-4;
/// Number of splats between checks for rows whose rays have all ended.
const LOOK: usize = 16;

/// A number of each pixel of a row.
type Lanes = [f32; TILE];

/// A row of pixels: the accumulated splats.
#[derive(Debug, Clone, Copy)]
pub(super) struct PixelRow {
    /// Without the background.
    pub(super) color: [Lanes; 3],
    /// The final transmittance.
    pub(super) passes: Lanes,
    /// Splats of the tile's list up to the last one that was drawn.
    ends: [u32; TILE],
}

const NOTHING: PixelRow =
    PixelRow { color: [[0.0; TILE]; 3], passes: [1.0; TILE], ends: [0; TILE] };

/// A tile's place in the picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Its first pixel.
    pub(super) first: [usize; 2],
    /// Its pixels along each axis, up to [`TILE`].
    pub(super) sides: [usize; 2],
}

impl Place {
    /// The tile's rows that a splat reaches.
    #[inline(always)]
    fn rows(&self, splat: &Projected) -> std::ops::Range<usize> {
        let top = self.first[1] as f32;
        let [low, high] = [-1.0, 1.0].map(|by| splat.middle[1] + by * splat.reach[1] - top);
        let end = (high.ceil().max(0.0) as usize).min(self.sides[1]);
        (low.floor().max(0.0) as usize).min(end)..end
    }

    /// Offsets of a row's pixels from a splat's middle; none if the splat misses the row.
    #[inline(always)]
    fn offsets(&self, splat: &Projected, row: usize) -> Option<(Lanes, f32)> {
        let dy = (self.first[1] + row) as f32 + 0.5 - splat.middle[1];
        let [xx, xy, yy] = splat.inverse;
        // The least of `xx dx^2 + 2 xy dx dy + yy dy^2` along the row.
        if dy * dy * (yy - xy * xy / xx) > splat.drawn {
            return None;
        }
        let left = self.first[0] as f32 + 0.5 - splat.middle[0];
        Some((std::array::from_fn(|x| left + x as f32), dy))
    }
}

/// The exponent's square at an offset.
#[inline(always)]
fn square(splat: &Projected, dx: f32, dy: f32) -> f32 {
    let [xx, xy, yy] = splat.inverse;
    xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy
}

/// Draws splats from front to back.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub(super) fn draw(projected: &[Option<Projected>], list: &[u32], place: Place) -> Vec<PixelRow> {
    let mut rows = vec![NOTHING; place.sides[1]];
    // 1 where a ray continues.
    let mut open = vec![[0.0f32; TILE]; place.sides[1]];
    open.iter_mut().for_each(|open| open[..place.sides[0]].fill(1.0));
    let mut is_open = [true; TILE];
    for (number, splat) in list.iter().enumerate() {
        if number % LOOK == 0 {
            for (is_open, open) in is_open.iter_mut().zip(&open) {
                *is_open = open.iter().sum::<f32>() > 0.0;
            }
            if !is_open[..place.sides[1]].contains(&true) {
                break;
            }
        }
        let Some(splat) = &projected[*splat as usize] else { continue };
        for y in place.rows(splat) {
            if !is_open[y] {
                continue;
            }
            let Some((dx, dy)) = place.offsets(splat, y) else { continue };
            let (row, open) = (&mut rows[y], &mut open[y]);
            for x in 0..TILE {
                let square = square(splat, dx[x], dy);
                let alpha = (splat.opacity * lanes::exp(-0.5 * square)).min(LARGEST);
                let next = row.passes[x] * (1.0 - alpha);
                let meets = square <= splat.drawn && open[x] > 0.0;
                let shows = meets && next >= OPAQUE;
                open[x] = if meets && next < OPAQUE { 0.0 } else { open[x] };
                let weight = if shows { alpha * row.passes[x] } else { 0.0 };
                for channel in 0..3 {
                    row.color[channel][x] += weight * splat.color[channel];
                }
                row.passes[x] = if shows { next } else { row.passes[x] };
                row.ends[x] = if shows { number as u32 + 1 } else { row.ends[x] };
            }
        }
    }
    rows
}

/// The largest share of a pixel's light that each splat of a list has.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub(super) fn weights(
    projected: &[Option<Projected>],
    list: &[u32],
    place: Place,
    rows: &[PixelRow],
) -> Vec<f32> {
    let mut passes = [[1.0f32; TILE]; TILE];
    let mut out = vec![0.0; list.len()];
    let end = last(rows);
    for (number, (splat, out)) in list.iter().zip(&mut out).enumerate().take(end) {
        let Some(splat) = &projected[*splat as usize] else { continue };
        let mut most = [0.0f32; TILE];
        for y in place.rows(splat) {
            let Some((dx, dy)) = place.offsets(splat, y) else { continue };
            let (passes, ends) = (&mut passes[y], &rows[y].ends);
            for x in 0..TILE {
                let square = square(splat, dx[x], dy);
                let alpha = (splat.opacity * lanes::exp(-0.5 * square)).min(LARGEST);
                let shows = square <= splat.drawn && (number as u32) < ends[x];
                let alpha = if shows { alpha } else { 0.0 };
                most[x] = most[x].max(alpha * passes[x]);
                passes[x] *= 1.0 - alpha;
            }
        }
        *out = most.into_iter().fold(0.0, f32::max);
    }
    out
}

/// Splats of a list up to the last visible one.
fn last(rows: &[PixelRow]) -> usize {
    rows.iter().flat_map(|row| row.ends).max().unwrap_or(0) as usize
}

/// Sums over pixels, a lane for each column.
struct Sums {
    color: [Lanes; 3],
    opacity: Lanes,
    middle: [Lanes; 2],
    covariance: [Lanes; 3],
    /// Above 0 if any pixel is visible.
    shows: Lanes,
}

impl Sums {
    /// The sums over all columns, from left to right; none if nothing is visible.
    fn total(&self) -> Option<ByProjected> {
        let sum = |lanes: &Lanes| lanes.iter().sum::<f32>();
        (sum(&self.shows) > 0.0).then(|| ByProjected {
            middle: self.middle.each_ref().map(sum),
            covariance: self.covariance.each_ref().map(sum),
            opacity: sum(&self.opacity),
            color: self.color.each_ref().map(sum),
        })
    }
}

/// Derivatives of an error by the projections of a list's splats, from those by the tile's colours.
/// Splats are taken from back to front; `background` is behind them.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub(super) fn derivatives(
    projected: &[Option<Projected>],
    list: &[u32],
    place: Place,
    rows: &[PixelRow],
    by_pixels: &[[Lanes; 3]],
    background: [f32; 3],
) -> Vec<Option<ByProjected>> {
    let mut passes = [[1.0; TILE]; TILE];
    passes.iter_mut().zip(rows).for_each(|(passes, row)| *passes = row.passes);
    // The light from behind the current splat.
    let mut behind = [background.map(|channel| [channel; TILE]); TILE];
    let mut out = vec![None; list.len()];
    for (number, splat) in list.iter().enumerate().take(last(rows)).rev() {
        let Some(splat) = &projected[*splat as usize] else { continue };
        let mut sums = Sums {
            color: [[0.0; TILE]; 3],
            opacity: [0.0; TILE],
            middle: [[0.0; TILE]; 2],
            covariance: [[0.0; TILE]; 3],
            shows: [0.0; TILE],
        };
        for y in place.rows(splat) {
            let Some((dx, dy)) = place.offsets(splat, y) else { continue };
            let (passes, behind) = (&mut passes[y], &mut behind[y]);
            let (ends, by_pixel) = (&rows[y].ends, &by_pixels[y]);
            let [xx, xy, yy] = splat.inverse;
            for x in 0..TILE {
                let square = square(splat, dx[x], dy);
                let gaussian = lanes::exp(-0.5 * square);
                let opacity = splat.opacity * gaussian;
                let shows = square <= splat.drawn && (number as u32) < ends[x];
                let alpha = if shows { opacity.min(LARGEST) } else { 0.0 };
                let before = passes[x] / (1.0 - alpha);
                let mut by_alpha = 0.0;
                for channel in 0..3 {
                    let by = by_pixel[channel][x] * before;
                    sums.color[channel][x] += alpha * by;
                    let gain = splat.color[channel] - behind[channel][x];
                    by_alpha += by * gain;
                    behind[channel][x] += alpha * gain;
                }
                passes[x] = before;
                // Clamped opacity has no derivative.
                let by_alpha = if shows && opacity < LARGEST { by_alpha } else { 0.0 };
                let by_exponent = by_alpha * alpha;
                let by = [xx * dx[x] + xy * dy, xy * dx[x] + yy * dy];
                sums.opacity[x] += by_alpha * gaussian;
                sums.middle[0][x] += by_exponent * by[0];
                sums.middle[1][x] += by_exponent * by[1];
                sums.covariance[0][x] += 0.5 * by_exponent * by[0] * by[0];
                sums.covariance[1][x] += 0.5 * by_exponent * by[0] * by[1];
                sums.covariance[2][x] += 0.5 * by_exponent * by[1] * by[1];
                sums.shows[x] = if shows { 1.0 } else { sums.shows[x] };
            }
        }
        out[number] = sums.total();
    }
    out
}
