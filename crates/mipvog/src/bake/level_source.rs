//! The source of the levels that are packed.

use crate::base::error::Result;
use crate::base::progress::{Progress, Step};
use crate::levels::{Plane, PlaneSink, ReadSummary};
use crate::model::grid::NodeMask;

/// A source of the planes of all levels, as stored.
pub trait LevelSource {
    /// Streams all levels into `sink` and returns the record of reading.
    ///
    /// # Errors
    ///
    /// Errors of reading and of the sink.
    fn stream(
        &self,
        sink: &dyn PlaneSink,
        step: Step,
        progress: &dyn Progress,
    ) -> Result<ReadSummary>;

    /// Shows the planes of level 0 of which coarser levels are means, with the nodes that count;
    /// none if coarser levels hold other values. Returns the record of reading.
    ///
    /// # Errors
    ///
    /// Errors of reading.
    fn read_finest(
        &self,
        _see: &(dyn Fn(Plane, &NodeMask) + Sync),
        _step: Step,
        _progress: &dyn Progress,
    ) -> Result<Option<ReadSummary>> {
        Ok(None)
    }
}
