//! The results worth having.
//!
//! A result is on the front if no other costs at most as much and is at least as good, and better
//! in one of the two. Of results that are equal in both, the first is on it.

/// A result's cost (less is better) and quality (more is better).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Bytes, or seconds.
    pub cost: f64,
    /// PSNR in dB.
    pub quality: f64,
}

/// For each point, true if it is on the front. A point that is no number is on none.
pub fn front(points: &[Point]) -> Vec<bool> {
    let mut order: Vec<usize> = (0..points.len())
        .filter(|&i| !points[i].cost.is_nan() && !points[i].quality.is_nan())
        .collect();
    // Cheapest first; among equals the best, then the first.
    order.sort_by(|&a, &b| {
        let (a_point, b_point) = (points[a], points[b]);
        let cost = a_point.cost.total_cmp(&b_point.cost);
        cost.then(b_point.quality.total_cmp(&a_point.quality)).then(a.cmp(&b))
    });
    let mut on_front = vec![false; points.len()];
    let mut best = f64::NEG_INFINITY;
    for i in order {
        if points[i].quality > best {
            best = points[i].quality;
            on_front[i] = true;
        }
    }
    on_front
}
