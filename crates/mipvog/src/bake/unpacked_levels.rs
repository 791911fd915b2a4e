//! The levels of an unpacked container as a bake stores them, plane by plane.

use super::level_source::LevelSource;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::levels::{Plane, PlaneSink, ReadSummary};
use crate::model::baked::{Group, Metadata};
use crate::model::grid::{BlockGrid, Nodes};
use crate::unpacked::UnpackedLevel;

/// The levels of an unpacked container, as they are.
pub struct UnpackedLevels<'a> {
    /// Levels, finest first, then shells.
    pub levels: &'a [UnpackedLevel],
    /// Its encodings determine its groups.
    pub metadata: &'a Metadata,
}

impl LevelSource for UnpackedLevels<'_> {
    fn stream(
        &self,
        sink: &dyn PlaneSink,
        step: Step,
        progress: &dyn Progress,
    ) -> Result<ReadSummary> {
        progress.begin(step, self.levels.len() as u64);
        let mut summary = ReadSummary::default();
        for (number, level) in self.levels.iter().enumerate() {
            self.stream_level(number, level, sink, progress)?;
            summary.bytes += level.bytes();
            progress.advance(step, 1);
        }
        Ok(summary)
    }
}

impl UnpackedLevels<'_> {
    /// Streams one level, a block's thickness at a time.
    fn stream_level(
        &self,
        number: usize,
        level: &UnpackedLevel,
        sink: &dyn PlaneSink,
        progress: &dyn Progress,
    ) -> Result<()> {
        let present = |group: Group| {
            let encoding = self.metadata.part(number)?.encoding(group)?;
            let channels = group.channels(self.metadata.layout());
            Some((0..channels).map(move |channel| (group, channel, encoding.empty)))
        };
        let channels: Vec<(Group, usize, f32)> =
            Group::ALL.into_iter().filter_map(present).flatten().collect();
        let BlockGrid { nodes: Nodes([nx, ny, nz]), edge } = level.table.grid();
        for first in (0..nx).step_by(edge) {
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
            let planes = first..nx.min(first + edge);
            parallel::map(planes.len() * channels.len(), |i| {
                let (group, channel, empty) = channels[i % channels.len()];
                let x = first + i / channels.len();
                let mut values = vec![0.0; ny * nz];
                level.read_plane((group, channel), x, empty, &mut values)?;
                if let Some(at) = values.iter().position(|value| !value.is_finite()) {
                    let first = [channel, x, at / nz, at % nz];
                    let name = format!("{}.{}", self.metadata.part_name(number), group.name());
                    let kind = ErrorKind::NonFinite { count: 1, first };
                    return Err(Error::new(kind, Place::Tensor(name)));
                }
                let channel = i % channels.len();
                sink.plane(Plane { level: number, x, channel, values: &mut values })
            })?;
            sink.slab(number, planes)?;
        }
        Ok(())
    }
}
