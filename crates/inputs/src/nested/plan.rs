//! The boxes of a whole scene.

use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::model::field::Lattice;
use crate::model::grid::{Bounds, Nodes};

/// Reach of the first box, in half sides of the inner box.
const FIRST: f64 = 2.0;
/// Boxes, at most: the last one reaches a billion half sides.
const MOST_BOXES: usize = 30;
/// Boxes may fall short of the requested extent by this share.
const ROUNDED: f64 = 1e-3;

/// The middle of an inner box and half its edges.
#[derive(Debug, Clone, Copy)]
pub struct Middle {
    /// In the world.
    pub center: [f64; 3],
    /// Along each axis, in world units.
    pub radius: [f64; 3],
}

/// The first box, around a model's nodes: the lowest at `lowest`, the next ones `spacing` apart,
/// both in half sides from the middle. It reaches twice as far as the inner box, or up to the
/// requested extent.
pub fn aligned(middle: Middle, lowest: [f64; 3], spacing: [f64; 3], extent: f64) -> Lattice {
    let reach = FIRST.min(extent) * (1.0 - ROUNDED);
    let mut first = [0.0; 3];
    let mut nodes = [0; 3];
    let axes = first.iter_mut().zip(&mut nodes).zip(lowest).zip(spacing);
    for (((first, nodes), lowest), spacing) in axes {
        let before = ((-reach - lowest) / spacing).floor();
        let after = ((reach - lowest) / spacing).ceil();
        *first = lowest + before * spacing;
        *nodes = odd(after - before);
    }
    lattice(middle, first, spacing, nodes)
}

/// The first box with this many nodes along an edge, or one more if that is even.
pub fn even(middle: Middle, nodes: usize, extent: f64) -> Lattice {
    let reach = FIRST.min(extent);
    let nodes = nodes.max(3) | 1;
    let spacing = 2.0 * reach / (nodes - 1) as f64;
    lattice(middle, [-reach; 3], [spacing; 3], [nodes; 3])
}

/// The nodes of this many cells, or one more to make them odd.
fn odd(cells: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
    let cells = cells.clamp(2.0, 1e9) as usize;
    (cells + 1) | 1
}

#[expect(clippy::cast_possible_truncation, reason = "a field's box is float32")]
fn lattice(middle: Middle, first: [f64; 3], spacing: [f64; 3], nodes: [usize; 3]) -> Lattice {
    let Middle { center, radius } = middle;
    let mut bounds = Bounds { min: [0.0; 3], max: [0.0; 3] };
    let faces = bounds.min.iter_mut().zip(&mut bounds.max);
    let middles = center.into_iter().zip(radius);
    let axes = faces.zip(middles).zip(first).zip(spacing.into_iter().zip(nodes));
    for ((((min, max), (center, radius)), first), (spacing, nodes)) in axes {
        *min = (center + radius * first) as f32;
        *max = (center + radius * (first + (nodes - 1) as f64 * spacing)) as f32;
    }
    Lattice::new(bounds, Nodes(nodes))
}

/// The first box and those around it, up to one that reaches `extent` half sides from the middle.
///
/// # Errors
/// `OverLimit` for too many nodes, `Malformed` for boxes that float32 does not hold.
pub fn boxes(
    first: Lattice,
    middle: Middle,
    extent: f64,
    limits: &Limits,
    place: &Place,
) -> Result<Vec<Lattice>> {
    let mut found = vec![first];
    let mut last = first;
    loop {
        Nodes::checked(last.nodes.0.map(|count| count as u64), limits, place)?;
        last.bounds.check_model(place)?;
        let middles = middle.center.into_iter().zip(middle.radius);
        let axes = last.bounds.min.into_iter().zip(last.bounds.max).zip(middles);
        let reached = axes
            .map(|((min, max), (center, radius))| {
                (f64::from(max) - center).min(center - f64::from(min)) / radius
            })
            .fold(f64::INFINITY, f64::min);
        if reached >= extent * (1.0 - ROUNDED) {
            return Ok(found);
        }
        let next = last.doubled();
        if found.len() == MOST_BOXES || next.check_around(&last, place).is_err() {
            let found = format!("a scene that reaches {extent} half sides of its inner box");
            let expected = "boxes with corners that float32 can hold";
            return Err(
                Error::malformed(place.clone(), found, expected).advise("pass a smaller --extent")
            );
        }
        found.push(next);
        last = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MIDDLE: Middle = Middle { center: [0.5, -1.0, 2.0], radius: [1.5; 3] };

    #[test]
    fn nodes_of_the_first_box_are_those_of_the_model() {
        for count in [25, 26, 64] {
            let spacing = 2.4 / f64::from(count - 1);
            let first = aligned(MIDDLE, [-1.2; 3], [spacing; 3], 256.0);
            for axis in 0..3 {
                assert_eq!(first.nodes.0[axis] % 2, 1);
                let node = |at: usize| {
                    let [x, ..] = first.position([at; 3]);
                    ((x - MIDDLE.center[0]) / MIDDLE.radius[0] + 1.2) / spacing
                };
                for at in 0..first.nodes.0[axis] {
                    assert!((node(at) - node(at).round()).abs() < 1e-4, "{count}: {}", node(at));
                }
            }
            let reach = f64::from(first.bounds.max[0] - first.bounds.min[0]) / MIDDLE.radius[0];
            assert!((4.0 * (1.0 - ROUNDED)..4.0 + 3.0 * spacing).contains(&reach), "{reach}");
        }
    }

    #[test]
    fn boxes_end_where_they_are_told_to() {
        let limits = Limits::default();
        let plan = |extent: f64| {
            let first = even(MIDDLE, 33, extent);
            boxes(first, MIDDLE, extent, &limits, &Place::File)
        };
        for (extent, count) in [(1.0, 1), (2.0, 1), (2.1, 2), (4.0, 2), (256.0, 8), (300.0, 9)] {
            let found = plan(extent).expect("boxes");
            assert_eq!(found.len(), count, "{extent}");
            for pair in found.windows(2) {
                pair[1].check_around(&pair[0], &Place::File).expect("nested");
            }
        }
        assert!(plan(1e12).is_err());
        let tight = Limits { axis_nodes: 16, ..Limits::default() };
        let first = even(MIDDLE, 33, 4.0);
        assert!(boxes(first, MIDDLE, 4.0, &tight, &Place::File).is_err());
    }
}
