//! Inputs and results of the fits of all levels.

use std::time::Instant;

use serde::Serialize;

use super::options::FitOptions;
use super::target::Targets;
use crate::base::progress::Progress;
use crate::levels::{Filter, SharedFilter};
use crate::model::anisotropy::ANISOTROPY;
use crate::model::baked::LevelOfDetail;
use crate::model::directional::DIRECTIONAL;
use crate::model::grid::NodeMask;
use crate::view::sample::Dense;
use crate::view::sample::{View, brightness};

/// The fit of one level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct FittedLevel {
    /// Index of the level; 0 is the finest.
    pub level: usize,
    /// Number of steps taken.
    pub steps: usize,
    /// PSNR in dB of the levels of `rate-tent`, before the fit. It is measured on held-out rays of
    /// pictures `2^level` times smaller along each side; null if the time limit came first.
    pub psnr_before: Option<f64>,
    /// PSNR in dB after the fit, on the same rays; null if the time limit came first.
    pub psnr_after: Option<f64>,
    /// True if the fitted level is used. False if the level of `rate-tent` is used instead, because
    /// the fit is worse at some scale.
    pub kept: bool,
}

/// Fitted levels.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// From level 1 on, `[channel][node]`, density first, directional brightness last if it is
    /// there.
    values: Vec<Vec<Vec<f32>>>,
    has_directional: bool,
    /// From level 1 on, `[channel][node]`; none where no level has any.
    anisotropy: Vec<Vec<Vec<f32>>>,
    /// The rule under which the levels look best.
    pub level_of_detail: LevelOfDetail,
    /// The fit of each level, from level 1 on.
    pub levels: Vec<FittedLevel>,
    /// True if the fit stopped at its time limit or at the wish of the caller.
    pub cut_short: bool,
}

impl Fitted {
    /// Without levels.
    pub(super) fn none(level_of_detail: LevelOfDetail) -> Self {
        Self {
            values: Vec::new(),
            has_directional: false,
            anisotropy: Vec::new(),
            level_of_detail,
            levels: Vec::new(),
            cut_short: false,
        }
    }

    /// The coarser levels of `field` as filtered: time ran out before the first step.
    pub(super) fn unfitted<const C: usize>(view: &View, field: &Dense<C>, count: usize) -> Self {
        let level = |level| FittedLevel {
            level,
            steps: 0,
            psnr_before: None,
            psnr_after: None,
            kept: false,
        };
        let rule = SharedFilter::from(Filter::RateTent).rule();
        Self::new(view, field, rule, (1..count).map(level).collect(), true)
    }

    /// The coarser levels of `field` as they are.
    pub(super) fn new<const C: usize>(
        view: &View,
        field: &Dense<C>,
        level_of_detail: LevelOfDetail,
        levels: Vec<FittedLevel>,
        cut_short: bool,
    ) -> Self {
        // A rejected fit leaves it unchanged.
        let brightens = |level: &FittedLevel| {
            let (_, color) = field.values(level.level);
            view.directional && color.iter().any(|color| brightness(color) != [0.0; DIRECTIONAL])
        };
        let has_directional = levels.iter().any(brightens);
        let lanes: Vec<usize> = match has_directional {
            true => (0..3 + view.features).chain(C - DIRECTIONAL..C).collect(),
            false => (0..3 + view.features).collect(),
        };
        let values = (1..=levels.len()).map(|level| channels(field, level, &lanes)).collect();
        let anisotropy = |level: usize| {
            let nodes = field.anisotropy(level);
            let channel = |channel: usize| nodes.iter().map(|node| node[channel]).collect();
            (0..ANISOTROPY).map(channel).collect()
        };
        let shapes = |level: &FittedLevel| {
            field.anisotropy(level.level).iter().any(|node| *node != [0.0; ANISOTROPY])
        };
        let anisotropy = match levels.iter().any(shapes) {
            true => (1..=levels.len()).map(anisotropy).collect(),
            false => Vec::new(),
        };
        Self { values, has_directional, anisotropy, level_of_detail, levels, cut_short }
    }

    /// The channels of directional brightness of `level`; none if it has no such values.
    pub fn directional(&self, level: usize) -> Option<&[Vec<f32>]> {
        let channels = self.values.get(level.checked_sub(1)?)?;
        self.has_directional.then(|| &channels[channels.len() - DIRECTIONAL..])
    }

    /// The channels of anisotropy of `level`; none if it has no such values.
    pub fn anisotropy(&self, level: usize) -> Option<&[Vec<f32>]> {
        self.anisotropy.get(level.checked_sub(1)?).map(Vec::as_slice)
    }

    /// Replaces plane `x` of a channel of `level` by fitted values.
    pub fn replace(&self, level: usize, x: usize, channel: usize, plane: &mut [f32]) {
        if let Some(fitted) = level.checked_sub(1).and_then(|level| self.values.get(level)) {
            plane.copy_from_slice(&fitted[channel][x * plane.len()..][..plane.len()]);
        }
    }
}

/// Inputs of the fits of all levels.
pub struct FitContext<'a> {
    pub targets: &'a Targets,
    pub retained: &'a [&'a NodeMask],
    pub options: &'a FitOptions<'a>,
    /// The rule that levels are fitted under.
    pub start: LevelOfDetail,
    pub clock: Instant,
    pub progress: &'a dyn Progress,
}

/// A level's values by channel: density, and those lanes of colour.
fn channels<const C: usize>(field: &Dense<C>, level: usize, lanes: &[usize]) -> Vec<Vec<f32>> {
    let (density, color) = field.values(level);
    let lane = |&lane: &usize| color.iter().map(|color| color[lane]).collect();
    [density.to_vec()].into_iter().chain(lanes.iter().map(lane)).collect()
}
