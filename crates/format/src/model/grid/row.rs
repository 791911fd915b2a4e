//! Rows of bits, one for each node along z, in words of 64: the lowest bit first, none set beyond
//! the end.

use multiversion::multiversion;

use super::Nodes;

/// Words of a row of this grid.
pub fn words(nodes: Nodes) -> usize {
    nodes.0[2].div_ceil(64)
}

/// Bit `z` of a row.
pub fn get(row: &[u64], z: usize) -> bool {
    row[z / 64] >> (z % 64) & 1 == 1
}

/// The bits of a row from `first` on, as many as there are flags.
pub fn unpack(row: &[u64], first: usize, flags: &mut [bool]) {
    // Each byte keeps one of eight bits, and the sum sets its top bit if that is set.
    const EACH: u64 = 0x8040_2010_0804_0201;
    const BELOW_TOP: u64 = 0x7f7f_7f7f_7f7f_7f7f;
    for (z, flags) in (first..).step_by(8).zip(flags.chunks_mut(8)) {
        let word = |i: usize| row.get(i).copied().unwrap_or(0);
        let (low, shift) = (word(z / 64) >> (z % 64), z % 64);
        let high = if shift > 56 { word(z / 64 + 1) << (64 - shift) } else { 0 };
        let eight = u64::from((low | high) as u8).wrapping_mul(0x0101_0101_0101_0101) & EACH;
        let bytes = (eight + BELOW_TOP).to_le_bytes();
        for (flag, byte) in flags.iter_mut().zip(bytes) {
            *flag = byte >= 0x80;
        }
    }
}

/// Sets the bits of values that are above a threshold, and clears the others.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "aarch64+neon"))]
pub fn pack_above(values: &[f32], threshold: f32, row: &mut [u64]) {
    for (values, word) in values.chunks(64).zip(row) {
        // Most of a scene is empty, and a test is faster than setting bits.
        if values.iter().fold(0, |any, &value| any | u32::from(value > threshold)) == 0 {
            *word = 0;
            continue;
        }
        let mut flags = [0; 64];
        for (flag, &value) in flags.iter_mut().zip(values) {
            *flag = u8::from(value > threshold);
        }
        let bytes = flags.as_chunks::<8>().0.iter().map(|&eight| lowest_bits(eight)).enumerate();
        *word = bytes.fold(0, |word, (byte, bits)| word | u64::from(bits) << (8 * byte));
    }
}

