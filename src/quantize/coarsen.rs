//! Coarser codes for nodes that make up little of any picture.
//!
//! A node's shift `s` says how much it may err: its code moves to the nearest one whose difference from the
//! mean of its lower neighbours (as prediction sees it) is a multiple of `2^s`, by `2^(s-1)` codes at most.
//! What differs little from its neighbours then differs by nothing, which costs least of all.

use super::predict::{for_each_node, mean};
use super::run::FrameShape;
use super::wide::Code;
use crate::baked::Encoding;
use crate::field::Activation;

/// The largest shift.
pub const MOST_SHIFT: u8 = 5;

/// The shift of a node of this importance (1 is the mean), where errors of `coarseness` codes are wanted at
/// the mean: steps grow with one over the root of importance.
pub fn shift(importance: f32, coarseness: f32) -> u8 {
    // Steps are rounded to powers of 2 by their logarithms: at 2^(s - 1/2).
    let step = |shift: u8| f32::from(1u16 << shift) * std::f32::consts::FRAC_1_SQRT_2;
    let coarser = |&shift: &u8| coarseness * coarseness >= importance * step(shift) * step(shift);
    (1..=MOST_SHIFT).take_while(coarser).last().unwrap_or(0)
}

/// The largest error of an encoding's decoded values once their codes are coarsened.
pub fn coarsened_error(encoding: &Encoding, activation: &Activation) -> f32 {
    let values: Vec<f64> = encoding
        .values()
        .map(|value| encoding.decode.activated(value.into(), activation))
        .collect();
    let moved = 1usize << (MOST_SHIFT - 1);
    let far = |i: usize| (values[(i + moved).min(values.len() - 1)] - values[i]).abs();
    let most = (0..values.len()).map(far).fold(0.0, f64::max);
    // Rounded up.
    ((most + f64::from(encoding.max_error)) * (1.0 + 1e-6)) as f32
}

/// What a frame's codes may be moved by, and to.
#[derive(Debug, Clone, Copy)]
pub struct Coarsening<'a> {
    /// Of each node of the block.
    pub shifts: &'a [u8],
    /// The highest code of nodes that nobody needs.
    pub unneeded_limit: u32,
    /// The highest code.
    pub last: u32,
}

/// Coarsens the codes of a frame, channel by channel. Codes of nodes that are not `needed` become what they are
/// going to be: their mean, or the limit where that is lower.
pub fn coarsen<T: Code>(
    shape: FrameShape,
    codes: &mut [T],
    needed: &[bool],
    coarsening: Coarsening,
) {
    let Coarsening { shifts, unneeded_limit, last } = coarsening;
    let origin = T::origin(shape.number);
    for codes in codes.chunks_exact_mut(shape.nodes()) {
        for_each_node(shape.edge, |at| {
            let (known, _) = codes.as_chunks::<1>();
            let [mean] = mean(known, at, origin);
            let shift = u32::from(shifts[at.node]);
            let code = &mut codes[at.node];
            if !needed[at.node] {
                *code = mean.min(T::narrow(unneeded_limit));
            } else if shift > 0 {
                let (mean, half) = (i64::from(mean.code()), 1 << (shift - 1));
                let difference = (i64::from(code.code()) - mean + half) >> shift << shift;
                *code = T::narrow((mean + difference).clamp(0, last.into()) as u32);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baked::NumberType;
    use crate::field::ActivationOrder;
    use crate::quantize::{Bits, color_encoding};

    #[test]
    fn shifts_grow_with_one_over_the_root_of_importance() {
        assert_eq!([1.0, 0.25, 1.0 / 16.0].map(|importance| shift(importance, 1.0)), [0, 1, 2]);
        assert_eq!([1.0, 4.0, 16.0, 64.0].map(|importance| shift(importance, 4.0)), [2, 1, 0, 0]);
        assert_eq!(
            (shift(0.0, 1.0), shift(0.0, 0.0), shift(1e-9, 0.0)),
            (MOST_SHIFT, MOST_SHIFT, 0)
        );
    }

    #[test]
    fn codes_move_by_half_a_step_at_most() {
        let mut state = 7u32;
        let mut random = |end: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) % end
        };
        for edge in [1, 2, 5, 8] {
            let shape = FrameShape { number: NumberType::U8, channels: 3, edge };
            let before: Vec<u8> = (0..3 * shape.nodes()).map(|_| random(64) as u8).collect();
            let shifts: Vec<u8> = (0..shape.nodes()).map(|_| random(6) as u8).collect();
            let needed: Vec<bool> = (0..shape.nodes()).map(|_| random(4) > 0).collect();
            let mut codes = before.clone();
            let coarsening = Coarsening { shifts: &shifts, unneeded_limit: 20, last: 63 };
            coarsen(shape, &mut codes, &needed, coarsening);
            for (node, (&code, &old)) in codes.iter().zip(&before).enumerate() {
                let node = node % shape.nodes();
                let moved = u32::from(code.abs_diff(old));
                match needed[node] {
                    true => assert!(code <= 63 && 2 * moved <= 1 << shifts[node] & !1),
                    false => assert!(code <= 20),
                }
            }
        }
    }

    #[test]
    fn coarsened_errors_bound_what_codes_can_be_moved_by() {
        let activation = Activation { shift: 0.0, interval: 0.5, order: ActivationOrder::Raw };
        let encoding = color_encoding(Bits::Integer(8));
        let bound = f64::from(coarsened_error(&encoding, &activation));
        let values: Vec<f64> = encoding
            .values()
            .map(|value| encoding.decode.activated(value.into(), &activation))
            .collect();
        for (i, value) in values.iter().enumerate() {
            for far in &values[i..values.len().min(i + 17)] {
                assert!((far - value).abs() + f64::from(encoding.max_error) <= bound);
            }
        }
    }
}
