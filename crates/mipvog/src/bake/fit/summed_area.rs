//! Mean colours of windows of a picture, each from four sums (summed-area table, Crow 1984).

/// Colours of 0 to 1 are summed as integers up to this one, which f32 represents exactly.
const FINEST_UNIT: usize = 1 << 20;

/// A picture's colours, summed over the pixels above and left of each corner of a pixel.
#[derive(Debug)]
pub struct SummedArea {
    /// Corners in a row: one more than pixels.
    corners: usize,
    /// Modulo `2^32`, as are their differences; the sum of one window is smaller.
    sums: Vec<[u32; 3]>,
    /// A colour of 1.
    unit: usize,
}

impl SummedArea {
    /// Of a picture's rows of `width` colours. Windows will have at most `largest` pixels.
    pub fn new(colors: &[[f32; 3]], width: usize, largest: usize) -> Self {
        let unit = (u32::MAX as usize / largest.max(1)).clamp(1, FINEST_UNIT);
        let corners = width + 1;
        let mut sums = vec![[0u32; 3]; corners * (colors.len() / width + 1)];
        for (row, colors) in colors.chunks_exact(width).enumerate() {
            let mut along = [0u32; 3];
            for (column, color) in colors.iter().enumerate() {
                let above = sums[row * corners + column + 1];
                let sum = &mut sums[(row + 1) * corners + column + 1];
                for channel in 0..3 {
                    let value = (color[channel].clamp(0.0, 1.0) * unit as f32).round_ties_even();
                    along[channel] = along[channel].wrapping_add(value as u32);
                    sum[channel] = above[channel].wrapping_add(along[channel]);
                }
            }
        }
        Self { corners, sums, unit }
    }

    /// The mean colour of `side * side` pixels from column `x` and row `y` on.
    pub fn mean(&self, x: usize, y: usize, side: usize) -> [f32; 3] {
        let at = |x: usize, y: usize| self.sums[y * self.corners + x];
        let [none, right] = [at(x, y), at(x + side, y)];
        let [below, both] = [at(x, y + side), at(x + side, y + side)];
        let whole = (side * side * self.unit) as f64;
        [0, 1, 2].map(|channel| {
            let upper = right[channel].wrapping_sub(none[channel]);
            let sum = both[channel].wrapping_sub(below[channel]).wrapping_sub(upper);
            (f64::from(sum) / whole) as f32
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Colours whose sums pass `2^32` many times, the brightest of all among them.
    #[test]
    fn means_are_those_of_the_pixels() {
        let (width, height) = (67, 45);
        let color = |at: usize| match at % 3 {
            0 => [1.0; 3],
            _ => [0, 1, 2].map(|channel| libm::sinf((at + channel) as f32).abs()),
        };
        let colors: Vec<[f32; 3]> = (0..width * height).map(color).collect();
        let sums = SummedArea::new(&colors, width, 45 * 45);
        for (x, y, side) in [(0, 0, 45), (22, 0, 45), (66, 44, 1), (3, 7, 2), (40, 20, 24)] {
            let mean = sums.mean(x, y, side);
            for channel in 0..3 {
                let row = |row: usize| &colors[row * width + x..][..side];
                let window = (y..y + side).flat_map(row).map(|color| f64::from(color[channel]));
                let expected = window.sum::<f64>() / (side * side) as f64;
                let off = (f64::from(mean[channel]) - expected).abs();
                assert!(off < 1e-6, "{x}, {y}, {side}: {} for {expected}", mean[channel]);
            }
        }
    }
}
