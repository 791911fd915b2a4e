//! Resamples a ray where an earlier round found density, by nerfstudio's rules.

/// Added to the weight of each interval.
const PADDING: f64 = 0.01;

/// The ends of `count` intervals with equal shares of the padded weights of the given intervals:
/// the middles of `count + 1` equal parts of the sum of weights.
pub fn resampled(ends: &[f64], weights: &[f64], count: usize) -> Vec<f64> {
    let mut sum = 0.0;
    let mut shares = vec![0.0];
    shares.extend(weights.iter().map(|weight| {
        sum += weight + PADDING;
        sum
    }));
    shares.iter_mut().for_each(|share| *share = (*share / sum).min(1.0));
    let bins = count + 1;
    let last = weights.len();
    let end = |number: usize| ends.get(number).copied().unwrap_or_default();
    let share = |number: usize| shares.get(number).copied().unwrap_or(1.0);
    let found = (0..bins).map(|number| {
        let wanted = (number as f64 + 0.5) / bins as f64;
        let above = shares.partition_point(|share| *share <= wanted).min(last);
        let below = above.saturating_sub(1);
        let part = (wanted - share(below)) / (share(above) - share(below));
        let part = if part.is_finite() { part.clamp(0.0, 1.0) } else { 0.0 };
        end(below) + part * (end(above) - end(below))
    });
    found.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_weights_part_evenly() {
        let ends = [0.0, 1.0, 2.0, 3.0, 4.0];
        let found = resampled(&ends, &[0.25; 4], 3);
        assert_eq!(found.len(), 4);
        let expected = [0.5, 1.5, 2.5, 3.5];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    }

    #[test]
    fn samples_gather_where_weights_are() {
        let ends = [0.0, 1.0, 2.0, 3.0];
        let found = resampled(&ends, &[0.0, 1.0, 0.0], 20);
        assert!(found.iter().all(|end| (1.0..=2.0).contains(end)), "{found:?}");
        assert!(found.is_sorted());
    }
}
