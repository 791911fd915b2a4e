//! The source of the levels that are packed.

use crate::base::error::Result;
use crate::base::progress::{Progress, Step};
use crate::levels::{Plane, PlaneSink, ReadSummary};
use crate::model::grid::NodeMask;

/// A source of all levels' planes, as they are to be stored.
pub trait LevelSource {
    /// Streams all levels into `sink` and returns the record of reading.
    ///
    /// # Errors
    ///
    /// Those of reading and of the sink.
    fn stream(
        &self,
        sink: &dyn PlaneSink,
        step: Step,
        progress: &dyn Progress,
    ) -> Result<ReadSummary>;

    /// Shows the planes of level 0 that coarser levels are means of, with the nodes that count; none
    /// where coarser levels hold other values. The record is that of reading.
    ///
    /// # Errors
    ///
    /// Those of reading.
    fn read_finest(
        &self,
        _see: &(dyn Fn(Plane, &NodeMask) + Sync),
        _step: Step,
        _progress: &dyn Progress,
    ) -> Result<Option<ReadSummary>> {
        Ok(None)
    }
}
