//! Coarser levels: `V[k+1] = resize(lowpass(V[k]))`, on raw values as in training or on matter
//! ([`matter`], which is what looks right from afar).
//!
//! Every level spans the same box with corners aligned, so a level of `N` nodes becomes one of
//! `max(2, N / 2)` whose end nodes lie on the box's faces; the pyramid ends when no axis shrinks.
//! The low-pass mirrors the grid at its faces without repeating the end node. Low-pass and resize
//! are separable and linear, so one axis of one step is a short list of weights for each output
//! node: [`taps`]. [`kernel`] says which low-pass, [`cascade`] streams a field through all levels,
//! plane by plane, touching only the nodes that somebody needs; [`settle`] turns filtered matter into what is stored. Matter is coloured by what can be seen
//! of it: [`visibility`].

pub mod cascade;
pub mod kernel;
mod lift;
mod light;
mod matter;
mod pool;
mod regions;
mod rise;
mod settle;
mod stage;
pub mod taps;
mod visibility;

pub use cascade::{Cascade, SLAB};
pub use kernel::Kernel;
pub use lift::Lift;
pub use matter::{Matter, Settled};
pub use pool::Pool;
pub use regions::Regions;
pub use settle::Settlers;
pub use visibility::{Occluders, Visibility};

use crate::model::grid::Nodes;

/// Sizes of level 0 and all coarser ones, at most `most` in all.
pub fn level_sizes(finest: Nodes, most: usize) -> Vec<Nodes> {
    let mut sizes = vec![finest];
    let mut last = finest;
    while sizes.len() < most && last.halved() != last {
        last = last.halved();
        sizes.push(last);
    }
    sizes
}

/// Levels that a bake makes unless told otherwise: down to 4 nodes along the longest axis, from
/// where a scene is a few pixels large.
pub fn default_level_count(finest: Nodes) -> usize {
    let wide = |nodes: &Nodes| nodes.0.iter().any(|&size| size >= 8);
    1 + level_sizes(finest, usize::MAX).iter().filter(|nodes| wide(nodes)).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_end_when_no_axis_shrinks() {
        let sizes = level_sizes(Nodes([9, 2, 5]), usize::MAX);
        assert_eq!(sizes, [[9, 2, 5], [4, 2, 2], [2, 2, 2]].map(Nodes));
        assert_eq!(level_sizes(Nodes([2; 3]), usize::MAX).len(), 1);
    }

    #[test]
    fn default_levels_end_at_four_nodes() {
        assert_eq!(default_level_count(Nodes([128; 3])), 6);
        assert_eq!(default_level_count(Nodes([32; 3])), 4);
        assert_eq!(default_level_count(Nodes([2; 3])), 1);
    }
}
