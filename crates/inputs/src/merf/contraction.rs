//! The space of a whole scene.
//!
//! ```text
//! c = x                           where no component is above 1
//! c = x / m, but +-(2 - 1 / m)    beyond, for the largest component, of m
//! ```

/// The number of the largest component, and its size.
fn largest(position: [f64; 3]) -> (usize, f64) {
    let sizes = position.into_iter().map(f64::abs).enumerate();
    sizes.fold((0, 0.0), |most, found| if found.1 > most.1 { found } else { most })
}

/// The maximum norm: 1 on the faces of the core.
pub(super) fn norm(position: [f64; 3]) -> f64 {
    largest(position).1
}

/// A position in contracted space.
pub(super) fn contracted(position: [f64; 3]) -> [f64; 3] {
    let (axis, most) = largest(position);
    if most <= 1.0 {
        return position;
    }
    let mut own = position.map(|at| at / most);
    if let Some(at) = own.get_mut(axis) {
        *at *= 2.0 - 1.0 / most;
    }
    own
}

/// The contracted length of a short step along a direction, over its length.
pub(super) fn stretch(position: [f64; 3], direction: [f64; 3]) -> f64 {
    let (axis, most) = largest(position);
    if most <= 1.0 {
        return direction.iter().map(|by| by * by).sum::<f64>().sqrt();
    }
    let of = |vector: [f64; 3]| vector.get(axis).copied().unwrap_or(0.0);
    // The change of the largest component.
    let grows = of(direction) * of(position).signum();
    let mut own = [0.0; 3];
    let axes = own.iter_mut().zip(position).zip(direction);
    axes.for_each(|((own, at), by)| *own = (by - at / most * grows) / most);
    if let Some(own) = own.get_mut(axis) {
        *own = grows / (most * most);
    }
    own.iter().map(|by| by * by).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_as_long_as_differences() {
        let direction = [0.6, -0.64, 0.48];
        for position in [[0.2, 0.9, -0.3], [1.5, 0.2, -1.0], [-8.0, 3.0, 40.0], [0.1, -2.5, 0.0]] {
            let step = 1e-6;
            let mut next = position;
            next.iter_mut().zip(direction).for_each(|(at, by)| *at += step * by);
            let way = contracted(position).into_iter().zip(contracted(next));
            let way = way.map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt() / step;
            let found = stretch(position, direction);
            assert!((found - way).abs() < 1e-4 * way, "{found} {way} at {position:?}");
            assert!(contracted(position).iter().all(|at| at.abs() < 2.0));
        }
    }
}
