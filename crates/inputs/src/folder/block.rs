//! The texels of one block, including its apron.

use super::texels::Texel;
use crate::snerg::layout::{FAINT, SKIPPED_CUBE};
use crate::sparse::whole;

/// Texels that are not zeros, found by their places.
#[derive(Debug, Clone)]
pub struct Block {
    edge: usize,
    /// A bit for each texel, x fastest, set where it is kept.
    words: Vec<u64>,
    /// Texels that are kept before each word.
    ranks: Vec<u32>,
    /// Sums of opacities of the cubes for skipping, x fastest.
    sums: Vec<u32>,
    texels: Vec<Texel>,
}

impl Block {
    /// An empty block, `edge` texels per side.
    pub(super) fn new(edge: usize) -> Self {
        let (words, cubes) = (edge.pow(3).div_ceil(64), edge.div_ceil(SKIPPED_CUBE).pow(3));
        let (words, ranks) = (vec![0; words], vec![0; words]);
        Self { edge, words, ranks, sums: vec![0; cubes], texels: Vec::new() }
    }

    /// Adds a texel behind all others, x fastest.
    pub(super) fn push(&mut self, [x, y, z]: [usize; 3], texel: Texel) {
        let [_, _, _, opacity, ..] = texel;
        let (at, cubes) = ((z * self.edge + y) * self.edge + x, self.edge.div_ceil(SKIPPED_CUBE));
        if let Some(word) = self.words.get_mut(at / 64) {
            *word |= 1 << (at % 64);
            self.texels.push(texel);
        }
        let [x, y, z] = [x, y, z].map(|at| at / SKIPPED_CUBE);
        if let Some(sum) = self.sums.get_mut((z * cubes + y) * cubes + x) {
            *sum += u32::from(opacity);
        }
    }

    /// Counts the texels, after the last one.
    pub(super) fn finish(&mut self) {
        let mut before = 0;
        for (rank, word) in self.ranks.iter_mut().zip(&self.words) {
            *rank = before;
            before += word.count_ones();
        }
        self.texels.shrink_to_fit();
    }

    /// Bytes that it takes.
    pub(super) fn bytes(&self) -> u64 {
        (self.words.len() * 12 + self.sums.len() * 4 + size_of_val(self.texels.as_slice())) as u64
    }

    /// A texel; zeros where none was added.
    #[inline]
    pub fn texel(&self, [x, y, z]: [usize; 3]) -> Texel {
        let at = (z * self.edge + y) * self.edge + x;
        let (Some(word), Some(rank)) = (self.words.get(at / 64), self.ranks.get(at / 64)) else {
            return [0; 8];
        };
        let (bit, below) = (1 << (at % 64), word & ((1u64 << (at % 64)) - 1));
        if word & bit == 0 {
            return [0; 8];
        }
        let number = *rank as usize + below.count_ones() as usize;
        self.texels.get(number).copied().unwrap_or([0; 8])
    }

    /// The codes at a position in texels, 0 being the middle of the first one, interpolated.
    #[inline]
    pub fn interpolate(&self, at: [f64; 3]) -> [f64; 8] {
        let [xs, ys, zs] = at.map(|at| {
            let low = whole(at).min(self.edge - 2);
            [(low, 1.0 - (at - low as f64)), (low + 1, at - low as f64)]
        });
        let mut sums = [0.0; 8];
        for (z, of_z) in zs {
            for (y, of_y) in ys {
                for (x, of_x) in xs {
                    let weight = of_x * of_y * of_z;
                    let terms = sums.iter_mut().zip(self.texel([x, y, z]));
                    terms.for_each(|(sum, code)| *sum += weight * f64::from(code));
                }
            }
        }
        sums
    }

    /// True if the mean opacity of the cube around a texel is more than faint.
    pub fn shows(&self, texel: [usize; 3]) -> bool {
        let cubes = self.edge.div_ceil(SKIPPED_CUBE);
        let [x, y, z] = texel.map(|at| at / SKIPPED_CUBE);
        let sum = self.sums.get((z * cubes + y) * cubes + x).copied().unwrap_or(0);
        f64::from(sum) >= 255.0 * FAINT * SKIPPED_CUBE.pow(3) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_are_found_where_they_were_put() {
        let mut block = Block::new(8);
        let mut texels = Vec::new();
        for at in (0..512usize).filter(|at| at % 7 == 3) {
            let place = [at % 8, at / 8 % 8, at / 64];
            let texel = [1, 2, 3, (at % 250 + 1) as u8, 5, 6, 7, 8];
            block.push(place, texel);
            texels.push((place, texel));
        }
        block.finish();
        assert!(texels.iter().all(|&(place, texel)| block.texel(place) == texel));
        assert_eq!(block.texel([4, 0, 0]), [0; 8]);
        assert!(block.shows([0, 0, 0]));
        let mut faint = Block::new(8);
        faint.push([1, 1, 1], [0, 0, 0, 31, 0, 0, 0, 0]);
        assert!(!faint.shows([0, 0, 0]), "31 in 64 texels are less than half a code");
    }
}
