//! Coarser levels, fitted to what they should look like.
//!
//! A filter does not know that a ray sees the front of things, nor how thick matter looks along it.
//! So after `rate-tent` has made the levels, their pictures are compared with what they stand for:
//! [`target`] renders level 0 from cameras on spheres around the box and box-downsamples the pictures;
//! [`gradient`] renders single rays of the small pictures, one ray a pixel, and differentiates their
//! colour by what the level holds (through the view network, compositing, blending of levels,
//! activation and interpolation); [`adam`] takes steps. Levels are fitted finest to coarsest, each with
//! the finer ones as they are then. Only nodes that can be seen change.
//!
//! The budget is in steps, rays are drawn by a fixed generator and sums of gradients are in a fixed
//! order, so that the same bytes come out for any number of threads.

mod adam;
mod gradient;
mod target;

use adam::Adam;
use gradient::{Gradient, Rays};
use target::Targets;

use crate::error::Result;
use crate::field::RadianceField;
use crate::grid::NodeMask;
use crate::limits::Limits;
use crate::mips::Slab;
use crate::parallel;
use crate::progress::{Progress, Step};
use crate::render::{Field, TrainedLevels, View};
use crate::sample::{Dense, Stored};

/// Parts of a batch of rays that are differentiated at once; fixed, so that sums are too.
const PARTS: usize = 8;
/// Rays of a step.
const BATCH: usize = 4096;

/// Fitted levels.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// From level 1 on; channels as slabs have them, density first: `[channel][node]`.
    levels: Vec<Vec<Vec<f32>>>,
}

impl Fitted {
    /// Puts fitted values in the place of a slab's of `level`.
    pub fn replace(&self, level: usize, slab: &mut Slab) {
        let Some(fitted) = level.checked_sub(1).and_then(|level| self.levels.get(level)) else {
            return;
        };
        let (first, channels) = (slab.first, slab.channels);
        for (i, plane) in slab.planes.iter_mut().enumerate() {
            let (length, x) = (plane.len(), first + i / channels);
            plane.copy_from_slice(&fitted[i % channels][x * length..][..length]);
        }
    }
}

/// Fits the coarser `levels` of `field`, each in `steps` steps; `needed` are the nodes of each level
/// that can be seen, `masked` says whether renderers will have the free-space mask.
pub fn fit(
    field: &RadianceField,
    levels: TrainedLevels,
    needed: &[&NodeMask],
    masked: bool,
    steps: usize,
    limits: &Limits,
    progress: &dyn Progress,
) -> Result<Fitted> {
    let mut rendered = Field::trained(field, Some(levels), limits)?;
    if !masked {
        rendered.view_mut().free_space = None;
    }
    let coarser = needed.len().saturating_sub(1);
    let targets = Targets::new(&rendered, coarser, progress)?;
    progress.begin(Step::Fit, (coarser * steps) as u64);
    match rendered {
        Field::Lanes4(view, stored) => fit_levels(&view, stored, &targets, needed, steps, progress),
        Field::Lanes8(view, stored) => fit_levels(&view, stored, &targets, needed, steps, progress),
        Field::Lanes16(view, stored) => {
            fit_levels(&view, stored, &targets, needed, steps, progress)
        }
    }
}

fn fit_levels<const C: usize>(
    view: &View,
    stored: Stored<C>,
    targets: &Targets,
    needed: &[&NodeMask],
    steps: usize,
    progress: &dyn Progress,
) -> Result<Fitted> {
    let Stored::Dense(mut field) = stored else { return Ok(Fitted { levels: Vec::new() }) };
    for (level, needed) in needed.iter().enumerate().skip(1) {
        fit_level(view, &mut field, targets, level, needed, steps, progress)?;
    }
    let channels = |level: usize| {
        let (density, color) = field.values(level);
        let lane = |lane: usize| color.iter().map(|color| color[lane]).collect();
        [density.to_vec()].into_iter().chain((0..3 + view.features).map(lane)).collect()
    };
    Ok(Fitted { levels: (1..needed.len()).map(channels).collect() })
}

fn fit_level<const C: usize>(
    view: &View,
    field: &mut Dense<C>,
    targets: &Targets,
    level: usize,
    needed: &NodeMask,
    steps: usize,
    progress: &dyn Progress,
) -> Result<()> {
    let mut adam = Adam::new(field, level, needed);
    let mut gradients: Vec<Gradient<C>> = (0..PARTS).map(|_| Gradient::new(adam.nodes())).collect();
    for step in 0..steps {
        let rays = Rays { view, field, level, targets, numbers: adam.numbers() };
        parallel::map_mut(&mut gradients, |part, gradient| {
            for i in 0..BATCH / PARTS {
                rays.differentiate((step * PARTS + part) * (BATCH / PARTS) + i, gradient);
            }
            Ok(())
        })?;
        adam.step(field, &mut gradients, step as f32 / steps as f32)?;
        progress.advance(Step::Fit, 1);
        if progress.cancelled() {
            break;
        }
    }
    Ok(())
}
