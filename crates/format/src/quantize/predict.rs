//! Prediction inside a block, many blocks at a time.
//!
//! ```text
//! mean       = floor(mean of the lower neighbours along x, y and z that the block has);
//!              the origin at its first node
//! prediction = mean + floor((w0 e + w1 k + w2 d1 + w3 d2 + w4 d3 + 16) / 32)
//! ```
//!
//! with `e` the sum of the differences from the mean of the three lower neighbours along two axes,
//! `k` that of the one along all three, and `d1`, `d2`, `d3` the differences of code and mean that
//! the three channels before have at the same node; missing nodes and channels count as 0. Trained
//! values vary smoothly in all directions, but channels share their noise: the residuals of the
//! channels before are the best predictors of this channel's residual.
//!
//! A node depends on those before it, so nodes of a block are sequential. Blocks are parallel:
//! vector instructions process the same node of several blocks ([`Lanes`]).

use multiversion::multiversion;

use super::code_word::{Code, Wide};

/// Number of earlier channels in a channel's predictions.
pub const CHANNELS_BEFORE: usize = 3;
/// Weights of a prediction: of `e`, `k` and the channels before, the nearest first.
pub const WEIGHTS: usize = 2 + CHANNELS_BEFORE;
/// Weights are in 32nds.
const SHIFT: usize = 5;

/// For each node, a number for each of `L` blocks.
pub type Lanes<T, const L: usize> = Vec<[T; L]>;

/// Codes, means and differences of one channel of some blocks.
#[derive(Debug, Clone, Default)]
pub struct Channel<T: Code, const L: usize> {
    /// Its codes.
    pub codes: Lanes<T, L>,
    /// Their differences from the means of lower neighbours.
    pub off: Lanes<T::Wide, L>,
}

impl<T: Code, const L: usize> Channel<T, L> {
    /// For blocks of this many nodes.
    pub fn new(nodes: usize) -> Self {
        Self { codes: vec![[T::default(); L]; nodes], off: vec![[T::Wide::default(); L]; nodes] }
    }

    /// The means of a node.
    #[inline(always)]
    pub fn means(&self, node: usize) -> [T; L] {
        let (codes, off) = (&self.codes[node], &self.off[node]);
        let mut means = [T::default(); L];
        for lane in 0..L {
            means[lane] = T::wrap(codes[lane].wide() - off[lane]);
        }
        means
    }
}

/// Place of a node in its block.
#[derive(Debug, Clone, Copy)]
pub struct At {
    /// Its number, z fastest.
    pub node: usize,
    edge: usize,
    /// True for each axis along which the block has a lower neighbour.
    pub has: [bool; 3],
}

/// Calls `visit` with each node of a block, z fastest.
#[inline(always)]
pub fn for_each_node(edge: usize, mut visit: impl FnMut(At)) {
    let mut node = 0;
    for x in 0..edge {
        for y in 0..edge {
            for z in 0..edge {
                visit(At { node, edge, has: [x > 0, y > 0, z > 0] });
                node += 1;
            }
        }
    }
}

/// The means of the lower neighbours.
#[inline(always)]
pub fn mean<T: Code, const L: usize>(codes: &[[T; L]], at: At, origin: T) -> [T; L] {
    let below = |axis: usize| &codes[at.node - [at.edge * at.edge, at.edge, 1][axis]];
    let two = |a: &[T; L], b: &[T; L]| {
        let mut out = [origin; L];
        for lane in 0..L {
            out[lane] = T::wrap((a[lane].wide() + b[lane].wide()) >> 1);
        }
        out
    };
    match at.has {
        [false, false, false] => [origin; L],
        [true, false, false] => *below(0),
        [false, true, false] => *below(1),
        [false, false, true] => *below(2),
        [true, true, false] => two(below(0), below(1)),
        [true, false, true] => two(below(0), below(2)),
        [false, true, true] => two(below(1), below(2)),
        [true, true, true] => {
            let (a, b, c) = (below(0), below(1), below(2));
            let mut out = [origin; L];
            for lane in 0..L {
                out[lane] = T::third(a[lane].wide() + b[lane].wide() + c[lane].wide());
            }
            out
        }
    }
}

/// The codes of the lower neighbours along x and y, x and z, y and z, and all three, or the mean if
/// there is no such neighbour.
#[inline(always)]
pub fn beyond<'a, T, const L: usize>(
    codes: &'a [[T; L]],
    at: At,
    mean: &'a [T; L],
) -> [&'a [T; L]; 4] {
    let steps = [at.edge * at.edge, at.edge, 1];
    let beyond = |axes: [bool; 3]| {
        let has = (0..3).all(|axis| !axes[axis] || at.has[axis]);
        let step = |axis: usize| if axes[axis] { steps[axis] } else { 0 };
        if has { &codes[at.node - step(0) - step(1) - step(2)] } else { mean }
    };
    // Not an array `map`, which would be a call per node.
    [
        beyond([true, true, false]),
        beyond([true, false, true]),
        beyond([false, true, true]),
        beyond([true; 3]),
    ]
}

