//! The Pareto front of results.
//!
//! A result is on the front if no other result is at least as good in both cost and quality, and
//! better in one. Of equal results, the first is on the front.

/// A result's cost (less is better) and quality (more is better).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Bytes, or seconds.
    pub cost: f64,
    /// PSNR in dB.
    pub quality: f64,
}

/// For each point, true if it is on the front. NaN points are never on it.
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

/// PSNR of pictures that differ only by rounding to 8 bits.
const ROUNDING: f64 = 58.9;

/// The knee of a front, from its points: the one that is farthest above the line between the
/// cheapest and the best, in decibels over the logarithm of the cost. Errors below the rounding of
/// pictures do not count. Two points have none if the dearer one is better.
pub fn knee(points: &[Point]) -> Option<usize> {
    let quality = |point: &Point| point.quality.min(ROUNDING);
    let cheapest = points.iter().min_by(|a, b| a.cost.total_cmp(&b.cost))?;
    let order =
        |a: &&Point, b: &&Point| quality(a).total_cmp(&quality(b)).then(b.cost.total_cmp(&a.cost));
    let best = points.iter().max_by(order)?;
    if points.len() == 2 && best.cost > cheapest.cost {
        return None;
    }
    let span = libm::log2(best.cost / cheapest.cost);
    let height = |point: &Point| match span > 0.0 {
        true => {
            let along = libm::log2(point.cost / cheapest.cost) / span;
            quality(point) - (quality(cheapest) + along * (quality(best) - quality(cheapest)))
        }
        false => 0.0,
    };
    let order = |(_, a): &(usize, &Point), (_, b): &(usize, &Point)| {
        let height = height(a).total_cmp(&height(b));
        height.then(quality(a).total_cmp(&quality(b))).then(b.cost.total_cmp(&a.cost))
    };
    points.iter().enumerate().max_by(order).map(|(index, _)| index)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_knee_is_where_more_bytes_gain_less() {
        let points = |values: &[(f64, f64)]| {
            let points = values.iter().map(|&(cost, quality)| Point { cost, quality });
            knee(&points.collect::<Vec<_>>())
        };
        assert_eq!(points(&[(1.0, 30.0), (2.0, 45.0), (4.0, 47.0), (8.0, 48.0)]), Some(1));
        assert_eq!(points(&[(8.0, 48.0), (1.0, 30.0)]), None);
        // Quality beyond 8-bit pictures has no value.
        assert_eq!(points(&[(0.43, 46.9), (0.65, 59.2), (0.95, 71.3)]), Some(1));
        assert_eq!(points(&[(0.65, 59.2), (0.95, 71.3)]), Some(0));
        assert_eq!(points(&[(1.0, 30.0)]), Some(0));
        assert_eq!(points(&[]), None);
    }
}
