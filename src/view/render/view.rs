//! What a trained scene or a container says about rendering, as one set of rules.

use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::levels::LevelFilter;
use crate::model::baked::{Aside, BakedField, Blend, LevelOfDetail, Metadata, StepRule};
use crate::model::field::{Activation, FreeSpace, March, RadianceField, Scene};
use crate::model::grid::{Bounds, Nodes};
use crate::model::view_mlp::ViewMlp;
use crate::view::sample::{Dense, Sparse, Stored};

/// Everything but the values between nodes.
#[derive(Debug, Clone)]
pub struct View {
    /// The box.
    pub bounds: Bounds,
    /// Nodes of level 0.
    pub nodes: Nodes,
    /// Density to opacity.
    pub activation: Activation,
    /// Steps along a ray.
    pub march: March,
    /// Colour behind the field.
    pub background: [f32; 3],
    /// Optical depths that levels store, times this, are those over one interval.
    pub depth_scale: f32,
    /// How two levels are mixed.
    pub blend: Blend,
    /// How far apart samples of coarser levels are.
    pub step_rule: StepRule,
    /// Which level a sample reads; none reads level 0.
    pub level_of_detail: Option<LevelOfDetail>,
    /// View-dependent colour.
    pub view_mlp: Option<ViewMlp>,
    /// Where samples count.
    pub free_space: Option<FreeSpace>,
    /// Specular features.
    pub features: usize,
}

/// Coarser levels of a trained field, and the rule to render them by.
#[derive(Debug, Clone, Copy)]
pub struct TrainedLevels<'a> {
    /// How they are made, mixed and marched through.
    pub filter: &'a dyn LevelFilter,
    /// Levels in all, at most.
    pub count: usize,
    /// Which level a sample reads.
    pub level_of_detail: LevelOfDetail,
}

impl<'a> TrainedLevels<'a> {
    /// As many levels as `filter` makes of a scene, rendered by the rules of training where training
    /// had such levels.
    pub fn of_training(filter: &'a dyn LevelFilter, scene: &Scene) -> Self {
        let aside = match filter.blend() {
            Blend::BeforeActivation => Aside::SameIndex,
            Blend::AfterActivation => Aside::SameDistance,
        };
        let (count, level_of_detail) = (filter.level_count(scene.nodes), filter.rule(aside));
        Self { filter, count, level_of_detail }
    }
}

/// A field to be rendered: rules, and values in as many lanes as its channels need.
pub enum Field {
    /// Diffuse colour only.
    Lanes4(View, Stored<4>),
    /// Up to 5 features.
    Lanes8(View, Stored<8>),
    /// Up to 13 features.
    Lanes16(View, Stored<16>),
}

impl Field {
    /// A trained field, with coarser levels if `levels` says so.
    pub fn trained(
        field: &RadianceField,
        levels: Option<TrainedLevels>,
        limits: &Limits,
    ) -> Result<Self> {
        let scene = &field.scene;
        let features = field.color_channels() - 3;
        let view = View {
            bounds: scene.bounds,
            nodes: scene.nodes,
            activation: scene.activation,
            march: scene.march,
            background: scene.background,
            depth_scale: 1.0,
            blend: levels.map_or(Blend::BeforeActivation, |levels| levels.filter.blend()),
            step_rule: levels.map_or(StepRule::Constant, |levels| levels.filter.step_rule()),
            level_of_detail: levels.map(|levels| levels.level_of_detail),
            view_mlp: field.view_mlp.clone(),
            free_space: field.free_space.clone(),
            features,
        };
        let levels = levels.map(|levels| (levels.filter, levels.count));
        Ok(match features {
            0..=1 => Self::Lanes4(view, Stored::Dense(Dense::new(field, levels, limits)?)),
            2..=5 => Self::Lanes8(view, Stored::Dense(Dense::new(field, levels, limits)?)),
            6..=13 => Self::Lanes16(view, Stored::Dense(Dense::new(field, levels, limits)?)),
            _ => return Err(too_many(features)),
        })
    }

    /// A baked field.
    pub fn baked(field: &BakedField, limits: &Limits) -> Result<Self> {
        let view = View::of_metadata(&field.metadata, field);
        Ok(match view.features {
            0..=1 => Self::Lanes4(view, Stored::Sparse(Sparse::new(field, limits)?)),
            2..=5 => Self::Lanes8(view, Stored::Sparse(Sparse::new(field, limits)?)),
            6..=13 => Self::Lanes16(view, Stored::Sparse(Sparse::new(field, limits)?)),
            features => return Err(too_many(features)),
        })
    }

    /// The rules.
    pub fn view(&self) -> &View {
        match self {
            Self::Lanes4(view, _) | Self::Lanes8(view, _) | Self::Lanes16(view, _) => view,
        }
    }

    /// The rules, to be overridden.
    pub fn view_mut(&mut self) -> &mut View {
        match self {
            Self::Lanes4(view, _) | Self::Lanes8(view, _) | Self::Lanes16(view, _) => view,
        }
    }
}

impl View {
    fn of_metadata(metadata: &Metadata, field: &BakedField) -> Self {
        Self {
            bounds: metadata.bounds,
            nodes: metadata.levels[0].grid().nodes,
            activation: metadata.activation,
            march: metadata.march,
            background: metadata.background,
            depth_scale: 1.0,
            blend: metadata.blend,
            step_rule: metadata.step_rule,
            level_of_detail: Some(metadata.level_of_detail),
            view_mlp: field.view_mlp.clone(),
            free_space: field.free_space.clone(),
            features: metadata.features,
        }
    }

    /// Takes another step length, in voxels; the interval goes with it.
    pub fn set_stepsize(&mut self, stepsize: f32) {
        self.activation.interval *= stepsize / self.march.stepsize;
        self.depth_scale *= stepsize / self.march.stepsize;
        self.march.stepsize = stepsize;
    }
}

fn too_many(features: usize) -> Error {
    let found = format!("{features} features");
    Error::unsupported(Place::File, found, "at most 13")
}