/// Differences of codes from their means at a node, for the channels before, the nearest first; 0
/// if there is none.
#[inline(always)]
pub fn others<'a, T: Code, const L: usize>(
    before: &'a [Channel<T, L>],
    node: usize,
    none: &'a [T::Wide; L],
) -> [&'a [T::Wide; L]; CHANNELS_BEFORE] {
    std::array::from_fn(|i| match before.len().checked_sub(i + 1) {
        Some(channel) => &before[channel].off[node],
        None => none,
    })
}

/// The terms of a prediction.
#[inline(always)]
pub fn terms<T: Code, const L: usize>(
    lane: usize,
    mean: T::Wide,
    [xy, xz, yz, corner]: [&[T; L]; 4],
    others: [&[T::Wide; L]; CHANNELS_BEFORE],
) -> [T::Wide; WEIGHTS] {
    let e = xy[lane].wide() + xz[lane].wide() + yz[lane].wide() - (mean + mean + mean);
    let k = corner[lane].wide() - mean;
    let [d1, d2, d3] = others.map(|off| off[lane]);
    [e, k, d1, d2, d3]
}

/// The predictions of a node, not reduced to the width.
#[inline(always)]
fn predictions<T: Code, const L: usize>(
    codes: &[[T; L]],
    before: &[Channel<T, L>],
    at: At,
    mean: &[T; L],
    weights: &[[T::Wide; L]; WEIGHTS],
) -> [T::Wide; L] {
    let none = [T::Wide::default(); L];
    let (beyond, others) = (beyond(codes, at, mean), others(before, at.node, &none));
    let mut out = [T::Wide::default(); L];
    for lane in 0..L {
        let mean = mean[lane].wide();
        let [e, k, d1, d2, d3] = terms::<T, L>(lane, mean, beyond, others);
        let near = weights[0][lane] * e + weights[1][lane] * k;
        let far = weights[2][lane] * d1 + weights[3][lane] * d2 + weights[4][lane] * d3;
        out[lane] = mean + ((near + far + T::Wide::from_i8(1 << (SHIFT - 1))) >> SHIFT);
    }
    out
}

/// Restores codes of one channel from residuals; `live` has all bits set for nodes with a residual
/// and none for others, which equal their mean. `before` are the channels before, the nearest last.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub fn restore<T: Code, const L: usize>(
    edge: usize,
    origin: T,
    live: &[[T; L]],
    residuals: &[[T; L]],
    before: &[Channel<T, L>],
    weights: &[[T::Wide; L]; WEIGHTS],
    channel: &mut Channel<T, L>,
) {
    for_each_node(edge, |at| {
        let mean = mean(&channel.codes, at, origin);
        let predicted = predictions(&channel.codes, before, at, &mean, weights);
        let (live, residuals) = (&live[at.node], &residuals[at.node]);
        let (codes, off) = (&mut channel.codes[at.node], &mut channel.off[at.node]);
        for lane in 0..L {
            let code = T::wrap(predicted[lane] + residuals[lane].wide() - T::bias());
            codes[lane] = code.choose(mean[lane], live[lane]);
            off[lane] = codes[lane].wide() - mean[lane].wide();
        }
    });
}

/// Gives codes of don't-care nodes their mean, or `dont_care_max` if that is lower, and finds the
/// means. Sets all bits in `live` of nodes whose code is not the mean. `retained` has all bits set
/// for retained nodes.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub fn set_dont_care<T: Code, const L: usize>(
    edge: usize,
    origin: T,
    dont_care_max: T,
    retained: &[[T; L]],
    channel: &mut Channel<T, L>,
    live: &mut [[T; L]],
) {
    for_each_node(edge, |at| {
        let mean = mean(&channel.codes, at, origin);
        let (retained, codes) = (&retained[at.node], &mut channel.codes[at.node]);
        let (live, off) = (&mut live[at.node], &mut channel.off[at.node]);
        for lane in 0..L {
            let free = if mean[lane] < dont_care_max { mean[lane] } else { dont_care_max };
            codes[lane] = codes[lane].choose(free, retained[lane]);
            live[lane] = live[lane].with_all_if(codes[lane] != mean[lane]);
            off[lane] = codes[lane].wide() - mean[lane].wide();
        }
    });
}

