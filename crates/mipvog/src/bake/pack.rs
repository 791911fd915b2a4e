//! Levels to encoded blocks: encodings, then codes, then inherited blocks.
//!
//! A bake, its forecast and an unpacked container that is packed again differ in their
//! [`LevelSource`] alone.

use std::ops::Range;

use super::encode::{EncodeOptions, ErrorBound, Importance, LevelEncoder};
use super::importance::LevelImportance;
use super::inherit::{Inheritance, inherit_levels};
use super::level_source::LevelSource;
use super::max_error::level_share;
use super::plan::activation_of;
use super::ranges::{EncodingChoice, RangeSink};
use super::report::Stages;
use super::run_store::RunStore;
use crate::base::error::Result;
use crate::base::progress::{Progress, Step};
use crate::container::EncodedLevel;
use crate::levels::{Plane, PlaneSink, ReadSummary};
use crate::model::baked::{Group, LevelMetadata, Metadata, Table};
use crate::model::grid::NodeMask;

/// Everything that determines codes, beside the levels' metadata.
pub struct Packing<'a> {
    /// The planes.
    pub source: &'a dyn LevelSource,
    /// The nodes of each level whose values count.
    pub retained: Vec<&'a NodeMask>,
    /// The choice of encodings; none if those in the metadata are final.
    pub choice: Option<EncodingChoice>,
    /// The bound that values are held to as they are encoded.
    pub bound: ErrorBound,
    /// The importance of each level's nodes; empty if all count alike.
    pub importance: &'a [LevelImportance],
    /// Codes that colours may move by at nodes of importance 1.
    pub coarseness: f32,
    /// The blocks that may inherit their colours.
    pub inheritance: Option<Inheritance<'a>>,
    /// Compression level of zstd.
    pub zstd_level: i32,
    /// The place for compressed runs, if not just memory.
    pub store: Option<&'a RunStore>,
}

impl Packing<'_> {
    /// Encodes all levels into the blocks of `tables`. Encodings, errors and block counts of the
    /// metadata become those of the result. The record is that of the last pass.
    ///
    /// # Errors
    ///
    /// Errors of the source, and a value that exceeds the bound.
    pub fn run(
        &self,
        metadata: &mut Metadata,
        tables: Vec<Table>,
        stages: &mut Stages,
        progress: &dyn Progress,
    ) -> Result<(Vec<EncodedLevel>, ReadSummary)> {
        if let Some(choice) = self.choice {
            let (sink, summary) =
                RangeSink::read(metadata, &self.retained, choice, self.source, progress)?;
            sink.choose_encodings(choice, metadata)?;
            stages.end("ranges", summary.bytes);
        }
        let sink = self.encode_sink(metadata, tables);
        let summary = self.source.stream(&sink, Step::Encode, progress)?;
        let mut encoded = sink.finish(metadata)?;
        if let Some(inheritance) = &self.inheritance {
            let level = |number: usize| (self.retained[number], self.importance.get(number));
            inherit_levels(&mut encoded, metadata, inheritance, self.zstd_level, level)?;
        }
        stages.end("encode", summary.bytes);
        Ok((encoded, summary))
    }

    fn encode_sink(&self, metadata: &Metadata, tables: Vec<Table>) -> EncodeSink<'_> {
        let levels = metadata.parts().zip(self.retained.iter().copied()).zip(tables);
        let encoder = |(part, ((level, retained), table)): (usize, ((&LevelMetadata, _), _))| {
            let number = metadata.level_of_part(part);
            let coarseness = self.coarseness * level_share(number) as f32;
            let importance = self.importance.get(part).filter(|_| coarseness > 0.0);
            let options = EncodeOptions {
                name: metadata.part_name(part),
                layout: metadata.layout(),
                activation: activation_of(metadata, part),
                zstd_level: self.zstd_level,
                bound: self.bound,
                store: self.store,
                importance: importance.map(|level| Importance { level, coarseness }),
            };
            let encodings = Group::ALL.map(|group| level.encoding(group));
            LevelEncoder::new(table, retained, encodings, options)
        };
        EncodeSink { encoders: levels.enumerate().map(encoder).collect() }
    }
}

/// Encodes each level's planes.
struct EncodeSink<'a> {
    encoders: Vec<LevelEncoder<'a>>,
}

impl PlaneSink for EncodeSink<'_> {
    fn plane(&self, Plane { level, x, channel, values }: Plane) -> Result<()> {
        self.encoders[level].put(x, channel, values)
    }

    fn slab(&self, level: usize, planes: Range<usize>) -> Result<()> {
        self.encoders[level].take(planes)
    }
}

impl EncodeSink<'_> {
    /// The encoded levels. Errors in the metadata grow by the largest move of coarsening.
    fn finish(self, metadata: &mut Metadata) -> Result<Vec<EncodedLevel>> {
        let finish = |(level, encoder): (&mut LevelMetadata, LevelEncoder)| {
            for (group, error) in Group::ALL.into_iter().zip(encoder.max_errors()) {
                if let (Some(encoding), Some(error)) = (level.encoding_mut(group), error) {
                    encoding.max_error = error;
                }
            }
            encoder.finish()
        };
        metadata.parts_mut().zip(self.encoders).map(finish).collect()
    }
}
