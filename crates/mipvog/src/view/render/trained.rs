//! The rendering rules of a trained scene.

use crate::levels::{Direction, LevelFilter};
use crate::model::baked::{Blend, LevelOfDetail, StepRule};
use crate::model::field::{March, RadianceField, Scene};
use crate::model::trained_model::RayRules;
use crate::view::sample::View;

/// The coarser levels of a trained field and the rules for rendering them.
#[derive(Debug, Clone, Copy)]
pub struct TrainedLevels<'a> {
    /// Rules for making, blending and marching through the levels.
    pub filter: &'a dyn LevelFilter,
    /// Maximum number of levels, including level 0.
    pub count: usize,
    /// Rule that picks the level of a sample.
    pub level_of_detail: LevelOfDetail,
}

impl<'a> TrainedLevels<'a> {
    /// The default number of levels of `filter`. If training had such levels, they are rendered by
    /// its rules.
    pub fn of_training(filter: &'a dyn LevelFilter, scene: &Scene) -> Self {
        Self { filter, count: filter.level_count(scene.nodes), level_of_detail: filter.rule() }
    }
}

/// The rules of a trained field.
pub(super) fn view_of(field: &RadianceField, levels: Option<TrainedLevels>) -> View {
    let scene = &field.scene;
    let direction = levels.and_then(|levels| Direction::of(levels.filter, field));
    View {
        bounds: field.outer_bounds(),
        finest_bounds: scene.bounds,
        boxes: field.frames(),
        nodes: scene.nodes,
        activation: scene.activation,
        march: scene.march,
        reach: None,
        background: scene.background,
        depth_scale: 1.0,
        blend: levels.map_or(Blend::BeforeActivation, |levels| levels.filter.blend()),
        step_rule: levels.map_or(StepRule::Constant, |levels| levels.filter.step_rule()),
        level_of_detail: levels.map(|levels| levels.level_of_detail),
        finest: 0,
        view_dependence: field.view.clone(),
        color_domain: field.color_domain,
        directional: direction.is_some_and(|direction| direction.moments.is_some()),
        anisotropic: direction.is_some(),
        free_space: field.free_space.clone(),
        features: field.color_channels().saturating_sub(3),
    }
}

/// The part of a view that applies to models with their own rules.
pub(super) fn ray_rules(view: &View) -> RayRules {
    let March { near, far, .. } = view.march;
    RayRules { near, far, background: view.background }
}
