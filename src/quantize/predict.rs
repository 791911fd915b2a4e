//! Prediction inside a block: trained values vary smoothly in all three directions, so what is
//! left after the mean of a node's three lower neighbours compresses better than the codes.
//!
//! The prediction of a node is the mean, rounded down, of the codes of its lower neighbours along
//! x, y and z, those that the block has; of the block's first node it is the origin: 0 for
//! integers, the code of +0 for floats. Residuals are differences modulo the code's width.

use crate::baked::NumberType;

/// The prediction of a block's first node.
fn origin(number: NumberType) -> u32 {
    match number {
        NumberType::U8 | NumberType::U16 => 0,
        NumberType::F16 => 1 << 15,
        NumberType::F32 => 1 << 31,
    }
}

/// The prediction of node `at` (its number in the block), whose lower neighbours are known.
pub(super) fn predicted(
    number: NumberType,
    edge: usize,
    [x, y, z]: [usize; 3],
    codes: &[u32],
) -> u32 {
    let at = (x * edge + y) * edge + z;
    let (mut sum, mut count) = (0u64, 0u64);
    for (lower, distance) in [(x, edge * edge), (y, edge), (z, 1)] {
        if lower > 0 {
            sum += u64::from(codes[at - distance]);
            count += 1;
        }
    }
    sum.checked_div(count).map_or_else(|| origin(number), |mean| mean as u32)
}

/// A block's residuals as bytes: all lowest bytes first, then the next.
pub fn residual_bytes(number: NumberType, edge: usize, codes: &[u32], out: &mut Vec<u8>) {
    let nodes = edge.pow(3);
    let start = out.len();
    out.resize(start + nodes * number.bytes(), 0);
    let bytes = &mut out[start..];
    for_each_node(edge, |at, place| {
        let residual = codes[at].wrapping_sub(predicted(number, edge, place, codes));
        for (plane, byte) in residual.to_le_bytes().into_iter().take(number.bytes()).enumerate() {
            bytes[plane * nodes + at] = byte;
        }
    });
}

/// The inverse of [`residual_bytes`]. `bytes(plane)` is one byte plane of the block.
pub fn unpredict<'a>(
    number: NumberType,
    edge: usize,
    bytes: impl Fn(usize) -> &'a [u8],
    codes: &mut [u32],
) {
    let planes: Vec<&[u8]> = (0..number.bytes()).map(bytes).collect();
    let all = u32::MAX >> (32 - 8 * number.bytes());
    for_each_node(edge, |at, place| {
        let residual = planes.iter().rev().fold(0, |code, plane| code << 8 | u32::from(plane[at]));
        codes[at] = predicted(number, edge, place, codes).wrapping_add(residual) & all;
    });
}

/// Calls `visit` with each node's number and place, z fastest.
pub(super) fn for_each_node(edge: usize, mut visit: impl FnMut(usize, [usize; 3])) {
    let mut at = 0;
    for x in 0..edge {
        for y in 0..edge {
            for z in 0..edge {
                visit(at, [x, y, z]);
                at += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn residuals_are_reversible() {
        let mut state = 1u64;
        for number in [NumberType::U8, NumberType::U16, NumberType::F16, NumberType::F32] {
            for edge in [1, 2, 5, 8] {
                let nodes = edge * edge * edge;
                let codes: Vec<u32> = (0..nodes)
                    .map(|_| {
                        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                        (state >> 32) as u32 >> (32 - 8 * number.bytes())
                    })
                    .collect();
                let mut bytes = Vec::new();
                residual_bytes(number, edge, &codes, &mut bytes);
                let mut back = vec![0; nodes];
                unpredict(number, edge, |plane| &bytes[plane * nodes..][..nodes], &mut back);
                assert_eq!(back, codes);
            }
        }
    }

    #[test]
    fn constant_blocks_leave_one_residual() {
        let mut bytes = Vec::new();
        residual_bytes(NumberType::U8, 4, &[77; 64], &mut bytes);
        assert_eq!((bytes[0], bytes[1..].iter().max()), (77, Some(&0)));
    }
}
