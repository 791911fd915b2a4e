//! Pixels of target pictures, sorted by the position that they show.
//!
//! A step takes one ray from each of many equal parts of this order. So its rays are spread evenly
//! over the visible surface, which lowers the variance. Consecutive rays read nearby nodes, which
//! are still in the processor's caches.

use glam::DVec3;

use crate::model::grid::Bounds;

/// The code of a pixel that shows nothing.
pub const EMPTY: u32 = u32::MAX;
/// Bits of a place's code along each axis.
const BITS: u32 = 10;

/// Pixels that show anything.
#[derive(Debug)]
pub struct MortonPixels {
    /// `[picture, pixel]`.
    pixels: Vec<[u32; 2]>,
}

impl MortonPixels {
    /// Bytes of a pixel while pixels are collected.
    pub const BYTES: usize = size_of::<[u32; 3]>();

    /// Of pixels `[code of the place, picture, pixel]`.
    pub fn new(mut pixels: Vec<[u32; 3]>) -> Self {
        pixels.sort_unstable();
        Self { pixels: pixels.into_iter().map(|[_, picture, pixel]| [picture, pixel]).collect() }
    }

    /// True without pixels.
    pub fn is_empty(&self) -> bool {
        self.pixels.is_empty()
    }

    /// A pixel from one of `parts` equal parts of the order, which must not be empty.
    pub fn draw(&self, random: u64, [part, parts]: [usize; 2]) -> [u32; 2] {
        let end = |part: usize| (part as u64 * self.pixels.len() as u64 / parts as u64) as usize;
        let (start, length) = (end(part), (end(part + 1) - end(part)).max(1));
        self.pixels[start + (random % length as u64) as usize]
    }
}

/// The number of a place along a space-filling curve (Z-order, Morton 1966): places with close
/// numbers are mostly close to each other.
pub fn code(bounds: &Bounds, place: DVec3) -> u32 {
    let extent = bounds.extent();
    let place = place.to_array();
    let along = |axis: usize| {
        let share = (place[axis] - f64::from(bounds.min[axis])) / extent[axis];
        (share.clamp(0.0, 1.0) * f64::from((1 << BITS) - 1)) as u32
    };
    let bit =
        |bit: u32| (0..3).map(move |axis| (along(axis) >> bit & 1) << (3 * bit + axis as u32));
    (0..BITS).flat_map(bit).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_the_order_hold_all_pixels_once() {
        let shown = MortonPixels::new((0..10).rev().map(|i| [i, 0, 10 * i]).collect());
        let drawn = |part: usize, parts: usize| -> Vec<u32> {
            let mut pixels: Vec<u32> =
                (0..64).map(|random| shown.draw(random, [part, parts])[1]).collect();
            pixels.sort_unstable();
            pixels.dedup();
            pixels
        };
        assert_eq!(drawn(0, 1), (0..10).map(|i| 10 * i).collect::<Vec<_>>());
        let thirds: Vec<u32> = (0..3).flat_map(|part| drawn(part, 3)).collect();
        assert_eq!(thirds, drawn(0, 1));
        // With more parts than pixels, each part draws its nearest pixel.
        let of_forty: Vec<u32> = (0..40).flat_map(|part| drawn(part, 40)).collect();
        assert_eq!(of_forty, (0..40).map(|part| part / 4 * 10).collect::<Vec<_>>());
    }

    #[test]
    fn codes_follow_the_octants_of_the_box() {
        let bounds = Bounds { min: [-1.0, 0.0, 2.0], max: [1.0, 4.0, 3.0] };
        let octant = |x: f64, y: f64, z: f64| code(&bounds, DVec3::new(x, y, z)) >> 27;
        for x in 0..2u32 {
            for y in 0..2 {
                for z in 0..2 {
                    let share = |up: u32| 0.1 + 0.8 * f64::from(up);
                    let place = [2.0 * share(x) - 1.0, 4.0 * share(y), 2.0 + share(z)];
                    assert_eq!(octant(place[0], place[1], place[2]), x | y << 1 | z << 2);
                }
            }
        }
        // Places outside the box are clamped to its faces.
        assert_eq!(octant(-9.0, 9.0, 9.0), 6);
        assert_eq!(code(&bounds, DVec3::new(9.0, 9.0, 9.0)), (1 << (3 * BITS)) - 1);
    }
}
