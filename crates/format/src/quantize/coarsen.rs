//! Coarsens values of hardly visible nodes.
//!
//! A node may take the mean of its lower neighbours (as in prediction) in all channels of its group
//! at once, if each of its codes is as close to the mean as its importance requires. Such nodes are
//! not live ([`super::run`]) and cost almost nothing; the others keep their codes. Rounding those
//! to fewer codes would save little: a code off the mean costs nearly as much rounded as exact.
//! Distances are measured in codes, not in colours, because values are interpolated before
//! activation, and a node with a flat activation may be next to one with a steep one.

use super::code_word::Code;
use super::frame::FrameShape;
use super::predict::{for_each_node, mean};
use crate::model::baked::Encoding;
use crate::model::scene::Activation;

/// Movable nodes of a block, and the bound of each one's move.
#[derive(Debug, Clone, Copy)]
pub struct Coarsening<'a> {
    /// Of each node of the block; 1 is the mean of its level.
    pub importance: &'a [f32],
    /// Codes by which a node of importance 1 may move. Distances grow with 1 / sqrt(importance), so
    /// that every node adds the same amount to the squared error of pictures.
    pub coarseness: f32,
}

/// Coarsens frames of one encoding.
#[derive(Debug, Clone)]
pub struct Coarsener {
    /// Colour or opacity of each code.
    activated: Vec<f64>,
}

impl Coarsener {
    /// For integer codes; floats do not change.
    pub fn new(encoding: &Encoding, activation: &Activation) -> Option<Self> {
        let activated = |value: f32| encoding.decode.activated(value.into(), activation);
        let is_integer = !encoding.number.is_float();
        is_integer.then(|| Self { activated: encoding.values().map(activated).collect() })
    }

    /// Coarsens the codes of a frame. Codes of nodes that are not `retained` take their final
    /// value: their mean, or `dont_care_max` if that is lower. Returns the largest move of a
    /// retained node's colour or opacity.
    pub fn coarsen<T: Code>(
        &self,
        shape: FrameShape,
        codes: &mut [T],
        retained: &[bool],
        dont_care_max: u32,
        coarsening: Coarsening,
    ) -> f64 {
        let origin = T::origin(shape.number);
        let mut means = vec![origin; shape.channels];
        let mut largest = 0.0f64;
        let max_square = coarsening.coarseness * coarsening.coarseness;
        for_each_node(shape.edge, |at| {
            let (mut far, mut moved) = (0, 0.0f64);
            for (codes, to) in codes.chunks_exact(shape.nodes()).zip(&mut means) {
                let (known, _) = codes.as_chunks::<1>();
                [*to] = mean(known, at, origin);
                let [from, to] = [codes[at.node], *to].map(Code::code);
                far = far.max(from.abs_diff(to));
                let [from, to] = [from, to].map(|code| self.activated[code as usize]);
                moved = moved.max((from - to).abs());
            }
            let far = far as f32;
            let limit = match retained[at.node] {
                true if far * far * coarsening.importance[at.node] > max_square => return,
                true => u32::MAX,
                false => dont_care_max,
            };
            if retained[at.node] {
                largest = largest.max(moved);
            }
            for (codes, mean) in codes.chunks_exact_mut(shape.nodes()).zip(&means) {
                codes[at.node] = T::narrow(mean.code().min(limit));
            }
        });
        largest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::baked::NumberType;
    use crate::quantize::{Bits, color_encoding};

    /// The mean of the lower neighbours, directly from the specification.
    fn plain_mean(codes: &[u8], edge: usize, node: usize) -> i64 {
        let steps = [edge * edge, edge, 1];
        let lower = steps.iter().filter(|&&step| !(node / step).is_multiple_of(edge));
        let codes: Vec<i64> = lower.map(|step| codes[node - step].into()).collect();
        codes.iter().sum::<i64>() / codes.len().max(1) as i64
    }

    #[test]
    fn nodes_become_the_mean_just_where_all_channels_are_near_enough() {
        let mut state = 7u32;
        let mut random = |end: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) % end
        };
        let activation = Activation::logits(0.0, 0.5);
        let encoding = color_encoding(Bits::Integer(6));
        let coarsener = Coarsener::new(&encoding, &activation).expect("integers");
        for edge in [1, 2, 5, 8] {
            let shape = FrameShape { number: NumberType::U8, channels: 3, edge };
            let nodes = shape.nodes();
            let before: Vec<u8> = (0..3 * nodes).map(|_| 20 + random(12) as u8).collect();
            let importance: Vec<f32> = (0..nodes).map(|_| random(4) as f32 / 2.0).collect();
            let retained: Vec<bool> = (0..nodes).map(|_| random(4) > 0).collect();
            let mut codes = before.clone();
            let coarsening = Coarsening { importance: &importance, coarseness: 3.0 };
            let moved = coarsener.coarsen(shape, &mut codes, &retained, 22, coarsening);
            let mut largest = 0.0f64;
            for node in 0..nodes {
                let channels = [0, 1, 2].map(|c| {
                    let codes = &codes[c * nodes..][..nodes];
                    (plain_mean(codes, edge, node), before[c * nodes + node], codes[node])
                });
                let near = channels.iter().all(|&(mean, old, _)| {
                    let far = (i64::from(old) - mean) as f32;
                    far * far * importance[node] <= 9.0
                });
                for (mean, old, new) in channels {
                    let expected = match retained[node] {
                        true if near => mean,
                        true => old.into(),
                        false => mean.min(22),
                    };
                    assert_eq!(i64::from(new), expected, "node {node} of edge {edge}");
                    let value = |code: u8| {
                        encoding.decode.activated(encoding.value(code.into()).into(), &activation)
                    };
                    if retained[node] {
                        largest = largest.max((value(old) - value(new)).abs());
                    }
                }
            }
            assert_eq!(moved, largest);
        }
    }

    #[test]
    fn floats_are_not_coarsened() {
        let activation = Activation::logits(0.0, 0.5);
        for bits in [Bits::F16, Bits::F32] {
            assert!(Coarsener::new(&color_encoding(bits), &activation).is_none());
        }
    }
}
