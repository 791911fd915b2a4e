//! Sizes of levels.

use crate::model::grid::Nodes;

/// Sizes of level 0 and all coarser ones, at most `count` in all, finest first.
pub fn level_sizes(finest: Nodes, count: usize) -> Vec<Nodes> {
    let mut sizes = vec![finest];
    let mut last = finest;
    while sizes.len() < count && last.halved() != last {
        last = last.halved();
        sizes.push(last);
    }
    sizes
}

/// Levels that a bake makes by default: down to 4 nodes along the longest axis. A scene of that
/// size covers a few pixels.
pub fn default_level_count(finest: Nodes) -> usize {
    let is_wide = |nodes: &Nodes| nodes.0.iter().any(|&size| size >= 8);
    1 + level_sizes(finest, usize::MAX).iter().filter(|nodes| is_wide(nodes)).count()
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
