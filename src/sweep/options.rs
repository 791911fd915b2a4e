//! The options of a sweep.

use super::setting::{Grid, Setting};
use crate::base::limits::Limits;
use crate::base::shard::Shard;

/// The part of a sweep in a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Share {
    /// All settings, and the reports.
    All,
    /// The settings of a shard, without the reports.
    Shard(Shard),
    /// The reports of other runs' results.
    Merge,
}

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
    /// The settings that this run has a share in. Default: all
    pub share: Share,
    /// Bounds on files that are read back: containers, and results of former sweeps. Default: the
    /// usual ones
    pub limits: Limits,
}

impl Default for SweepOptions {
    fn default() -> Self {
        let settings = Grid::usual().settings().unwrap_or_default();
        Self {
            settings,
            scales: vec![1, 2, 4, 8],
            repeat: 3,
            overwrite: false,
            share: Share::All,
            limits: Limits::default(),
        }
    }
}
