//! The levels of a trained field as a bake stores them, plane by plane.

use super::BakeOptions;
use super::fit::Fitted;
use super::level_source::LevelSource;
use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::levels::{
    Content, Direction, FieldPass, Plane, PlaneSink, PlaneSource, Pyramid, ReadSummary,
    RequiredNodes, Verify, Visible,
};
use crate::model::field::{ColorDomain, DensityFunction, Planes};
use crate::model::grid::{NodeMask, Nodes};
use crate::quantize::Bits;

/// A trained field and the filter of its levels.
#[derive(Debug, Clone, Copy)]
pub struct FilteredLevels<'a> {
    /// The field.
    pub planes: &'a Planes<'a>,
    /// The filter, and the block size, which is the thickness of slabs.
    pub options: &'a BakeOptions,
    /// The nodes whose values must be exact.
    pub visible: &'a Visible,
    /// Levels that were fitted.
    pub fitted: Option<&'a Fitted>,
    /// True if slabs are encoded while the next ones are made.
    pub pipelined: bool,
    /// True if only windows of the field are retained, for a forecast. Planes outside are skipped,
    /// and checksums are not compared with those in the file.
    pub is_window: bool,
}

impl FilteredLevels<'_> {
    /// True if some encodings are fitted to the range of their values.
    pub fn is_laid_over_values(&self) -> bool {
        let field = self.planes.field();
        let integers = matches!(self.options.bits, Bits::Integer(_));
        let relu = field.scene.activation.function != DensityFunction::Softplus;
        integers && (relu || field.color_domain == ColorDomain::Linear)
    }

    /// The nodes of each level that are read.
    fn required(&self) -> Result<RequiredNodes> {
        let Self { planes, options, visible, .. } = *self;
        let filter = &*options.filter;
        let averages_alpha = filter.alpha(&planes.field().scene.activation).is_some();
        let mut retained = Vec::with_capacity(visible.levels.len());
        for (level, visible) in visible.levels.iter().enumerate() {
            // Colours also need the alpha of neighbouring nodes, as a divisor.
            retained.push(match averages_alpha && level > 0 {
                true => visible.retained.cells_with_a_corner()?.corners()?,
                false => visible.retained.clone(),
            });
        }
        RequiredNodes::new(retained, visible.occupied.as_ref(), &filter.weights())
    }
}

impl LevelSource for FilteredLevels<'_> {
    fn stream(
        &self,
        sink: &dyn PlaneSink,
        step: Step,
        progress: &dyn Progress,
    ) -> Result<ReadSummary> {
        let Self { planes, options, visible, .. } = *self;
        let scene = &planes.field().scene;
        let filter = &*options.filter;
        let required = self.required()?;
        let visibility = visible.visibility.as_ref();
        let channels = planes.channels();
        // Fitted levels bring their own.
        let direction = Direction::of(filter, planes.field()).filter(|_| self.fitted.is_none());
        let retained = visible.retained();
        let content = Content::of_levels(filter, visibility, planes.field(), retained, direction);
        let verify = if self.is_window { Verify::ColorsOfWindow } else { Verify::Colors };
        let pass = FieldPass::new(planes, verify);
        progress.begin(step, scene.nodes.0[0] as u64);
        let pyramid = Pyramid {
            source: &pass,
            required: &required,
            content,
            slab: options.block_size,
            pipelined: self.pipelined,
        };
        match self.fitted {
            Some(fitted) => pyramid.run(&FittedSink { fitted, sink, channels }, step, progress)?,
            None => pyramid.run(sink, step, progress)?,
        }
        drop(pyramid);
        pass.finish()
    }

    fn read_finest(
        &self,
        visit: &(dyn Fn(Plane, &NodeMask) + Sync),
        step: Step,
        progress: &dyn Progress,
    ) -> Result<Option<ReadSummary>> {
        if self.fitted.is_some() {
            return Ok(None);
        }
        let Self { planes, visible, .. } = *self;
        let Nodes([nx, ny, nz]) = planes.field().scene.nodes;
        let required = self.required()?;
        let mut counted = required.levels()[0].clone();
        counted.unite(&visible.levels[0].retained);
        let pass = FieldPass::new(planes, Verify::Nothing);
        progress.begin(step, nx as u64);
        parallel::map(nx, |x| {
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
            let mut values = vec![0.0; ny * nz];
            for channel in 0..planes.channels() {
                pass.read(channel, x, counted.plane(x), &mut values)?;
                visit(Plane { level: 0, x, channel, values: &mut values }, &counted);
            }
            progress.advance(step, 1);
            Ok(())
        })?;
        pass.finish().map(Some)
    }
}

/// Replaces filtered values by fitted ones.
struct FittedSink<'a> {
    fitted: &'a Fitted,
    sink: &'a dyn PlaneSink,
    /// Channels of the filter's levels.
    channels: usize,
}

impl PlaneSink for FittedSink<'_> {
    fn plane(&self, plane: Plane) -> Result<()> {
        let Plane { level, x, channel, .. } = plane;
        let (nodes, first) = (plane.values.len(), self.channels);
        self.fitted.replace(level, x, channel, plane.values);
        self.sink.plane(plane)?;
        // Filters do not make the other channels: they come after the density of their plane.
        let others = [self.fitted.directional(level), self.fitted.anisotropy(level)];
        let others = others.into_iter().filter(|_| channel == 0).flatten().flatten();
        for (number, values) in others.enumerate() {
            let values = &mut values[x * nodes..][..nodes].to_vec();
            self.sink.plane(Plane { level, x, channel: first + number, values })?;
        }
        Ok(())
    }

    fn slab(&self, level: usize, planes: std::ops::Range<usize>) -> Result<()> {
        self.sink.slab(level, planes)
    }
}
