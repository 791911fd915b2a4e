//! Arrays as the source and the sink of pyramids.

use std::ops::Range;
use std::sync::Mutex;

use mipvog::base::error::Result;
use mipvog::base::progress::{Silent, Step};
use mipvog::levels::{Content, Plane, PlaneSink, PlaneSource, Pyramid, RequiredNodes};
use mipvog::model::grid::{NodeMask, Nodes};

/// Channels of a level, `[channel][node]`.
pub type Channels = Vec<Vec<f32>>;

/// Level 0 from arrays.
pub struct ArraySource<'a> {
    pub channels: &'a [Vec<f32>],
    /// Nodes outside are no numbers.
    pub inside: &'a NodeMask,
}

impl PlaneSource for ArraySource<'_> {
    fn channels(&self) -> usize {
        self.channels.len()
    }

    fn read(&self, channel: usize, x: usize, _: &[u64], values: &mut [f32]) -> Result<()> {
        let (nz, length) = (self.inside.nodes().0[2], values.len());
        for (i, value) in values.iter_mut().enumerate() {
            let inside = self.inside.contains([x, i / nz, i % nz]);
            *value = if inside { self.channels[channel][x * length + i] } else { f32::NAN };
        }
        Ok(())
    }
}

/// All levels in arrays, and the planes of each level that have been told of.
struct ArraySink {
    levels: Vec<Vec<Mutex<Vec<f32>>>>,
    told: Mutex<Vec<usize>>,
}

impl PlaneSink for ArraySink {
    fn plane(&self, Plane { level, x, channel, values }: Plane) -> Result<()> {
        // Level 0 may have more channels than go up.
        if let Some(all) = self.levels[level].get(channel) {
            let mut all = all.lock().expect("a level");
            all[x * values.len()..][..values.len()].copy_from_slice(values);
        }
        Ok(())
    }

    fn slab(&self, level: usize, planes: Range<usize>) -> Result<()> {
        let mut told = self.told.lock().expect("counts");
        assert_eq!(planes.start, told[level], "planes are told of in order");
        told[level] = planes.end;
        Ok(())
    }
}

/// All levels of arrays.
pub fn levels(channels: &[Vec<f32>], required: &RequiredNodes, content: Content) -> Vec<Channels> {
    let sizes: Vec<Nodes> = required.levels().iter().map(NodeMask::nodes).collect();
    let stored = |level: usize| match &content {
        Content::Logits(range) => range.len(),
        Content::Alpha(_) => 1,
        Content::Colors { direction, .. } => {
            channels.len() + direction.map_or(0, |direction| direction.channels(level))
        }
    };
    let level = |(level, nodes): (usize, &Nodes)| {
        (0..stored(level)).map(|_| Mutex::new(vec![0.0; nodes.count()])).collect()
    };
    let told = Mutex::new(vec![0; sizes.len()]);
    let sink = ArraySink { levels: sizes.iter().enumerate().map(level).collect(), told };
    let source = &ArraySource { channels, inside: required.level(0) };
    Pyramid { source, required, content, slab: 3, pipelined: true }
        .run(&sink, Step::Encode, &Silent)
        .expect("levels");
    let told = sink.told.into_inner().expect("counts");
    assert!(told.iter().zip(&sizes).all(|(&told, size)| told == size.0[0]));
    let values = |values: Mutex<Vec<f32>>| values.into_inner().expect("a level");
    sink.levels.into_iter().map(|level| level.into_iter().map(values).collect()).collect()
}
