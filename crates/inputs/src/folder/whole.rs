//! Numbers of places in grids.

/// The whole part of a number from 0; anything else is 0.
pub fn whole(number: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
    let whole = number as usize;
    whole
}