/// The lowest bits of eight bytes, of which no other is set.
#[inline(always)]
pub fn lowest_bits(eight: [u8; 8]) -> u8 {
    (u64::from_le_bytes(eight).wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8
}

/// Sets bit `z` of a row.
pub fn set(row: &mut [u64], z: usize) {
    row[z / 64] |= 1 << (z % 64);
}

/// Sets bits `start..end` of a row.
pub fn set_between(row: &mut [u64], start: usize, end: usize) {
    for (i, word) in row.iter_mut().enumerate() {
        *word |= word_between(i, start, end);
    }
}

/// Adds the bits of `other`.
pub fn or_into(row: &mut [u64], other: &[u64]) {
    for (word, other) in row.iter_mut().zip(other) {
        *word |= other;
    }
}

/// Keeps the bits that are set in `other`.
pub fn and_into(row: &mut [u64], other: &[u64]) {
    for (word, other) in row.iter_mut().zip(other) {
        *word &= other;
    }
}

/// Runs of set bits, lowest first: first bit, and one past the last.
#[inline]
pub fn runs(row: &[u64]) -> impl Iterator<Item = (usize, usize)> {
    let mut at = 0;
    std::iter::from_fn(move || {
        let start = next_bit(row, at, 0)?;
        at = next_bit(row, start, u64::MAX).unwrap_or(row.len() * 64);
        Some((start, at))
    })
}

/// Runs of the first `count` bits that are not set, lowest first.
#[inline]
pub fn gaps(row: &[u64], count: usize) -> impl Iterator<Item = (usize, usize)> {
    gaps_between(row, 0, count)
}

/// Runs of the bits `from..end` that are not set, lowest first.
#[inline]
pub fn gaps_between(row: &[u64], from: usize, end: usize) -> impl Iterator<Item = (usize, usize)> {
    let mut at = from;
    std::iter::from_fn(move || {
        let start = next_bit(row, at, u64::MAX).filter(|&start| start < end)?;
        at = next_bit(row, start, 0).unwrap_or(end).min(end);
        Some((start, at))
    })
}

/// The first bit from `at` on that differs from those of `others`.
#[inline]
fn next_bit(row: &[u64], at: usize, others: u64) -> Option<usize> {
    let mut word = at / 64;
    let mut left = (row.get(word)? ^ others) & (u64::MAX << (at % 64));
    while left == 0 {
        word += 1;
        left = row.get(word)? ^ others;
    }
    Some(word * 64 + left.trailing_zeros() as usize)
}

/// Spans begin and end at multiples of this, the longest vectors in loops over them.
pub const LANES: usize = 16;

/// Ranges of the first `count` bits, lowest first, that cover all set ones. Runs fewer than `gap`
/// bits apart are joined, and ends are aligned to vectors.
#[inline]
pub fn spans(row: &[u64], count: usize, gap: usize) -> impl Iterator<Item = (usize, usize)> {
    let mut runs = runs(row)
        .map(move |(start, end)| (start / LANES * LANES, end.next_multiple_of(LANES).min(count)));
    let mut next = runs.next();
    std::iter::from_fn(move || {
        let (first, mut last) = next?;
        loop {
            next = runs.next();
            match next {
                Some((start, end)) if start < last + gap => last = end,
                _ => return Some((first, last)),
            }
        }
    })
}

/// First set bit and one past the last, if any is set.
pub fn span(row: &[u64]) -> Option<(usize, usize)> {
    let first = row.iter().position(|&word| word != 0)?;
    let last = row.iter().rposition(|&word| word != 0)?;
    let start = first * 64 + row[first].trailing_zeros() as usize;
    Some((start, last * 64 + 64 - row[last].leading_zeros() as usize))
}

/// True if any of the bits `start..end` is set.
#[inline]
pub fn any_between(row: &[u64], start: usize, end: usize) -> bool {
    let words = start / 64..end.div_ceil(64).min(row.len());
    words.into_iter().any(|i| row[i] & word_between(i, start, end) != 0)
}

/// The bits of word `i` that are numbered `start..end` in their row.
fn word_between(i: usize, start: usize, end: usize) -> u64 {
    let low = start.saturating_sub(i * 64).min(64);
    let high = end.saturating_sub(i * 64).min(64);
    let below = |count: usize| if count == 64 { u64::MAX } else { (1 << count) - 1 };
    below(high) & !below(low)
}

/// `row |= row >> 1`: a bit joins the one below it.
pub fn or_shifted_down(row: &mut [u64]) {
    for i in 0..row.len() {
        let carry = row.get(i + 1).map_or(0, |next| next << 63);
        row[i] |= row[i] >> 1 | carry;
    }
}

/// `row |= row << 1`: a bit joins the one above it.
pub fn or_shifted_up(row: &mut [u64]) {
    for i in (0..row.len()).rev() {
        let carry = if i > 0 { row[i - 1] >> 63 } else { 0 };
        row[i] |= row[i] << 1 | carry;
    }
}

/// Removes the bits from `end` on.
pub fn clear_from(row: &mut [u64], end: usize) {
    for (i, word) in row.iter_mut().enumerate().skip(end / 64) {
        *word &= word_between(i, 0, end);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_and_bits_are_those_of_each_place() {
        let row = [0x8000_0000_0000_0001, 0xf0f0_1234_5678_9abc, 1];
        for first in 0..140 {
            for count in [0, 1, 7, 8, 9, 64, 70] {
                let mut flags = vec![true; count];
                unpack(&row, first, &mut flags);
                for (z, flag) in (first..).zip(flags) {
                    assert_eq!(flag, z < 192 && get(&row, z), "{first} {z}");
                }
                let any = (first..first + count).any(|z| z < 192 && get(&row, z));
                assert_eq!(any_between(&row, first, first + count), any, "{first} {count}");
            }
        }
        assert_eq!(lowest_bits([1, 0, 1, 1, 0, 0, 0, 1]), 0b1000_1101);
    }
}
