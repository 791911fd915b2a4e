//! Sums of products of the terms of predictions, for fitting weights.

use multiversion::multiversion;

use super::code_word::{Code, Sum};
use super::predict::{Channel, WEIGHTS, beyond, for_each_node, others, terms};

/// Size of a lower triangle with a row for each weight and one for the predicted value.
pub const PRODUCTS: usize = (WEIGHTS + 1) * (WEIGHTS + 2) / 2;
/// One in this many nodes is used to fit the weights.
pub const SAMPLED: usize = 5;

/// Sums over the live nodes of each block.
#[derive(Debug, Clone)]
pub struct Sums<const L: usize> {
    /// Sum of the difference's magnitude.
    pub sizes: [f64; L],
    /// Of products of each two terms, the lower triangle row by row; the last row is that of the
    /// difference itself.
    pub products: [[f64; L]; PRODUCTS],
}

/// Accumulates the sums for fitting weights; every fifth node is enough.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub fn sums<T: Code, const L: usize>(
    edge: usize,
    live: &[[T; L]],
    before: &[Channel<T, L>],
    channel: &Channel<T, L>,
) -> Sums<L> {
    let mut sums = Sums { sizes: [0.0; L], products: [[0.0; L]; PRODUCTS] };
    let mut sizes = [T::Sum::default(); L];
    let mut products = [[T::Sum::default(); L]; PRODUCTS];
    let none = [T::Wide::default(); L];
    let mut summed = 0;
    for_each_node(edge, |at| {
        if !at.has.contains(&true) || at.node % SAMPLED != 0 {
            return;
        }
        let (off, mean) = (&channel.off[at.node], channel.means(at.node));
        let (beyond, others) = (beyond(&channel.codes, at, &mean), others(before, at.node, &none));
        let mut wide = [[T::Wide::default(); L]; WEIGHTS + 1];
        for lane in 0..L {
            let [e, k, d1, d2, d3] = terms::<T, L>(lane, mean[lane].wide(), beyond, others);
            for (wide, term) in wide.iter_mut().zip([e, k, d1, d2, d3, off[lane]]) {
                wide[lane] = term;
            }
        }
        let mut all = [[T::Sum::default(); L]; WEIGHTS + 1];
        for (all, wide) in all.iter_mut().zip(&wide) {
            for lane in 0..L {
                // The mean is exact for nodes that are not live, whatever the weights. A select
                // between two numbers avoids a branch, which vectors do not have.
                let (factor, live) = (T::factor(wide[lane]), live[at.node][lane]);
                all[lane] = if live == T::default() { T::Sum::default() } else { factor };
            }
        }
        for (size, own) in sizes.iter_mut().zip(&all[WEIGHTS]) {
            *size = *size + own.size();
        }
        let mut pairs = products.iter_mut();
        for row in 0..=WEIGHTS {
            for (column, product) in pairs.by_ref().take(row + 1).enumerate() {
                for ((product, &a), &b) in product.iter_mut().zip(&all[row]).zip(&all[column]) {
                    *product = *product + a * b;
                }
            }
        }
        summed += 1;
        if summed == T::SUMMED {
            sums.take::<T>(&mut sizes, &mut products);
            summed = 0;
        }
    });
    sums.take::<T>(&mut sizes, &mut products);
    sums
}

impl<const L: usize> Sums<L> {
    /// Adds partial sums, and resets them.
    #[inline(always)]
    fn take<T: Code>(&mut self, sizes: &mut [T::Sum; L], products: &mut [[T::Sum; L]; PRODUCTS]) {
        let parts = std::iter::once(sizes).chain(products);
        for (whole, part) in std::iter::once(&mut self.sizes).chain(&mut self.products).zip(parts) {
            for (whole, part) in whole.iter_mut().zip(part) {
                *whole += std::mem::take(part).to_f64();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::predict::set_dont_care;
    use super::*;

    const L: usize = 4;

    /// Compares sums over codes of minimum and maximum values with f64 sums, node by node.
    fn hold_sums<T: Code>(edge: usize) {
        let nodes = edge.pow(3);
        let mut state = 7u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            state >> 63 == 1
        };
        let mut channels = Vec::new();
        let mut live = vec![[T::default(); L]; nodes];
        for _ in 0..2 {
            let mut channel = Channel::<T, L>::new(nodes);
            for codes in &mut channel.codes {
                *codes = [(); L].map(|()| T::default().with_all_if(random()));
            }
            let (all, first) = (vec![[T::default().with_all_if(true); L]; nodes], T::default());
            set_dont_care(edge, first, first, &all, &mut channel, &mut live);
            channels.push(channel);
        }
        let found = sums(edge, &live, &channels[..1], &channels[1]);
        for lane in 0..L {
            let number = |code: &[T; L]| f64::from(code[lane].code());
            let code = |channel: usize, node: usize| number(&channels[channel].codes[node]);
            let mut products = [0.0; PRODUCTS];
            for node in (SAMPLED..nodes).step_by(SAMPLED) {
                let place = [node / (edge * edge), node / edge % edge, node % edge];
                let steps = [edge * edge, edge, 1];
                let at = |channel: usize, axes: &[usize]| {
                    let has = axes.iter().all(|&axis| place[axis] > 0);
                    let back: usize = axes.iter().map(|&axis| steps[axis]).sum();
                    has.then(|| code(channel, node - back))
                };
                let mean = |channel: usize| {
                    let lower: Vec<f64> = (0..3).filter_map(|axis| at(channel, &[axis])).collect();
                    (lower.iter().sum::<f64>() / lower.len() as f64).floor()
                };
                let off = |axes: &[usize]| at(1, axes).map_or(0.0, |code| code - mean(1));
                let mut terms = [0.0; WEIGHTS + 1];
                terms[0] = off(&[0, 1]) + off(&[0, 2]) + off(&[1, 2]);
                terms[1] = off(&[0, 1, 2]);
                terms[2] = code(0, node) - mean(0);
                terms[WEIGHTS] = code(1, node) - mean(1);
                if live[node][lane] == T::default() {
                    continue;
                }
                let pairs = (0..=WEIGHTS).flat_map(|a| (0..=a).map(move |b| (a, b)));
                for (product, (a, b)) in products.iter_mut().zip(pairs) {
                    *product += terms[a] * terms[b];
                }
            }
            assert_eq!(found.products.map(|lanes| lanes[lane]), products);
        }
    }

    #[test]
    fn sums_are_those_of_floats() {
        for edge in [2, 8, 32] {
            hold_sums::<u8>(edge);
            hold_sums::<u16>(edge);
        }
    }
}
