//! The rendering rules of a trained scene or a container.

use crate::base::error::{Place, Result};
use crate::model::baked::{BakedField, Blend, LevelOfDetail, StepRule};
use crate::model::grid::{Bounds, BoxFrame, Nodes};
use crate::model::scene::{Activation, ColorDomain, FreeSpace, March, voxels_along};
use crate::model::view_dependence::ViewDependence;

/// All rules, without the field's values.
#[derive(Debug, Clone)]
pub struct View {
    /// The outermost box.
    pub bounds: Bounds,
    /// The box of level 0.
    pub finest_bounds: Bounds,
    /// Places of nested boxes in `bounds`, level 0's first; empty if all levels span it.
    pub boxes: Vec<BoxFrame>,
    /// Nodes of level 0.
    pub nodes: Nodes,
    /// Density to opacity.
    pub activation: Activation,
    /// Steps along a ray.
    pub march: March,
    /// World units from a ray's origin after which it has no samples. `None`: up to the end of the
    /// box.
    pub reach: Option<f64>,
    /// Colour behind the field.
    pub background: [f32; 3],
    /// Factor from stored optical depths to those over one interval.
    pub depth_scale: f32,
    /// Mixing of two levels.
    pub blend: Blend,
    /// Spacing of samples of coarser levels.
    pub step_rule: StepRule,
    /// The rule for the level that a sample reads; none reads the finest.
    pub level_of_detail: Option<LevelOfDetail>,
    /// The finest level that samples may read: 0 except for prefixes of containers.
    pub finest: usize,
    /// View-dependent colour.
    pub view_dependence: Option<ViewDependence>,
    /// Meaning of colours between nodes.
    pub color_domain: ColorDomain,
    /// True if levels have directional brightness, in the last lanes of their values.
    pub directional: bool,
    /// True if levels have anisotropy.
    pub anisotropic: bool,
    /// The space in which samples count.
    pub free_space: Option<FreeSpace>,
    /// Specular features.
    pub features: usize,
}

impl View {
    /// The rules of a baked field, which has at least one level.
    pub fn of_baked(field: &BakedField) -> Self {
        let metadata = &field.metadata;
        Self {
            bounds: metadata.outer_bounds(),
            finest_bounds: metadata.bounds,
            boxes: BoxFrame::of_boxes(&metadata.boxes()),
            nodes: metadata.levels[0].grid().nodes,
            activation: metadata.activation,
            march: metadata.march,
            reach: None,
            background: metadata.background,
            depth_scale: 1.0,
            blend: metadata.blend,
            step_rule: metadata.step_rule,
            level_of_detail: Some(metadata.level_of_detail),
            finest: field.finest,
            view_dependence: metadata.view_dependence(field.view_mlp.as_ref()),
            color_domain: metadata.color_domain(),
            directional: metadata.has_directional(),
            anisotropic: metadata.has_anisotropy(),
            free_space: field.free_space.clone(),
            features: metadata.features,
        }
    }

    /// Refuses rules that cannot be rendered.
    ///
    /// # Errors
    /// `Malformed`, with the rule as its place.
    pub fn check(&self) -> Result<()> {
        self.bounds.check(&Place::Key("bounds".to_owned()))?;
        self.march.check_nested(self.nodes, &self.finest_bounds, &self.bounds)?;
        match &self.view_dependence {
            Some(view) => view.check(self.features, &Place::Key("view dependence".to_owned())),
            None => Ok(()),
        }
    }

    /// The number of a ray's last sample.
    pub fn last_sample(&self) -> f64 {
        match self.boxes.is_empty() {
            true => self.march.last_sample(self.nodes),
            false => self.march.last_nested_sample(&self.bounds),
        }
    }

    /// Voxels of level 0 along the outermost box.
    pub fn voxels(&self) -> [f64; 3] {
        voxels_along(self.nodes, &self.finest_bounds, &self.bounds)
    }

    /// The number of the smallest box around a place in shares of the outermost box: finer levels
    /// have no content there.
    pub fn box_at(&self, share: [f64; 3]) -> usize {
        let within =
            |frame: &BoxFrame| frame.place(share).iter().all(|at| (0.0..=1.0).contains(at));
        let found = self.boxes.iter().position(within);
        found.unwrap_or(self.boxes.len().saturating_sub(1))
    }

    /// Sets another step length, in voxels; the interval scales with it.
    pub fn set_stepsize(&mut self, stepsize: f32) {
        self.activation.interval *= stepsize / self.march.stepsize;
        self.depth_scale *= stepsize / self.march.stepsize;
        self.march.stepsize = stepsize;
    }

    /// True if the free-space mask keeps a sample at a place in shares of the box. The mask is that
    /// of level 0's box; it keeps everything outside.
    pub fn keeps(&self, position: [f64; 3]) -> bool {
        let extent = self.bounds.extent();
        let world =
            [0, 1, 2].map(|axis| f64::from(self.bounds.min[axis]) + position[axis] * extent[axis]);
        self.keeps_at(world, position)
    }

    /// The same of a position in world units, and in shares of the box.
    pub fn keeps_at(&self, world: [f64; 3], share: [f64; 3]) -> bool {
        let Some(free_space) = &self.free_space else { return true };
        self.box_at(share) > 0 || free_space.contains(world)
    }
}