/// Converts codes to biased residuals, the input of [`restore`].
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub fn residuals<T: Code, const L: usize>(
    edge: usize,
    before: &[Channel<T, L>],
    weights: &[[T::Wide; L]; WEIGHTS],
    channel: &Channel<T, L>,
    out: &mut [[T; L]],
) {
    for_each_node(edge, |at| {
        let (codes, mean) = (&channel.codes[at.node], channel.means(at.node));
        let predicted = predictions(&channel.codes, before, at, &mean, weights);
        let out = &mut out[at.node];
        for lane in 0..L {
            out[lane] = T::wrap(codes[lane].wide() - predicted[lane] + T::bias());
        }
    });
}

#[cfg(test)]
mod tests {
    use std::iter::repeat_with;

    use super::super::code_word::Wide;
    use super::*;

    const L: usize = 4;

    /// The code of one node in one block, directly from the specification.
    fn plain_code(
        edge: usize,
        known: &[Vec<u64>],
        [x, y, z]: [usize; 3],
        weights: &[i8; WEIGHTS],
        residual: u64,
        width: u32,
    ) -> (u64, u64) {
        let node = (x * edge + y) * edge + z;
        let own = known.last().expect("this channel");
        let at = |[dx, dy, dz]: [usize; 3]| {
            (x >= dx && y >= dy && z >= dz)
                .then(|| i128::from(own[node - (dx * edge + dy) * edge - dz]))
        };
        let lower: Vec<i128> =
            [[1, 0, 0], [0, 1, 0], [0, 0, 1]].into_iter().filter_map(at).collect();
        let mean = lower.iter().sum::<i128>().div_euclid(lower.len().max(1) as i128);
        let off = |step| at(step).map_or(0, |code| code - mean);
        let mut terms = vec![off([1, 1, 0]) + off([1, 0, 1]) + off([0, 1, 1]), off([1, 1, 1])];
        for before in known[..known.len() - 1].iter().rev().take(CHANNELS_BEFORE) {
            // Codes, and then their means.
            terms.push(i128::from(before[node]) - i128::from(before[edge.pow(3) + node]));
        }
        let sum: i128 = terms.iter().zip(weights).map(|(term, &w)| term * i128::from(w)).sum();
        let half = (0..width / 8).fold(0, |half, byte| half | 0x80 << (8 * byte));
        let code = mean + (sum + 16).div_euclid(32) + i128::from(residual) - half;
        (code.rem_euclid(1 << width) as u64, mean as u64)
    }

    /// Compares codes that are restored from random residuals with the largest weights to the
    /// specification.
    fn hold<T: Code>(edge: usize) {
        let nodes = edge.pow(3);
        let mut state = 5u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 33) as u32 ^ (state >> 11) as u32
        };
        let width = 8 * T::BYTES as u32;
        let origin = T::default();
        let mut known: Vec<Channel<T, L>> = Vec::new();
        let mut plain: [Vec<Vec<u64>>; L] = Default::default();
        for _ in 0..5 {
            let weights: [[i8; WEIGHTS]; L] = std::array::from_fn(|lane| {
                [(); WEIGHTS].map(|()| if lane == 0 { i8::MIN } else { random() as i8 })
            });
            let residuals: Lanes<T, L> =
                repeat_with(|| [(); L].map(|()| T::narrow(random()))).take(nodes).collect();
            let mut made = Channel::<T, L>::new(nodes);
            let wide: [[T::Wide; L]; WEIGHTS] =
                std::array::from_fn(|i| weights.map(|weights| T::Wide::from_i8(weights[i])));
            let live = vec![[origin.with_all_if(true); L]; nodes];
            let before = &known[known.len().saturating_sub(CHANNELS_BEFORE)..];
            restore(edge, origin, &live, &residuals, before, &wide, &mut made);
            let mut again = vec![[origin; L]; nodes];
            self::residuals(edge, before, &wide, &made, &mut again);
            assert_eq!(again, residuals);
            for lane in 0..L {
                plain[lane].push(vec![0; nodes]);
                let mut means = Vec::new();
                for (node, residuals) in residuals.iter().enumerate() {
                    let place = [node / (edge * edge), node / edge % edge, node % edge];
                    let residual = u64::from(residuals[lane].code());
                    let (code, mean) =
                        plain_code(edge, &plain[lane], place, &weights[lane], residual, width);
                    assert_eq!(u64::from(made.codes[node][lane].code()), code, "node {node}");
                    plain[lane].last_mut().expect("pushed")[node] = code;
                    means.push(mean);
                }
                plain[lane].last_mut().expect("pushed").extend(means);
            }
            known.push(made);
        }
    }

    #[test]
    fn codes_are_those_of_the_specification_whatever_the_weights() {
        for edge in [1, 2, 3, 8] {
            hold::<u8>(edge);
            hold::<u16>(edge);
            hold::<u32>(edge);
        }
    }
}
