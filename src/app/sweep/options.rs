//! The options of a sweep.

use super::setting::{Grid, Setting};
use crate::base::limits::Limits;

/// Options of a sweep.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct SweepOptions {
    /// Settings to bake with. Default: [`Grid::usual`]'s
    pub settings: Vec<Setting>,
    /// Scales to compare at: pixels of the full picture along one. Default: 1, 2, 4, 8
    pub scales: Vec<usize>,
    /// Bakes of each setting; the median time counts. Default: 3
    pub repeat: usize,
    /// True if files that no sweep wrote may be replaced. Default: false
    pub overwrite: bool,
    /// Bounds on files that are read back: containers, and results of former sweeps. Default: the
    /// usual ones
    pub limits: Limits,
}

impl Default for SweepOptions {
    fn default() -> Self {
        let settings = Grid::usual().settings();
        Self {
            settings,
            scales: vec![1, 2, 4, 8],
            repeat: 3,
            overwrite: false,
            limits: Limits::default(),
        }
    }
}
