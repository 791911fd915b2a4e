//! Rays through boxes.

/// Entry of a ray into a box and its exit, in lengths of `direction`. A ray that misses the box
/// leaves before it enters.
pub fn crossing(origin: [f64; 3], direction: [f64; 3], [low, high]: [[f64; 3]; 2]) -> [f64; 2] {
    let (mut enters, mut leaves) = (f64::NEG_INFINITY, f64::INFINITY);
    let axes = origin.into_iter().zip(direction).zip(low.into_iter().zip(high));
    for ((from, by), (low, high)) in axes {
        let by = if by == 0.0 { f64::MIN_POSITIVE } else { by };
        let (a, b) = ((low - from) / by, (high - from) / by);
        (enters, leaves) = (enters.max(a.min(b)), leaves.min(a.max(b)));
    }
    [enters, leaves]
}

/// The whole part of a number from 0; anything else is 0.
pub fn whole(number: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
    let whole = number as usize;
    whole
}
