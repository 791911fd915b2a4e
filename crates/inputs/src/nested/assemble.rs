//! The outer boxes of a field.

use std::sync::Arc;

use super::colors::SampledColors;
use super::density::SampledDensity;
use super::world::ColoredWorld;
use crate::base::limits::Limits;
use crate::model::field::{Grid, Lattice, RadianceField, Shell};
use crate::model::grid::Bounds;
use crate::model::harmonics::Harmonics;
use crate::network::FittedColors;

/// The rules of colour fits.
#[derive(Debug, Clone, Copy)]
pub struct Colors<'a> {
    /// The rules of the harmonics.
    pub harmonics: Harmonics,
    /// True for colours that do not depend on the view.
    pub plain: bool,
    /// Camera positions, if given.
    pub cameras: &'a [[f64; 3]],
}

impl Colors<'_> {
    /// The colours of a box whose densities are those of `geometry`.
    fn fit<W: ColoredWorld + 'static>(
        &self,
        world: &Arc<W>,
        lattice: Lattice,
        geometry: RadianceField,
        inner: Option<Bounds>,
        limits: &Limits,
    ) -> Grid {
        let colors = SampledColors { world: Arc::clone(world), lattice };
        let mut fitted = FittedColors::new(colors, self.harmonics, geometry, self.cameras, limits);
        if let Some(inner) = inner {
            fitted = fitted.seen_from(inner);
        }
        Grid::Values(Arc::new(if self.plain { fitted.plain() } else { fitted }))
    }
}

/// The colours of a field's own box.
pub fn fitted_colors<W: ColoredWorld + 'static>(
    world: &Arc<W>,
    field: &RadianceField,
    colors: &Colors<'_>,
    limits: &Limits,
) -> Grid {
    colors.fit(world, field.lattice(), field.clone(), None, limits)
}

/// The boxes around a field without colours, whose mask ends at its own box. `inner` is the space
/// of the cameras.
pub fn shells<W: ColoredWorld + 'static>(
    world: &Arc<W>,
    field: &RadianceField,
    lattices: &[Lattice],
    inner: Bounds,
    colors: &Colors<'_>,
    limits: &Limits,
) -> Vec<Shell> {
    let shell = |(number, lattice): (i32, &Lattice)| {
        let density = SampledDensity::new(Arc::clone(world), *lattice, &field.scene, true);
        let density = Grid::Values(Arc::new(density));
        let mut geometry = RadianceField {
            density: density.clone(),
            color: Vec::new(),
            free_space: None,
            shells: Vec::new(),
            ..field.clone()
        };
        geometry.scene.bounds = lattice.bounds;
        geometry.scene.nodes = lattice.nodes;
        // Samples of this box are farther apart, so lower densities become visible.
        geometry.scene.march.color_threshold *= libm::ldexpf(1.0, -number);
        let color = vec![colors.fit(world, *lattice, geometry, Some(inner), limits)];
        Shell { lattice: *lattice, density, color }
    };
    (1..).zip(lattices).map(shell).collect()
}
