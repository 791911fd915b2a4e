//! A ray through nested boxes. A sample reads no finer level than that of the smallest box around
//! it. Samples in a box are at least as far apart as its nodes.
//!
//! The next sample in box `m` comes `2^m` steps later, or even later if the level of detail
//! requires it. If the ray enters a smaller box before that, the next sample is the first whole
//! step in that box, so no step skips its contents.

use super::path::Path;
use crate::model::grid::BoxFrame;

/// Maximum number of nested boxes in a container.
const MAX_BOXES: usize = 32;

/// The part of a ray up to the next box.
#[derive(Debug, Clone, Copy)]
pub struct Region {
    /// Index of the smallest box around the region.
    pub number: usize,
    /// Sample 0 of the ray, as fractions of that box.
    pub start: [f64; 3],
    /// Step from one sample to the next.
    pub step: [f64; 3],
    /// Smallest index of a sample in the region.
    pub first: f64,
    /// Largest index of a sample in the region.
    pub last: f64,
    /// Index at which the next box starts, or one beyond the last sample.
    pub end: f64,
    /// True if the next box is a smaller one.
    pub is_entered: bool,
}

impl Region {
    /// The region of a ray through one box.
    pub fn whole(path: &Path) -> Self {
        let Path { start, step, first, last, .. } = *path;
        Self { number: 0, start, step, first, last, end: last + 1.0, is_entered: false }
    }

    /// Position of sample `k`, as fractions of the box.
    #[inline(always)]
    pub fn position(&self, k: f64) -> [f64; 3] {
        let along = |axis: usize| (self.start[axis] + k * self.step[axis]).clamp(0.0, 1.0);
        [along(0), along(1), along(2)]
    }

    /// Index of the sample after `k`: `next`, unless the region ends before it.
    #[inline(always)]
    pub fn entered(&self, k: f64, next: f64) -> f64 {
        if self.is_entered && next > self.end {
            return k + (self.end - k).ceil().max(1.0).min(next - k);
        }
        next
    }
}

/// The samples that lie in each box.
#[derive(Debug)]
pub struct Crossings {
    /// First and last, by box; an empty range for a box that the ray misses.
    ranges: [[f64; 2]; MAX_BOXES],
}

impl Crossings {
    /// The ranges of a ray through `boxes`, the smallest first.
    pub fn new(path: &Path, boxes: &[BoxFrame]) -> Self {
        let mut ranges = [[f64::INFINITY, f64::NEG_INFINITY]; MAX_BOXES];
        for (range, frame) in ranges.iter_mut().zip(boxes) {
            if let Some(within) = path.within(frame) {
                *range = within;
            }
        }
        // The largest is that of the ray itself.
        if let Some(range) = ranges.get_mut(boxes.len() - 1) {
            *range = [path.first, path.last];
        }
        Self { ranges }
    }

    /// The region of sample `k`.
    pub fn region(&self, path: &Path, boxes: &[BoxFrame], k: f64) -> Region {
        let ranges = &self.ranges[..boxes.len()];
        let holds = |[first, last]: &[f64; 2]| *first <= k && k <= *last;
        let number = ranges.iter().position(holds).unwrap_or(boxes.len() - 1);
        let (start, step) = path.placed_in(&boxes[number]);
        // The ray enters the largest of the smaller boxes first.
        let enters = ranges[..number].iter().rev().map(|[first, _]| *first);
        let entered = enters.into_iter().find(|&first| first > k && first.is_finite());
        let leaves = ranges[number][1];
        match entered {
            Some(first) => {
                let last = first.next_down();
                Region { number, start, step, first: k, last, end: first, is_entered: true }
            }
            None => {
                let end = if leaves < path.last { leaves } else { path.last + 1.0 };
                let last = leaves;
                Region { number, start, step, first: k, last, end, is_entered: false }
            }
        }
    }
}
